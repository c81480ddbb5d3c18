"""A board that tilts is laid in one place, as a wide lens has it, and places go there and back."""

from __future__ import annotations

import numpy as np
import pytest

from irt.tracking.geometry import Lens, Pose, Size
from irt.tracking.stabilised import Stabilised
from tracking.view import View, turned

SIZE = Size(1.0, 231 / 276, 6.85 / 276)
VIEW = View.above(230.0, focal=320.0, lean=(0.3, -0.2), lens=(-0.15, 0.02), size=(320, 240))
LENS = Lens(VIEW.matrix, VIEW.distortion, (VIEW.width, VIEW.height), 0.1)
FLAT = np.column_stack([SIZE.corners, np.zeros(4)])
#: Board edges from one printed line to the next.
PERIOD = 0.06


def pose(tilt: np.ndarray) -> Pose:
    seen = VIEW.project(0.276 * FLAT)
    level = Pose.of(LENS, seen, SIZE.corners, SIZE.radius)
    return Pose(LENS, level.rotation @ turned(tilt), level.origin, SIZE.radius)


def drawn(board: Pose) -> np.ndarray:
    """Draw lines printed on a board, by the place that each pixel shows."""
    down, right = np.mgrid[: VIEW.height, : VIEW.width]
    places = board.surface.positions(np.column_stack([right.ravel(), down.ravel()]).astype(float))
    level = 130.0 + 60.0 * np.sin(2 * np.pi * places / PERIOD).sum(axis=1) / 2.0
    return np.repeat(np.rint(level).astype(np.uint8).reshape(VIEW.height, VIEW.width, 1), 3, axis=2)


TILTS = 0.09 * np.array([[0.7, 0.3], [-1.0, 0.2], [0.4, 1.0], [0.1, -0.9]])


def inside() -> tuple[slice, slice]:
    """Return the pixels well within the board at all tilts."""
    x, y = VIEW.project(0.276 * 0.8 * FLAT).T
    middle = [float(one.mean()) for one in (x, y)]
    return slice(int(middle[1]) - 50, int(middle[1]) + 50), slice(int(middle[0]) - 60, int(middle[0]) + 60)


def test_what_is_printed_stays_in_its_place() -> None:
    boards = [pose(tilt) for tilt in TILTS]
    pictures = [drawn(board) for board in boards]
    level = pose(np.zeros(2))
    laid = Stabilised.of(pictures, boards, level, SIZE).pictures
    wanted = drawn(level)[inside()].astype(float)
    moved = np.array([np.abs(one[inside()] - wanted).mean() for one in pictures])
    left = np.array([np.abs(one[inside()] - wanted).mean() for one in laid])
    assert moved.min() > 4.0
    assert (left < 0.25 * moved).all()


def test_pictures_without_a_board_are_left_out_but_for_the_first() -> None:
    boards = [pose(tilt) for tilt in TILTS]
    pictures = [drawn(board) for board in boards]
    sample = Stabilised.of(pictures, [None, boards[1], None, boards[3]], pose(np.zeros(2)), SIZE)
    assert len(sample.pictures) == 3
    np.testing.assert_array_equal(sample.pictures[0], pictures[0])


def test_places_go_there_and_back() -> None:
    boards = [pose(tilt) for tilt in TILTS]
    sample = Stabilised.of([drawn(board) for board in boards], boards, pose(np.zeros(2)), SIZE)
    ((x, y),) = sample.to_stabilised([(80.0, 60.0)])
    assert np.hypot(x - 80.0, y - 60.0) > 0.5
    assert sample.to_taken((x, y)) == pytest.approx((80.0, 60.0), abs=0.01)
