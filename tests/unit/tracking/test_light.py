"""Shadows that pass over the board are light, and no marble."""

from __future__ import annotations

import numpy as np
import pytest
from rendered import CORNERS, HEIGHT, RADIUS, WIDTH, path, rendered

from irt.tracking.blob_detector import Box
from irt.tracking.geometry import Plane, Size
from irt.tracking.learning import learn, scale_of
from irt.tracking.light import Light, is_steady
from irt.tracking.separation import Clue
from irt.tracking.tracker import Tracker

SIZE = Size(1.0, 0.8, RADIUS / 178)
PLANE = Plane.of(CORNERS, SIZE)
WHOLE = Box(0, 0, WIDTH, HEIGHT)
BOARD = Box(34, 24, 205, 158)


def banded(picture: np.ndarray, index: int) -> np.ndarray:
    """Return a picture over which two shadows pass, one each way."""
    down, right = np.mgrid[:HEIGHT, :WIDTH]
    light = np.ones((HEIGHT, WIDTH))
    for along, speed in ((right + 0.5 * down, 7.0), (down - 0.3 * right, -5.0)):
        away = np.abs((along - speed * index) % 260 - 130) - 25
        light *= 1.0 - 0.4 / (1.0 + np.exp(np.clip(away / 2.0, -30, 30)))
    return np.rint(picture * light[..., None]).astype(np.uint8)


def run(count: int, seed: int) -> tuple[np.ndarray, list[np.ndarray]]:
    places = path(count, seed=seed)
    return places, [banded(rendered(place, seed=index), index) for index, place in enumerate(places)]


def test_a_picture_is_brought_to_the_usual_light() -> None:
    light = Light(rendered(), RADIUS)
    even = light.evened(banded(rendered(), 3), WHOLE)[BOARD.slices].astype(float)
    apart = np.abs(even - rendered()[BOARD.slices])
    # But for the shadows' own edges.
    assert np.quantile(apart.mean(axis=2), 0.8) < 8.0


def dimmed(picture: np.ndarray, light: float) -> np.ndarray:
    return np.rint(light * picture).astype(np.uint8)


def test_a_lamp_that_flickers_is_steady_light_and_one_that_dims_or_a_shadow_is_not() -> None:
    light = Light(rendered(), RADIUS)
    assert is_steady([dimmed(rendered(seed=3), share) for share in (0.97, 0.98, 1.0)], light, BOARD)
    assert not is_steady([dimmed(rendered(seed=3), share) for share in (0.85, 0.9, 1.0)], light, BOARD)
    assert not is_steady([banded(rendered(), index) for index in range(6)], light, BOARD)


@pytest.mark.slow
def test_a_marble_is_learned_and_followed_while_the_exposure_drifts() -> None:
    """What the light did to the board counted as noise, in which the marble did not stand out."""
    shares = 1.0 - 0.15 * np.sin(np.pi * np.arange(40) / 39) ** 2
    places = path(40, seed=1)
    pictures = [
        dimmed(rendered(place, seed=index), share)
        for index, (place, share) in enumerate(zip(places, shares, strict=True))
    ]
    learned = learn(pictures, PLANE, WHOLE)
    tracker = Tracker(learned, scale_of(PLANE, learned.finder.middle))
    apart = np.array([(one.x, one.y) for one in map(tracker.see, pictures)]) - places
    assert np.isfinite(apart).all()
    assert np.sqrt(np.mean(apart**2)) < 0.3


@pytest.mark.slow
def test_a_marble_is_followed_through_shadows_that_pass() -> None:
    """Everything on the board differed from the median of the pictures, and the run was refused."""
    _, pictures = run(40, 1)
    for clue in (None, Clue(places=(tuple(path(40, seed=1)[0]),))):
        learned = learn(pictures, PLANE, WHOLE, clue)
        tracker = Tracker(learned, scale_of(PLANE, learned.finder.middle))
        places, shown = run(40, 4)
        apart = np.array([(one.x, one.y) for one in map(tracker.see, shown)]) - places
        assert np.isfinite(apart).mean() > 0.95
        assert np.sqrt(np.nanmean(apart**2)) < 0.3
        # The edge of a shadow that passes over the marble pulls at it, but none is followed.
        assert np.nanmax(np.abs(apart)) < RADIUS / 3
