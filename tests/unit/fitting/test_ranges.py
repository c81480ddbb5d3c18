"""What the ranges of ``rig.toml`` mean to both fits: least squares, and the filter of a diagnosis."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from irt.fitting.least_squares import least_squares
from irt.fitting.problem import Problem
from irt.segments import segments

TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])
TRACKER = 3e-4
#: As in `test_grey_box`; white push and noise of the tracker, no restitution.
NOISE = np.array([TRACKER, 1e-5, 0.1, 1e-5, 1e-5, 0.2, 0.1, *[0.0] * 6, 0.1])


def about(value, factor, place):
    """Return a range, its ends a factor apart, with the value at a place: 0 is the low end, 1 the high."""
    low = value / factor**place
    return low, low * factor


def by_least_squares(rig):
    return least_squares(rig, starts=2).model.values


def by_filter(rig):
    """Return the values at the top of the filter's posterior, begun in the middle of the ranges."""
    problem = Problem.of(rig, segments(rig), time_scale=TRUTH[3])
    middle = [math.sqrt(low * high) if low else 0.5 * high for low, high in rig.ranges.values()]
    middle[3] = TRUTH[3]
    (top,) = problem.ascend(np.array([middle]), NOISE[None], iterations=40)
    return top.values


METHODS = pytest.mark.parametrize("fitted", [by_least_squares, by_filter])


@METHODS
@pytest.mark.parametrize("factor", [1.02, 1.3, 10.0])
@pytest.mark.parametrize("place", [0.5, 1.0, 1.3])
def test_what_recordings_decide_is_found_in_a_range_at_its_end_and_a_little_outside(
    planted, fitted, factor, place
):
    rig = planted(3, noise=TRACKER, stamped=True)
    ranges = {
        "gear_x": about(TRUTH[0], factor, place),
        "gear_y": about(TRUTH[1], factor, 1.0 - place),
        "observation_scale": about(TRUTH[4], 1.001, 0.5),
    }
    found = fitted(replace(rig, ranges={**rig.ranges, **ranges}))
    np.testing.assert_allclose(found[:2], TRUTH[:2], rtol=0.03)


@METHODS
@pytest.mark.parametrize("ends", [(0.99, 1.01), (1.19, 1.21), (0.8, 1.0)])
def test_what_recordings_leave_open_stays_in_its_range(planted, fitted, ends):
    """Away from the rims the scale of the picture is open, and its product with a gear is not."""
    rig = planted(3, noise=TRACKER, stamped=True)
    found = fitted(replace(rig, ranges={**rig.ranges, "observation_scale": ends}))
    assert ends[0] - 1e-3 <= found[4] <= ends[1] + 1e-3
    np.testing.assert_allclose(found[4] * found[:2], TRUTH[4] * TRUTH[:2], rtol=0.02)


@METHODS
@pytest.mark.parametrize("ends", [(0.99, 1.01), (0.9, 1.1)])
def test_no_missing_physics_takes_a_value_further_from_its_range_than_that_is_wide(planted, fitted, ends):
    """A board that leans, which the model lacks; a larger picture with smaller gears hides some of it."""
    lean = {"name": "tilt_bias", "bias_x_rad": 0.004, "bias_y_rad": -0.003}
    rig = planted(3, noise=TRACKER, stamped=True, effects=[lean])
    found = fitted(replace(rig, ranges={**rig.ranges, "observation_scale": ends}))
    factor = ends[1] / ends[0]
    assert ends[0] / factor * (1.0 - 1e-9) <= found[4] <= ends[1] * factor * (1.0 + 1e-9)


def test_a_friction_that_is_known_is_held_beside_any_gear(planted):
    """With a narrow range it is not traded against gears that are ten times smaller than the ranges allow."""
    truth = TRUTH * [0.2, 0.2, 1.0, 1.0, 1.0]
    rig = planted(2, noise=3e-3, stamped=True, truth=truth)
    ranges = {"rolling_friction": (0.00039, 0.00041), "observation_scale": (1.04, 1.06)}
    found = by_least_squares(replace(rig, ranges={**rig.ranges, **ranges}))
    assert found[2] == pytest.approx(4e-4, rel=0.05)
