"""Baseline: residual tests for missing physics (Ljung, System Identification, 1999, 16.6).

The residuals of a true model are white and uncorrelated with the commands. Both properties are tested with
chi-squared statistics, at 95 % together, like the bands of MATLAB's ``resid``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.proof.baselines.entry import Entry, Task
from irt.residual import evaluate

Array = NDArray[np.float64]

TITLE = "residual tests at 95 %"
LAGS = 25
LEVEL = 0.05


def enter(task: Task) -> Entry:
    """Test whether the residuals of the base model are noise; the tests name and predict nothing."""
    runs = evaluate(task.base, task.rig.recordings).runs
    residuals = [
        run.free_prediction - recording.marble
        for run, recording in zip(runs, task.rig.recordings, strict=True)
    ]
    inputs = [recording.knobs for recording in task.rig.recordings]
    detected = min(white(residuals), unrelated(residuals, inputs)) < LEVEL / 2
    return Entry(detected=bool(detected))


def white(residuals: list[Array]) -> float:
    """Return the p-value of residuals (n, 2) of each run being white (Ljung and Box, 25 lags, both axes)."""
    from scipy.stats import chi2  # noqa: PLC0415

    statistic = 0.0
    for axis in range(2):
        kept = [_centred(one[:, axis]) for one in residuals]
        squares = sum(float(one @ one) for one in kept)
        rows = sum(len(one) for one in kept)
        for lag in range(1, LAGS + 1):
            product = sum(float(one[lag:] @ one[:-lag]) for one in kept if len(one) > lag)
            statistic += rows * (rows + 2) / (rows - lag) * (product / max(squares, 1e-300)) ** 2
    return float(chi2.sf(statistic, 2 * LAGS))


def unrelated(residuals: list[Array], inputs: list[Array]) -> float:
    """Return the p-value of residuals (n, 2) uncorrelated with the commands of 25 rows before (n, 2)."""
    from scipy.stats import chi2  # noqa: PLC0415

    past = np.concatenate([_lagged(one) for one in inputs])
    statistic, freedom = 0.0, 0
    span = np.linalg.qr(past)[0][:, : np.linalg.matrix_rank(past)]
    for axis in range(2):
        error = np.concatenate([_centred(one[:, axis]) for one in residuals])
        along = span.T @ error
        statistic += float(along @ along) / max(float(error.var()), 1e-300)
        freedom += span.shape[1]
    return float(chi2.sf(statistic, freedom))


def _centred(values: Array) -> Array:
    """Return values minus their mean; zero for a row without a marble."""
    return np.nan_to_num(values - np.nanmean(values))


def _lagged(knobs: Array) -> Array:
    """Return the commands of this row and 24 before, (n, 50); zero before row 0."""
    padded = np.concatenate([np.zeros((LAGS - 1, 2)), knobs])
    return np.concatenate([padded[LAGS - 1 - lag : len(padded) - lag] for lag in range(LAGS)], axis=1)
