"""What a marble's rim looks like in the light of a run, learned from views of it.

On the side of its shadow the steepest change may lie outside the rim, and the marble's own colours may be no
other than the shadow's. So the disc is laid through those rays alone outside of which the board looks as it
does without a marble, over many views at once; where the other rays have their step is then known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.tracking.rim import (
    COS,
    KNOWN,
    RAYS,
    SIN,
    Outline,
    Patch,
    Values,
    changes,
    fit_rim,
    look,
    ray_distances,
)

Array = NDArray[np.float64]

#: Light outside a ray over that without a marble: in shadow below the first, in full light above the second.
DIM, LIT = 0.86, 0.96
#: What a ray in shadow counts beside one in light.
SHADOW_COUNTS = 0.3
#: Distances of the mean rays' samples, in radii.
PARTS = np.arange(0.4, 1.65, 0.04)
#: Where a ray is inside and outside of the rim, and where the board beside it is, in radii.
INSIDE, OUTSIDE, BESIDE = (0.78, 0.92), (1.08, 1.22), (1.1, 1.35)
#: A difference in hue that shows where the rim is [levels].
HUE = 40.0
#: Rays to either side of a shadow that are not trusted either.
NEAR_SHADOW = 2
ROUNDS = 6
#: Share by which the light on the board may be uncertain where hue tells a marble from its shadow.
SHADE = 0.03
#: A difference in hue of so many noises tells.
CLEAR = 3.0
#: Smaller samples tell of their pictures more than of the marble.
LEAST_VIEWS = 6


@dataclass(frozen=True, eq=False)
class View:
    """A marble in a part of a picture, as found so far [pixels of that part]."""

    patch: Patch
    x: float
    y: float
    radius: float


def learn_outline(views: Sequence[View]) -> Outline:
    """Return what the rim looks like; a circle of unknown size where there are too few views.

    Parameters
    ----------
    views : sequence of View
        With the board's colours without the marble; of one marble in different places.
    """
    if len(views) < LEAST_VIEWS:
        return Outline()
    centres, radii, outline = _located(views)
    return _levelled(views, centres, radii, outline)


def _located(views: Sequence[View]) -> tuple[Array, Array, Outline]:
    """Return centres (n, 2) and radii (n,) of the views' discs, and the outline by which they were found."""
    centres = np.array([[view.x, view.y] for view in views])
    radii = np.array([view.radius for view in views])
    noise = float(np.mean([view.patch.noise for view in views]))
    quiet = noise / len(views) ** 0.5
    for _ in range(ROUNDS):
        mean = _mean([view.patch.layers for view in views], centres, radii)
        without = _mean([_known(view.patch) for view in views], centres, radii)
        lit = _lit(mean, without)
        dx, dy, radius = _disc(mean, without, lit, quiet)
        inside = _between(mean, INSIDE).astype(np.float32)
        weights = SHADOW_COUNTS + (1.0 - SHADOW_COUNTS) * lit
        hue = float(np.median(np.linalg.norm(_hues(mean, without), axis=1)))
        shade = SHADE if hue > CLEAR * noise else 0.0
        centres = centres + np.outer(radii, [dx, dy])
        radii = radii * radius
        outline = Outline(weights=weights, inside=inside, shade=shade, free=KNOWN)
        outline = _levelled(views, centres, radii, outline)
        fits = [
            fit_rim(view.patch, (x, y), r, outline)
            for view, (x, y), r in zip(views, centres, radii, strict=True)
        ]
        centres = np.array([[fit.x, fit.y] for fit in fits])
    return centres, radii, outline


def _known(patch: Patch) -> Values:
    """Return the board's colours without the marble."""
    if patch.without is None:
        raise ValueError("an outline is learned where the board is known")
    return patch.without


def _disc(mean: Values, without: Values, lit: Array, quiet: float) -> tuple[float, float, float]:
    """Return offset and radius of the marble's own disc in mean rays, in radii.

    Two things tell it from its shadow. A shadow has the board's hue: where marble and board differ in it, the
    rim of the hue is the marble's. And beside rays in full light there is no shadow. Each has a radius of its
    own, since shading and what mirrors move all rims alike.
    """
    hues = _hues(mean, without)
    size = np.linalg.norm(hues, axis=1)
    rims = [_rims(_changes(mean, one, quiet)) for one in (_normed(hues), _directions(mean))]
    clear = np.min([np.roll(lit, turn) for turn in range(-NEAR_SHADOW, NEAR_SHADOW + 1)], axis=0)
    trust = np.concatenate([(size / (size + HUE)) ** 2, clear]) + 1e-3
    one, none = np.ones(RAYS), np.zeros(RAYS)
    design = np.stack([np.tile(COS, 2), np.tile(SIN, 2), np.append(one, none), np.append(none, one)])
    measured = np.concatenate(rims)
    answer = np.array([0.0, 0.0, float(np.median(rims[0])), float(np.median(rims[1]))])
    for _ in range(15):
        apart = measured - answer @ design
        weights = trust / (1.0 + (apart / 0.03) ** 2) ** 2
        normal = (design * weights) @ design.T + 1e-6 * np.eye(4)
        answer = answer + np.linalg.solve(normal, (design * weights) @ apart)
    return float(answer[0]), float(answer[1]), float(answer[3])


def _levelled(views: Sequence[View], centres: Array, radii: Array, outline: Outline) -> Outline:
    """Return the outline with its radii moved to where a fit sees the rims of discs at known places."""
    for _ in range(3):
        apart = [
            ray_distances(view.patch, (x, y), r, outline) / r
            for view, (x, y), r in zip(views, centres, radii, strict=True)
        ]
        moved = np.clip(outline.radii + np.median(apart, axis=0), 0.8, 1.25)
        outline = replace(outline, radii=moved)
    return outline


def _changes(mean: Values, directions: Values, noise: float) -> Values:
    """Return the squared changes of mean rays (RAYS, n - 2) along one direction of colour for each."""
    told = np.matmul(mean[:, :, :3], directions[:, :, None])
    return changes(np.maximum.accumulate(told, axis=1), noise)


def _mean(pictures: Sequence[Values], centres: Array, radii: Array) -> Values:
    """Return what rays meet on average (RAYS, n, c), at `PARTS` of the radius."""
    rays = [look(one, x, y, r * PARTS) for one, (x, y), r in zip(pictures, centres, radii, strict=True)]
    return np.asarray(np.mean(rays, axis=0), dtype=np.float32)


def _between(rays: Values, ends: tuple[float, float]) -> Array:
    """Return the mean colour (RAYS, 3) of a part of the rays."""
    part = (ends[0] <= PARTS) & (ends[1] >= PARTS)
    return np.asarray(rays[:, part, :3].mean(axis=1), dtype=np.float64)


def _directions(mean: Values) -> Values:
    """Return the change from inside to outside (RAYS, 3), of length 1."""
    change = _between(mean, OUTSIDE) - _between(mean, INSIDE)
    # Neighbours look alike: what is left of the noise must not turn a faint change.
    change = np.mean([np.roll(change, turn, axis=0) for turn in (-1, 0, 1)], axis=0)
    return _normed(change)


def _hues(mean: Values, without: Values) -> Array:
    """Return the part of the change from inside to outside (RAYS, 3) that is none in light alone.

    Less light moves a colour towards black, along the board's own colour: across that, a shadow has no rim.
    """
    board = _normed(_between(without, OUTSIDE)).astype(np.float64)
    change = _between(mean, OUTSIDE) - _between(mean, INSIDE)
    return np.asarray(change - (change * board).sum(axis=1, keepdims=True) * board)


def _normed(vectors: Array) -> Values:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=1, keepdims=True) + 1e-9), dtype=np.float32)


def _lit(mean: Values, without: Values) -> Array:
    """Return from 0 to 1 whether the board outside a ray has its light (RAYS,)."""
    light = _between(mean, BESIDE).sum(axis=1) / (_between(without, BESIDE).sum(axis=1) + 1.0)
    light /= np.quantile(light, 0.8)
    return np.asarray(np.clip((light - DIM) / (LIT - DIM), 0.0, 1.0))


def _rims(steps: Values) -> Array:
    """Return where each mean ray changes most (RAYS,), in radii."""
    places = PARTS[1:-1]
    near = steps * np.exp(-0.5 * ((places - 1.0) / 0.2) ** 2)
    peaks = places[np.argmax(near, axis=1)]
    for _ in range(3):
        window = np.exp(-0.5 * ((places - peaks[:, None]) / 0.12) ** 2) * steps
        peaks = (window @ places + 1e-9 * peaks) / (window.sum(axis=1) + 1e-9)
    return np.asarray(peaks, dtype=np.float64)
