"""Regressions of the marble's acceleration on the tilt and of the tilt on the commands, with errors.

Acceleration by tilt is fitted in the weak form (`irt.importing.weak_form`). Noise of the tilt would bias its
gains towards zero; the known share is subtracted from the normal matrix (Fuller, "Measurement Error Models",
1987). Walls are outliers for Tukey's biweight. Standard errors are sandwich estimates over blocks of two
seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import deviation, noise_of
from irt.importing.regression import robust_fit, sandwich, time_blocks
from irt.importing.weak_form import Map, Run, Windows, fit_windows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A ball that rolls on a tilted plane accelerates by 5/7 g per radian [m/s^2].
ROLLING_GAIN = 5.0 / 7.0 * 9.81
#: Numbers of standard errors for a decided gain, and for a certain one. They exceed 2, because the search
#: over delays picks the best of hundreds.
DECIDED, SURE = 5.0, 10.0
#: Share of a variance that a law has to explain to be taken for its cause: more than half.
MOST_OF_IT = 0.5

#: Largest offset between clocks in the search [s], and largest dead time [s].
MOST_OFFSET_S = 0.6
MOST_DELAY_S = 1.0
#: Step of the coarse grid of delays [s]: less than the lag of any servo.
GRID_S = 0.02
#: Coarse grid of lags of an actuator [s].
_LAGS = (0.0, 0.03, 0.07, 0.15, 0.3)
#: Maximum number of fitted rows, and of those on the coarse grid.
_MOST_ROWS, _COARSE_ROWS = 12_000, 3_000
#: Minimum number of rows of a fit.
_FEWEST_ROWS = 50
#: Number of standard deviations above which a residual counts linearly: backlash and slow drifts are no
#: noise.
_LINEAR = 3.0
#: Half-width of the differences by which slopes over dead time and lag are taken [s].
_STEP_S = 0.004


def tilt_to_marble(runs: Sequence[Run], edges: tuple[float, float], *, search: bool) -> Map | None:
    """Fit the acceleration of the marble [m/s^2] by the tilt [rad].

    Parameters
    ----------
    runs : sequence of Run
        Stretches of one rig.
    edges : (float, float)
        Size of the area in which the marble's centre moves [m].
    search : bool
        Whether the tilt's clock may differ from the marble's by up to 0.6 s. Otherwise it is the same, and a
        small difference by filters is only estimated. `Map.delay` is the marble's stamp minus the tilt's
        stamp of the same time.

    Returns
    -------
    Map or None
        None without tilt or with too little free motion.
    """
    tilts = [run.tilt for run in runs if run.tilt is not None and np.isfinite(run.tilt).any()]
    windows = Windows.of(runs, edges) if tilts else None
    if windows is None:
        return None

    def regressors(delay: float) -> Array:
        return np.concatenate(
            [
                np.full((weak.count, 2), np.nan)
                if run.tilt is None
                else weak.smooth(_interpolated(run.stamps - delay, run.tilt_stamps, run.tilt))
                for run, weak in zip(windows.runs, windows.weak, strict=True)
            ]
        )

    together = np.concatenate(tilts)
    noises, scales = np.zeros(2), np.zeros(2)
    for axis, values in enumerate(together.T):
        if np.isfinite(values).any():
            noises[axis] = np.nan_to_num(noise_of(values))
            scales[axis] = np.nanstd(values)
    delays = np.arange(-MOST_OFFSET_S, MOST_OFFSET_S, GRID_S) if search else np.zeros(1)
    return fit_windows(windows, [(0.0, regressors)], delays, noises, scales)


def commands_to_marble(runs: Sequence[Run], edges: tuple[float, float]) -> Map | None:
    """Fit the acceleration of the marble [m/s^2] by the commands, where no tilt was measured.

    Returns
    -------
    Map or None
        None if no command changes or there is too little free motion.
    """
    scales = command_scales(runs)
    windows = Windows.of(runs, edges) if (scales > 0.0).any() else None
    if windows is None:
        return None

    def regressors(lag: float, delay: float) -> Array:
        return np.concatenate(
            [
                weak.smooth(run.commands.lagged(run.stamps - delay, lag))
                for run, weak in zip(windows.runs, windows.weak, strict=True)
            ]
        )

    delays = np.arange(-MOST_OFFSET_S, MOST_DELAY_S, GRID_S)
    families = [(lag, partial(regressors, lag)) for lag in _LAGS]
    return fit_windows(windows, families, delays, np.zeros(2), scales)


def commands_to_tilt(runs: Sequence[Run]) -> Map | None:
    """Fit the tilt [rad] by the commands: gains, dead time and lag by axis of the tilt.

    The dead time includes the offset between the clocks of commands and states, because these signals do not
    separate the two.

    Returns
    -------
    Map or None
        None without tilt, or if no command changes.
    """
    usable = [run for run in runs if run.tilt is not None and run.commands.stamps.size]
    scales = command_scales(runs)
    if not usable or not (scales > 0.0).any():
        return None
    chain = _Chain(usable, scales > 0.0)
    gains, errors = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    delays, delay_errors, lags, explained = (np.full(2, np.nan) for _ in range(4))
    for axis in (0, 1):
        fit = chain.fit(axis)
        if fit is not None:
            gains[axis, chain.active], errors[axis, chain.active] = fit[0], fit[1]
            delays[axis], delay_errors[axis], lags[axis], explained[axis] = fit[2:]
    return Map(gains, errors, delays, delay_errors, lags, explained, scales, int(chain.known.sum()))


class _Chain:
    """Regression of each axis of the tilt on the commands after a dead time and a lag."""

    def __init__(self, runs: Sequence[Run], active: Mask) -> None:
        stride = max(1, sum(len(run.stamps) for run in runs) // _MOST_ROWS)
        self.active = active
        self.runs = runs
        self.times = [run.tilt_stamps[::stride] for run in runs]
        self.tilt = np.concatenate([run.tilt[::stride] for run in runs if run.tilt is not None])
        self.blocks = time_blocks(self.times)
        everything = [np.arange(len(one)) for one in self.times]
        # Rows without an earlier command are excluded, for all delays that are tried.
        self.known = np.isfinite(self.lagged(MOST_DELAY_S, 0.0, everything)).all(axis=1)
        ends = np.cumsum([len(one) for one in self.times])[:-1]
        self.fine = [np.flatnonzero(part) for part in np.split(self.known, ends)]
        thin = max(1, int(self.known.sum()) // _COARSE_ROWS)
        self.coarse = [rows[::thin] for rows in self.fine]
        grid = np.arange(-MOST_OFFSET_S, MOST_DELAY_S, GRID_S)
        self.grid = [(float(delay), lag) for lag in _LAGS for delay in grid]
        self.designs = [self.lagged(delay, lag, self.coarse) for delay, lag in self.grid]

    def lagged(self, delay: float, lag: float, rows: Sequence[NDArray[np.intp]]) -> Array:
        """Return the changing commands after delay and lag, at these rows of each run."""
        parts = [
            run.commands.lagged(times[inside] - delay, lag)
            for run, times, inside in zip(self.runs, self.times, rows, strict=True)
        ]
        return np.asarray(np.concatenate(parts)[:, self.active])

    def values(self, axis: int, rows: Sequence[NDArray[np.intp]]) -> Array:
        """Return one axis of the tilt at these rows of each run."""
        begins = np.concatenate([[0], np.cumsum([len(one) for one in self.times])])[:-1]
        picked = np.concatenate([rows[run] + begins[run] for run in range(len(rows))])
        return np.asarray(self.tilt[picked, axis])

    def fit(self, axis: int) -> tuple[Array, Array, float, float, float, float] | None:
        """Return gains, their errors, dead time and its error, lag [s], and the explained share."""
        from scipy.optimize import minimize  # noqa: PLC0415

        rough, values = self.values(axis, self.coarse), self.values(axis, self.fine)
        seen, use = np.isfinite(rough), np.isfinite(values)
        if use.sum() < _FEWEST_ROWS or np.std(values[use]) < 1e-9:
            return None
        costs = [_squares(design[seen], rough[seen]) for design in self.designs]
        start = self.grid[int(np.argmin(costs))]
        best = self.designs[int(np.argmin(costs))][seen]
        scale = _LINEAR * max(_spread(best, rough[seen]), 1e-6)

        def cost(point: Array) -> float:
            # Later commands than those of the search are not known in every row, of the slopes below either.
            if point[1] < 0.0 or point[0] > MOST_DELAY_S - _STEP_S:
                return float("inf")
            return _soft_cost(self.lagged(point[0], point[1], self.fine)[use], values[use], scale)

        simplex = [start, (start[0] + 0.5 * GRID_S, start[1]), (start[0], start[1] + 0.75 * GRID_S)]
        options = {"initial_simplex": simplex, "xatol": 2e-4, "fatol": 1e-9, "maxfev": 150}
        delay, lag = minimize(cost, start, method="Nelder-Mead", options=options).x.tolist()
        design = np.column_stack([self.lagged(delay, lag, self.fine)[use], np.ones(use.sum())])
        coefficients, weights = robust_fit(design, values[use], np.zeros(design.shape[1]))
        left = values[use] - design @ coefficients
        below = max(lag - _STEP_S, 0.0)
        slopes = (
            (self.lagged(delay + _STEP_S, lag, self.fine) - self.lagged(delay - _STEP_S, lag, self.fine))
            / (2.0 * _STEP_S),
            (self.lagged(delay, lag + _STEP_S, self.fine) - self.lagged(delay, below, self.fine))
            / (lag + _STEP_S - below),
        )
        jacobian = np.column_stack([design, *(slope[use] @ coefficients[:-1] for slope in slopes)])
        blocks = self.blocks[self.known][use]
        covariance = sandwich(jacobian, weights, left, blocks, np.zeros(jacobian.shape[1]))
        errors = np.sqrt(np.diag(covariance))
        spread = np.sum(weights * (values[use] - np.average(values[use], weights=weights)) ** 2)
        share = 1.0 - float(np.sum(weights * left**2) / max(spread, 1e-300))
        return coefficients[:-1], errors[: len(coefficients) - 1], delay, float(errors[-2]), lag, share


def _squares(design: Array, target: Array) -> float:
    full = np.column_stack([design, np.ones(len(target))])
    coefficients = np.linalg.lstsq(full.T @ full, full.T @ target, rcond=None)[0]
    return float(np.mean((target - full @ coefficients) ** 2))


def _spread(design: Array, target: Array) -> float:
    """Return a standard deviation of the residual that is robust against hidden markers."""
    full = np.column_stack([design, np.ones(len(target))])
    coefficients, _ = robust_fit(full, target, np.zeros(full.shape[1]))
    return deviation(target - full @ coefficients)


def _soft_cost(design: Array, target: Array, scale: float) -> float:
    """Return the pseudo-Huber loss of the best gains and offset, in which the tilt is linear."""
    full = np.column_stack([design, np.ones(len(target))])
    weights = np.ones(len(target))
    left = target
    for _ in range(4):
        weighted = full * weights[:, None]
        coefficients = np.linalg.lstsq(full.T @ weighted, weighted.T @ target, rcond=None)[0]
        left = (target - full @ coefficients) / scale
        weights = 1.0 / np.sqrt(1.0 + left**2)
    return float(np.mean(np.sqrt(1.0 + left**2) - 1.0))


def _interpolated(times: Array, stamps: Array, values: Array) -> Array:
    """Return values interpolated between stamps, (k, 2); NaN outside and next to NaN rows."""
    columns = [np.interp(times, stamps, column, left=np.nan, right=np.nan) for column in values.T]
    return np.column_stack(columns)


def command_scales(runs: Sequence[Run]) -> Array:
    """Return the standard deviation of each command during the runs, (2,); 0 if it never changes."""
    values = np.concatenate([run.commands.lagged(run.stamps, 0.0) for run in runs])
    values = values[np.isfinite(values).all(axis=1)]
    return np.asarray(values.std(axis=0)) if len(values) else np.zeros(2)
