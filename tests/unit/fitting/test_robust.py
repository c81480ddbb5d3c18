from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.fitting import robust

RESIDUAL = st.floats(-1.0, 1.0)
SCALE = st.floats(1e-4, 1e-1)


@given(RESIDUAL, SCALE)
def test_the_weight_is_the_slope_of_the_loss_over_the_residual(residual, scale):
    step = 1e-6 * scale
    slope = (robust.loss(residual + step, scale) - robust.loss(residual - step, scale)) / (2.0 * step)
    assert slope == pytest.approx(robust.weight(residual, scale) * residual, rel=1e-4, abs=1e-3 / scale)


@given(RESIDUAL, RESIDUAL, SCALE)
def test_a_larger_residual_costs_more_and_weighs_less(one, other, scale):
    small, large = sorted((abs(one), abs(other)))
    assert robust.loss(small, scale) <= robust.loss(large, scale)
    assert robust.weight(small, scale) >= robust.weight(large, scale)


@given(RESIDUAL, SCALE)
def test_influence_is_bounded_and_has_its_slope(residual, scale):
    psi, slope = robust.influence(np.float64(residual), scale)
    assert abs(psi) <= scale
    step = 1e-6 * scale
    numerical = (
        robust.influence(residual + step, scale)[0] - robust.influence(residual - step, scale)[0]
    ) / (2 * step)
    assert slope == pytest.approx(numerical, abs=1e-5)


def test_scale_is_the_standard_deviation_of_normal_residuals_whatever_a_few_do():
    random = np.random.default_rng(0)
    residual = np.stack([0.01, 0.5] * random.standard_normal((4000, 2)), axis=0).T.reshape(2, 40, 100)
    known = np.ones((40, 100), dtype=bool)
    known[:, 90:] = False
    residual[:, ~known] = 0.0
    residual[:, ::10, :20] = 1e3
    np.testing.assert_allclose(robust.scale(residual, known), [0.01, 0.5], rtol=0.1)


@pytest.mark.parametrize("sd", [1e-4, 1e-3, 1e-2])
def test_the_trackers_noise_shows_in_the_recording_alone(sd):
    random = np.random.default_rng(1)
    time = np.linspace(0.0, 4.0 * np.pi, 400)
    smooth = 0.3 * np.stack([np.sin(time), np.cos(0.7 * time)], axis=1)
    observed = smooth + sd * random.standard_normal(smooth.shape)
    observed[::40] = 0.9
    observed[13:17] = np.nan
    assert robust.tracker_noise([SimpleNamespace(observed=observed)]) == pytest.approx(sd, rel=0.2)


def test_noise_of_next_to_no_rows_is_the_smallest_there_is():
    assert robust.tracker_noise([SimpleNamespace(observed=np.zeros((3, 2)))]) == robust.FINEST
