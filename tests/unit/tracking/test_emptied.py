"""A marble that stays, and its shadow beside it, are taken out of the median board."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from irt.tracking.edge_fit import Rim
from irt.tracking.emptied import changed, emptied, reaches_beyond
from irt.tracking.shadow import Neighbourhood

SIDE, RADIUS, NOISE = 160, 8.0, 1.5
#: From the marble to its shadow [radii].
SHADOW = np.array([-0.6, 1.7])
COUNT = 20
RESTS, PASSES = (
    np.array([80.0, 70.0]),
    np.array([[x, y] for y in (25.0, 135.0) for x in (25.0, 60.0, 95.0, 130.0)]),
)


def disc(middle: np.ndarray) -> np.ndarray:
    down, right = np.mgrid[:SIDE, :SIDE]
    return np.clip(RADIUS - np.hypot(right - middle[0], down - middle[1]) + 0.5, 0.0, 1.0)[..., None]


def board() -> np.ndarray:
    grain = gaussian_filter(np.random.default_rng(3).standard_normal((SIDE, SIDE)), 2.0)
    return np.array([90.0, 130.0, 165.0]) * np.exp(0.06 * grain / grain.std())[..., None]


def taken() -> tuple[list[np.ndarray], list[tuple[int, Rim]]]:
    """Return pictures in most of which the marble rests, and where it is in each."""
    random = np.random.default_rng(4)
    middles = [*PASSES, *[RESTS] * (COUNT - len(PASSES))]
    pictures = []
    for middle in middles:
        seen = board() * (1.0 - 0.5 * disc(middle + RADIUS * SHADOW))
        seen = seen + disc(middle) * (120.0 - seen)
        pictures.append(np.clip(np.rint(seen + random.normal(0, NOISE, seen.shape)), 0, 255).astype(np.uint8))
    return pictures, [(index, Rim(x, y, RADIUS, 1.0, 1.0)) for index, (x, y) in enumerate(middles)]


def test_the_shadow_of_a_marble_that_rests_is_no_board() -> None:
    pictures, discs = taken()
    median = np.median(np.stack(pictures), axis=0).astype(np.uint8)
    # The median shows what most pictures do: here marble and shadow are off the board by tens of levels.
    shaded = disc(RESTS + RADIUS * SHADOW)[..., 0] > 0.99
    assert np.abs(median[shaded] - board()[shaded]).mean() > 40.0
    around = [
        Neighbourhood(pictures[index].astype(np.float32), board().astype(np.float32), rim.x, rim.y, RADIUS)
        for index, rim in discs
    ]
    mask = changed(around, NOISE)
    assert reaches_beyond(mask)
    found = emptied(pictures, median, discs, mask)
    for place in (shaded, disc(RESTS)[..., 0] > 0.99):
        assert np.abs(found[place] - board()[place]).mean() < 2.0
    # The marble's own disc alone leaves the shadow's far end.
    alone = emptied(pictures, median, discs)
    assert np.abs(alone[shaded] - board()[shaded]).mean() > 10.0


def test_a_marble_that_only_passes_changes_nothing() -> None:
    pictures, discs = taken()
    some, where = pictures[: len(PASSES)], discs[: len(PASSES)]
    median = np.median(np.stack(some), axis=0).astype(np.uint8)
    assert emptied(some, median, where) is median
