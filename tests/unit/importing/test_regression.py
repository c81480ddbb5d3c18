from __future__ import annotations

import numpy as np
import pytest

from irt.importing.regression import robust_fit, sandwich, time_blocks


def test_outliers_do_not_count_and_noise_of_a_regressor_is_no_attenuation() -> None:
    rng = np.random.default_rng(0)
    truth = rng.standard_normal(4000)
    target = 3.0 * truth + 0.1 * rng.standard_normal(truth.size)
    target[::20] += 30.0
    seen = truth + 0.3 * rng.standard_normal(truth.size)
    design = np.column_stack([seen, np.ones(truth.size)])
    plain, _ = robust_fit(design, target, np.zeros(2))
    corrected, _ = robust_fit(design, target, np.array([0.09, 0.0]))
    assert plain[0] < 2.85
    assert corrected[0] == pytest.approx(3.0, abs=0.1)


def test_standard_errors_hold_for_errors_that_last() -> None:
    rng = np.random.default_rng(1)
    times = np.arange(3000) / 50.0
    found, stated = [], []
    for _ in range(200):
        # Noise and regressor that stay alike for half a second.
        noise, regressor = (
            np.convolve(rng.standard_normal(3100), np.ones(25), "valid")[:3000] for _ in (0, 1)
        )
        design = np.column_stack([regressor, np.ones(times.size)])
        coefficients, weights = robust_fit(design, 2.0 * regressor + noise, np.zeros(2))
        left = 2.0 * regressor + noise - design @ coefficients
        covariance = sandwich(design, weights, left, time_blocks([times]), np.zeros(2))
        found.append(coefficients[0])
        stated.append(np.sqrt(covariance[0, 0]))
    assert np.mean(stated) == pytest.approx(np.std(found), rel=0.25)


def test_blocks_change_with_time_and_with_the_run() -> None:
    blocks = time_blocks([np.array([0.0, 1.9, 2.1]), np.array([100.0, 100.1])])
    assert blocks.tolist() == [0.0, 0.0, 1.0, 2.0, 2.0]
