"""A marble nearly as bright as its board is enlarged and followed; where there is none, none is made up."""

from __future__ import annotations

import numpy as np
import pytest
from rendered import BOARD, CORNERS, HEIGHT, RADIUS, WIDTH, path, rendered

from irt.tracking.blob_detector import Box
from irt.tracking.contrast import Contrast
from irt.tracking.geometry import Plane, Size
from irt.tracking.learning import learn, scale_of
from irt.tracking.separation import NoMarbleError
from irt.tracking.tracker import Tracker

PLANE = Plane.of(CORNERS, Size(1.0, 0.8, RADIUS / 178))
BOX = Box(18, 8, 222, 172)
WHITER = tuple(one + 10 for one in BOARD)


@pytest.mark.slow
def test_a_marble_ten_levels_brighter_is_followed() -> None:
    places = path(24)
    pictures = [rendered(place, noise=1.5, seed=index, colour=WHITER) for index, place in enumerate(places)]
    tracker = Tracker(learn(pictures, PLANE, BOX), scale_of(PLANE, (WIDTH / 2, HEIGHT / 2)))
    seen = [tracker.see(picture) for picture in pictures]
    found = np.array([[one.x, one.y] for one in seen])
    assert np.isfinite(found).all()
    assert np.sqrt(((found - places) ** 2).sum(axis=1).mean()) < 0.4


def test_noise_alone_is_no_marble() -> None:
    with pytest.raises(NoMarbleError):
        learn([rendered(noise=1.5, seed=seed) for seed in range(12)], PLANE, BOX)


def test_noise_stays_and_the_marble_grows() -> None:
    contrast = Contrast(rendered(noise=0.0), BOX, RADIUS, None)
    picture = rendered((120.0, 90.0), noise=1.5, colour=WHITER)
    shown = contrast.evened(picture, Box(0, 0, WIDTH, HEIGHT)).astype(float)
    assert shown[90, 120].mean() - shown[90, 80].mean() == pytest.approx(10.0 * contrast.gain, rel=0.25)
    assert 0.7 < shown[60:80, 60:100].std(axis=(0, 1)).mean() / 1.5 < 1.4
