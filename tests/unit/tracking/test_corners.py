"""Corners as a user gives them, and the geometry that they make."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.errors import IrtError
from irt.tracking.corners import checked, ordered
from irt.tracking.geometry import Lens, Plane, Pose, Size
from tracking.view import View, turned

SIZE = Size(1.0, 231 / 276, 6.85 / 276)
CORNERS = [(100.0, 80.0), (500.0, 85.0), (495.0, 420.0), (105.0, 410.0)]


def lens_of(view: View) -> Lens:
    return Lens(view.matrix, view.distortion, (view.width, view.height), 0.1)


def seen_corners(view: View) -> np.ndarray:
    return view.project(np.column_stack([SIZE.corners * 0.276, np.zeros(4)]))


def test_right_corners_are_taken() -> None:
    np.testing.assert_array_equal(checked(CORNERS, SIZE), CORNERS)


@pytest.mark.parametrize(
    ("order", "said"),
    [
        ([0, 3, 2, 1], "anticlockwise"),
        ([0, 2, 1, 3], "cross"),
        ([1, 2, 3, 0], "begin one corner later"),
        ([0, 1, 2], "expected four"),
    ],
)
def test_wrong_order_is_said(order: list[int], said: str) -> None:
    with pytest.raises(IrtError, match=said):
        checked([CORNERS[one] for one in order], SIZE)


def test_a_board_on_its_side_is_turned() -> None:
    upright = np.array([(100.0, 80.0), (400.0, 80.0), (400.0, 480.0), (100.0, 480.0)])
    np.testing.assert_array_equal(ordered(upright, SIZE), np.roll(upright, -1, axis=0))


@given(
    lean=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    turn=st.floats(-3.0, 3.0),
    bend=st.floats(-0.25, 0.1),
    place=st.tuples(st.floats(-0.45, 0.45), st.floats(-0.38, 0.38)),
)
def test_a_calibrated_lens_gives_the_point_of_contact(lean, turn, bend, place) -> None:
    """The ray through the middle of a ball meets the plane of middles, wherever the camera is."""
    view = View.above(330.0, lean=lean, turn=turn, lens=(bend, 0.0))
    pose = Pose.of(lens_of(view), seen_corners(view), SIZE.corners, SIZE.radius)
    pixel = view.project(np.array([[place[0] * 0.276, place[1] * 0.276, 0.00685]]))
    np.testing.assert_allclose(pose.positions(pixel)[0], place, atol=1e-4)
    np.testing.assert_allclose(pose.pixels(np.array([place])), pixel, atol=0.05)


def test_without_a_lens_height_moves_the_marble_outwards_by_what_the_page_says() -> None:
    view = View.above(330.0)
    plane = Plane.of(seen_corners(view), SIZE)
    place = np.array([[0.4, -0.3]])
    pixel = view.project(np.column_stack([place * 0.276, [0.00685]]))
    height = np.linalg.norm(view.eye)
    np.testing.assert_allclose(plane.positions(pixel), place * height / (height - 0.00685), rtol=1e-3)


def test_a_ball_is_as_large_as_the_geometry_says() -> None:
    view = View.above(330.0, lean=(0.3, 0.1))
    pose = Pose.of(lens_of(view), seen_corners(view), SIZE.corners, SIZE.radius)
    away = np.linalg.norm(view.eye - [0.0, 0.0, 0.00685])
    pixel = tuple(view.project(np.array([[0.0, 0.0, 0.00685]]))[0])
    assert pose.radius_at(pixel) == pytest.approx(view.focal * 0.00685 / away, rel=1e-3)
    plane = Plane.of(seen_corners(view), SIZE)
    assert plane.radius_at(pixel) == pytest.approx(pose.radius_at(pixel), rel=0.05)


def test_tilt_is_what_turns_the_board() -> None:
    """A tilt about x lifts what lies at positive y, as in the recordings' convention."""
    assert (turned(np.array([0.1, 0.0])) @ [0.0, 1.0, 0.0])[2] > 0
    assert (turned(np.array([0.0, 0.1])) @ [1.0, 0.0, 0.0])[2] < 0
