"""On a board without grain a ball of the board's colour is followed, and not the shadow beside it."""

from __future__ import annotations

import numpy as np
import pytest

from irt.tracking.geometry import Lens, Pose, Size
from irt.tracking.learning import learn, scale_of
from irt.tracking.run import board_box
from irt.tracking.tracker import Tracker
from tracking import scene
from tracking.board import WOODS, Paint
from tracking.view import View

pytestmark = pytest.mark.slow

SIZE = Size(1.0, scene.EDGES_M[1] / scene.EDGES_M[0], scene.RADIUS_M / scene.EDGES_M[0])
VIEW = View.above(330.0, lean=(0.1, -0.12))
COUNT = 24


@pytest.mark.parametrize("low", [1.0, 2.2], ids=["shadow beside the ball", "long shadow"])
def test_the_ball_is_followed_and_not_its_shadow(low: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shadow was followed, or the marble not found."""
    monkeypatch.setitem(scene.MARBLES, "like", tuple(np.array(WOODS["white"])))
    phase = np.pi * np.arange(COUNT) / COUNT
    places = 0.28 * np.column_stack([np.cos(phase), np.sin(phase)])
    look = scene.Look("like", light=(0.8 * low, 0.6 * low, 1.0), ambient=0.35, highlight=0.0, noise=1.5)
    shown = scene.Scene(
        VIEW, Paint("white", grain=0.0, lines=0, holes=0), look, places, np.zeros((COUNT, 2)), seed=6
    )
    pictures, truths = zip(*shown.frames(), strict=True)
    lens = Lens(VIEW.matrix, VIEW.distortion, (VIEW.width, VIEW.height), 0.1)
    pose = Pose.of(lens, shown.corners(), SIZE.corners, SIZE.radius)
    learned = learn(pictures, pose, board_box(shown.corners(), pose, lens.size))
    tracker = Tracker(learned, scale_of(pose, learned.finder.middle))
    if learned.first is not None:
        tracker.expect(*learned.first)
    seen = [tracker.see(picture) for picture in pictures]
    apart = np.array(
        [
            np.hypot(one.x - true.pixel[0], one.y - true.pixel[1])
            for one, true in zip(seen, truths, strict=True)
        ]
    )
    assert np.mean(apart < 0.25 * learned.radius) > 0.9
    assert not (apart > learned.radius).any()
    assert learned.shadow < 0.5
