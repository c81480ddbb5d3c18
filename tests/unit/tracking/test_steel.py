"""Steel on dark wood, with its shadow beside it: the hard run of the benches whose rims lead to two discs."""

from __future__ import annotations

import numpy as np
import pytest

from irt.tracking.corners import find_corners, ordered
from irt.tracking.geometry import Lens, Pose, Size
from irt.tracking.learning import learn, scale_of
from irt.tracking.run import SAMPLE, board_box
from irt.tracking.tracker import Tracker
from tracking.scene import EDGES_M, RADIUS_M
from tracking.sets import hard

SIZE = Size(1.0, EDGES_M[1] / EDGES_M[0], RADIUS_M / EDGES_M[0])


@pytest.mark.slow
def test_its_disc_is_not_led_to_its_shadow_and_its_error_is_that_of_a_mirror() -> None:
    scene = hard(305, 500)
    lens = Lens(scene.view.matrix, scene.view.distortion, (scene.view.width, scene.view.height), 0.0)
    frames = [scene.frame(int(index)) for index in np.linspace(0, 499, SAMPLE)]
    pictures = [picture for picture, _ in frames]
    corners = ordered(find_corners(pictures[0], lens), SIZE)
    pose = Pose.of(lens, corners, SIZE.corners, SIZE.radius)
    learned = learn(pictures, pose, board_box(corners, pose, lens.size))
    tracker = Tracker(learned, scale_of(pose, learned.finder.middle))
    offsets = np.array(
        [
            (found.x - truth.pixel[0], found.y - truth.pixel[1])
            for picture, truth in frames
            if truth.visible == 1.0
            for found in [tracker.match(picture, *truth.pixel)]
        ]
    )
    assert np.hypot(*np.median(offsets, axis=0)) < 0.3
    assert learned.appearance.error == pytest.approx(0.1 * learned.radius, rel=0.1)
