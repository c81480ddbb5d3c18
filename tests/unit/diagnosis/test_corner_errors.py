"""Small effects of the camera that errors of the tracker's corners could make."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from irt import effects
from irt.diagnosis.calibration import is_within_error
from irt.engine import rollouts, seen
from irt.rig import Board, Marble

NOISE = 0.001
#: A board whose corners are 0.6 edges from its centre.
RIG = SimpleNamespace(board=Board(edge_x_m=0.3, edge_y_m=0.198997), marble=Marble())
#: The 99 % point of a chi-squared variable of eight degrees of freedom is 20.09; of four equal shifts:
MOST = math.sqrt(20.09) / 2.0 * NOISE

angles = st.floats(0.0, 2.0 * math.pi)


@given(st.floats(1e-3, 2.0), angles)
def test_a_shift_is_an_error_of_the_corners_up_to_two_noises(part, angle):
    assume(abs(part - 1.0) > 0.01)
    shift = {"x_edges": part * MOST * math.cos(angle), "y_edges": part * MOST * math.sin(angle)}
    assert is_within_error("camera_offset", shift, RIG, NOISE) is (part < 1.0)


@given(st.floats(0.01, 2.0))
def test_a_rotation_moves_the_corners_by_their_distance(part):
    assume(abs(part - 1.0) > 0.01)
    assert is_within_error("camera_rotation", {"angle_rad": part * MOST / 0.6}, RIG, NOISE) is (part < 1.0)


@given(angles)
def test_a_tilt_moves_the_corners_by_the_square_of_their_distance(angle):
    # Along the corners' diagonals they move by 0.36 edges per slope at most.
    slope = {"slope_x": math.cos(angle), "slope_y": math.sin(angle), "distance_edges": 2.0}
    small, large = (
        {**slope, **{f"slope_{axis}": size * slope[f"slope_{axis}"] for axis in "xy"}}
        for size in (MOST, 0.05)
    )
    assert is_within_error("perspective", small, RIG, NOISE)
    assert not is_within_error("perspective", large, RIG, NOISE)


@given(st.floats(1e-5, 0.1))
def test_no_corners_distort_a_lens(k):
    assert not is_within_error("lens_distortion", {"k_per_edge2": k}, RIG, NOISE)


@pytest.mark.parametrize("info", effects(), ids=lambda info: info.name)
def test_what_does_not_move_the_picture_is_no_error_of_the_corners(info):
    weak = {one.name: one.neutral + 1e-6 * (one.high - one.low) for one in info.parameters}
    moves = info.name in {"camera_offset", "camera_rotation", "perspective"}
    assert is_within_error(info.name, weak, RIG, NOISE) is moves
    assert not is_within_error(info.name, {}, RIG, NOISE)


def test_places_are_seen_as_in_a_rollout():
    camera = [
        {"name": "camera_offset", "x_edges": 0.01, "y_edges": -0.02},
        {"name": "camera_rotation", "angle_rad": 0.3},
        {"name": "lens_distortion", "k_per_edge2": 0.1},
        {"name": "perspective", "slope_x": 0.1, "slope_y": -0.2, "distance_edges": 2.0},
    ]
    parameters = [[0.05, 0.05, 4e-4, 15.0, 1.0]]
    commands = np.tile([0.5, -0.3], (12, 1))
    (path,) = rollouts(parameters, commands, rig=RIG, start=[0.1, 0.05])
    start = seen(path[:1], RIG, camera)
    (observed,) = rollouts(parameters, commands, rig=RIG, start=start, effects=camera)
    assert np.ptp(path, axis=0).min() > 0.05
    np.testing.assert_allclose(observed, seen(path, RIG, camera), atol=1e-9)
