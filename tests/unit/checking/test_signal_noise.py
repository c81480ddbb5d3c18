"""Noise and resolution of a signal, planted and recovered."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.checking.signals import held_mask, noise_of_runs, resolution


def path(rows, period=60.0):
    return 0.3 * np.sin(2.0 * np.pi * np.arange(rows) / period)


@given(st.integers(0, 2**32), st.floats(3e-4, 5e-3), st.floats(25.0, 200.0))
@settings(max_examples=40, deadline=None)
def test_the_noise_on_a_smooth_path_comes_back(seed, noise, period):
    random = np.random.default_rng(seed)
    runs = [path(300, period) + noise * random.standard_normal(300) for _ in range(16)]
    # Six standard errors: 0.024 each with 16 recordings, and 0.046 with four.
    assert noise_of_runs(runs) == pytest.approx(noise, rel=0.15)


def test_jumps_and_gaps_do_not_count():
    random = np.random.default_rng(3)
    values = path(1000) + 0.001 * random.standard_normal(1000)
    values[::50] += 0.2
    values[random.random(1000) < 0.1] = np.nan
    assert noise_of_runs([values]) == pytest.approx(0.001, rel=0.25)


def test_an_axis_that_never_moves_has_no_noise():
    assert noise_of_runs([np.zeros(500)]) is None
    assert noise_of_runs([np.full(500, np.nan)]) is None


def test_an_idle_run_does_not_dilute_the_noise_of_others():
    random = np.random.default_rng(4)
    moving = path(600) + 0.002 * random.standard_normal(600)
    assert noise_of_runs([moving, np.zeros(5000)]) == pytest.approx(0.002, rel=0.15)


@given(st.floats(1e-4, 0.01), st.floats(-0.3, 0.3))
@settings(max_examples=40, deadline=None)
def test_the_step_of_rounding_comes_back(step, offset):
    values = offset + step * np.rint(path(3000, 373.7) / step)
    assert resolution([values]) == pytest.approx(step, rel=0.01)


def test_numbers_without_a_step_have_no_resolution():
    assert resolution([np.random.default_rng(0).standard_normal(500)]) is None
    assert resolution([np.ones(5)]) is None


def test_a_turning_point_seen_twice_is_not_held():
    # 5 rows a second, places of 0.0025: a parabola whose two highest rows are the same place.
    rows = np.arange(-10, 10)[:, None] + 0.5
    marble = np.rint(np.hstack([-0.01 * rows**2, -0.004 * rows**2]) / 0.0025) * 0.0025
    assert (marble[1:] == marble[:-1]).all(axis=1).any()
    assert not held_mask(marble).any()
