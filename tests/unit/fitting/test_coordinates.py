from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.fitting.coordinates import FRICTION, REACH, SCALE, TIME, Coordinates, along_time
from irt.rig import PARAMETERS, RANGES

POSITIVE = np.ones(5)
WITHIN = st.tuples(
    st.floats(0.002, 0.1), st.floats(0.002, 0.1), st.floats(0.0, 0.001), st.floats(1, 50), st.floats(0.8, 1.2)
).map(np.array)


@given(WITHIN)
def test_parameters_come_back(parameters):
    coordinates = Coordinates.of(RANGES, POSITIVE)
    np.testing.assert_allclose(
        coordinates.to_p(coordinates.to_z(parameters)), parameters, rtol=1e-12, atol=1e-18
    )


@given(WITHIN, st.floats(0.5, 2.0))
def test_a_move_along_the_first_symmetry_keeps_what_recordings_fix(parameters, factor):
    coordinates = Coordinates.of({name: (0.0, 4.0 * high) for name, (_, high) in RANGES.items()}, POSITIVE)
    moved = coordinates.to_p(along_time(coordinates.to_z(parameters), factor * parameters[TIME]))
    assert moved[TIME] == pytest.approx(factor * parameters[TIME])
    assert moved[SCALE] == pytest.approx(parameters[SCALE])
    np.testing.assert_allclose(
        moved[:3] * moved[TIME] ** 2, parameters[:3] * parameters[TIME] ** 2, rtol=1e-9, atol=1e-15
    )


@given(WITHIN)
def test_the_axes_hold_the_symmetries(parameters):
    """Along both of them the friction relative to the gears stands still."""
    coordinates = Coordinates.of(RANGES, POSITIVE)
    z = coordinates.to_z(parameters)
    before = coordinates.to_p(z)
    for axis, fixed in ((TIME, lambda p: p[:3] * p[TIME] ** 2), (SCALE, lambda p: p[:3] * p[SCALE])):
        after = coordinates.to_p(z + 0.01 * coordinates.axes[axis])
        np.testing.assert_allclose(fixed(after), fixed(before), rtol=1e-9, atol=1e-15)


@given(WITHIN)
def test_derivatives_are_those_of_the_map(parameters):
    coordinates = Coordinates.of(RANGES, POSITIVE)
    z = coordinates.to_z(parameters)
    numerical = np.array(
        [(coordinates.to_p(z + step) - coordinates.to_p(z - step)) / 2e-6 for step in 1e-6 * np.eye(5)]
    ).T
    derivative = coordinates.derivative(z)
    used = np.arange(5) != FRICTION  # at no friction one side is cut off
    np.testing.assert_allclose(derivative[:, used], numerical[:, used], rtol=1e-4, atol=1e-9)
    if parameters[FRICTION] > 1e-6:
        np.testing.assert_allclose(derivative, numerical, rtol=1e-3, atol=1e-9)


@given(st.lists(st.floats(-20, 20), min_size=5, max_size=5).map(np.array))
def test_whatever_a_step_proposes_stays_within_reach(z):
    coordinates = Coordinates.of(RANGES, POSITIVE)
    p = coordinates.to_p(coordinates.clip(z))
    high = np.array([RANGES[name][1] for name in PARAMETERS])
    assert (p >= 0.0).all()
    assert (p <= REACH * high * (1 + 1e-12)).all()
    assert p[TIME] >= 0.5
    np.testing.assert_allclose(coordinates.clip(coordinates.clip(z)), coordinates.clip(z), rtol=1e-12)


@given(WITHIN)
def test_nothing_is_in_excess_within_the_ranges(parameters):
    coordinates = Coordinates.of(RANGES, POSITIVE)
    excess, derivative = coordinates.excess(coordinates.to_z(parameters * (1 - 1e-9) + 1e-12))
    assert (np.abs(excess) < 1e-6).all()
    assert (np.abs(derivative) <= 1.0 / (0.1 * 1e-4)).all()


def test_excess_grows_outside_the_ranges_and_has_its_derivative():
    coordinates = Coordinates.of(RANGES, POSITIVE)
    z = coordinates.to_z(np.array([0.15, 0.05, 0.002, 60.0, 0.7]))
    excess, derivative = coordinates.excess(z)
    assert (excess[[0, 2, 3]] > 0.0).all()
    assert excess[1] == 0.0
    assert excess[SCALE] < 0.0
    numerical = np.array(
        [
            (coordinates.excess(z + step)[0] - coordinates.excess(z - step)[0]) / 2e-6
            for step in 1e-6 * np.eye(5)
        ]
    ).T
    np.testing.assert_allclose(derivative, numerical, rtol=1e-5, atol=1e-5)


def test_gears_of_the_other_sense():
    coordinates = Coordinates.of({**RANGES, "gear_x": (-0.1, 0.0)}, np.array([-1.0, 1, 1, 1, 1]))
    parameters = np.array([-0.05, 0.03, 0.0004, 20.0, 1.0])
    z = coordinates.to_z(parameters)
    np.testing.assert_allclose(coordinates.to_p(z), parameters)
    assert coordinates.derivative(z)[0, 0] == pytest.approx(-0.05)


def test_a_time_scale_from_stamps_is_held():
    coordinates = Coordinates.of(RANGES, POSITIVE, time_scale=72.5)
    for z in (np.zeros(5), np.full(5, 9.0)):
        assert coordinates.to_p(coordinates.clip(z))[TIME] == pytest.approx(72.5)
    assert (coordinates.axes[TIME] == np.eye(5)[TIME]).all()
