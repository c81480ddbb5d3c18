import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.paper.errors import (
    Summary,
    combination_error,
    combinations,
    median_interval,
    meets_rim,
    parameter_error,
)
from irt.tuning.drive import Drive

DRIVE = Drive.paper()
TRUTH = np.array([0.04, 0.03, 2e-4, 30.0, 1.0])


def test_errors_are_in_shares_of_the_ranges():
    off = TRUTH + np.array([0.01, 0.0, 0.0, 5.0, 0.04])
    assert parameter_error(DRIVE, off, TRUTH) == pytest.approx((0.1 + 0.1 + 0.1) / 5)


def test_the_symmetry_costs_parameters_and_no_combination():
    moved = TRUTH * np.array([2.25, 2.25, 2.25, 1 / 1.5, 1.0])
    np.testing.assert_allclose(combinations(moved), combinations(TRUTH))
    assert combination_error(DRIVE, moved, TRUTH) == pytest.approx(0.0, abs=1e-12)
    assert parameter_error(DRIVE, moved, TRUTH) > 0.1


def test_combinations_are_in_shares_of_their_ranges():
    off = TRUTH + np.array([0.0, 0.0, 0.0, 0.0, 0.04])
    assert combination_error(DRIVE, off, TRUTH) == pytest.approx(0.1 / 4)


def test_who_meets_the_rim():
    parameters = np.array([[0.08, 0.08, 1e-4, 30.0, 0.9], [0.01, 0.01, 1e-4, 8.0, 1.1]])
    observed = DRIVE.simulate(parameters)[0]
    assert meets_rim(DRIVE, parameters, observed).tolist() == [True, False]


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=60))
def test_intervals_hold_what_they_are_about(values):
    summary = Summary.of(np.array(values))
    assert summary.low <= summary.mean <= summary.high
    assert summary.p05 <= summary.median <= summary.p95 <= summary.worst
    low, high = median_interval(np.array(values))
    assert low <= np.median(values) <= high


def test_the_interval_of_a_median_holds_it_as_often_as_it_says():
    random = np.random.default_rng(0)
    held = [
        low <= 0.0 <= high for low, high in (median_interval(random.standard_normal(50)) for _ in range(2000))
    ]
    assert 0.93 < np.mean(held) < 0.99
