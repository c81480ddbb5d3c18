"""The weak form of the marble's equation of motion: accelerations without differentiating positions.

For a test function phi that vanishes with its slope at both ends of a window, ``x'' = A tilt + c`` gives, by
two partial integrations,

    integral of x phi'' dt = A * integral of tilt phi dt + c * integral of phi dt,

so that positions are never differentiated (Messenger and Bortz, "Weak SINDy", 2021).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irt.importing.log import Held
from irt.importing.regression import robust_fit, sandwich, time_blocks

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
#: Two regressors of each window at a delay [s], (k, 2).
Family = Callable[[float], Array]

#: Half of a window [s]: long enough to average noise, short compared with a swing of the board.
_HALF_S = 0.2
#: Distance between windows [s].
_HOP_S = 0.08
#: Maximum number of windows: half an hour is enough for all decisions.
_MOST_WINDOWS = 20_000
#: Distance of rows, in periods, that makes a gap in a window.
_GAP = 2.6
#: Mean speed [m/s] below which a marble may be stuck and its window is ignored.
_STUCK = 0.02
#: Distance from the rim [m] within which the marble touches it.
_RIM_M = 0.004
#: Minimum number of windows of a fit.
_FEWEST = 20
#: Half width of the finite difference over the delay [s].
_STEP_S = 0.01
#: Maximum change of a delay in one refinement [s], the range of its linear model.
_STRIDE_S = 0.03


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch without gaps, as input of the fits.

    Attributes
    ----------
    stamps : (n,) array
        Time of each row [s].
    marble : (n, 2) array
        Positions [m], NaN in lost rows.
    tilt : (n, 2) array or None
        Measured tilt [rad] at ``tilt_stamps``.
    tilt_stamps : (n,) array
        Times of the tilt [s].
    commands : Held
        Commands of the whole log.
    """

    stamps: Array
    marble: Array
    tilt: Array | None
    tilt_stamps: Array
    commands: Held


@dataclass(frozen=True, eq=False)
class Map:
    """A 2 x 2 linear map with errors.

    Attributes
    ----------
    gains, errors : (2, 2) array
        Gains of outputs (rows) by inputs (columns), and standard errors; NaN for an idle input.
    delay, delay_error : (2,) array
        Dead time by output [s].
    lag : (2,) array
        First-order lag by output [s].
    explained : (2,) array
        Explained share of the variance of each output, 0 to 1.
    scales : (2,) array
        Standard deviation of each input.
    count : int
        Number of fitted windows or rows.
    constant, constant_error : (2,) array
        What each output is without inputs, and its standard error; NaN if it was not fitted.
    """

    gains: Array
    errors: Array
    delay: Array
    delay_error: Array
    lag: Array
    explained: Array
    scales: Array
    count: int
    constant: Array = field(default_factory=lambda: np.full(2, np.nan))
    constant_error: Array = field(default_factory=lambda: np.full(2, np.nan))

    @property
    def z(self) -> Array:
        """Gains in standard errors, (2, 2); zero if undefined."""
        with np.errstate(all="ignore"):
            return np.nan_to_num(self.gains / self.errors, nan=0.0, posinf=0.0, neginf=0.0)

    @property
    def effects(self) -> Array:
        """Effect of each input on each output at the input's own size, (2, 2)."""
        return np.nan_to_num(np.abs(self.gains) * self.scales)


@dataclass(frozen=True, eq=False)
class _Weak:
    """Windows of one run as two sparse matrices from rows to windows."""

    places: Array  # (k, 2): weighted mean acceleration [m/s^2]
    average: Any  # (k, n) sparse: weighted mean
    power: Array  # (k,): sum of squared weights of the mean
    centres: Array
    free: Mask  # (k, 2): off the rim along each axis, and moving
    direction: Array  # (k, 2)

    @property
    def count(self) -> int:
        return len(self.centres)

    def smooth(self, values: Array) -> Array:
        """Return the mean over each window, (k, 2); NaN for windows with a gap."""
        return np.asarray(self.average @ values)


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of all runs, with their blocks of time."""

    runs: list[Run]
    weak: list[_Weak]
    blocks: Array

    @classmethod
    def of(cls, runs: Sequence[Run], edges: tuple[float, float]) -> Windows | None:
        """Return the windows of runs whose marble's centre moves within ``edges`` [m]; None if too few."""
        total = sum(float(run.stamps[-1] - run.stamps[0]) for run in runs if len(run.stamps) > 1)
        hop = max(_HOP_S, total / _MOST_WINDOWS)
        pairs = [(run, weak) for run in runs if (weak := _weak_form(run, edges, hop)) is not None]
        if sum(weak.count for _, weak in pairs) < _FEWEST:
            return None
        blocks = time_blocks([weak.centres for _, weak in pairs])
        return cls([run for run, _ in pairs], [weak for _, weak in pairs], blocks)

    def stack(self, field: str) -> Array:
        """Return a field of all windows, one run after the other."""
        return np.concatenate([getattr(weak, field) for weak in self.weak])


def _weak_form(run: Run, edges: tuple[float, float], hop: float) -> _Weak | None:
    from scipy.sparse import csr_array  # noqa: PLC0415

    times = run.stamps
    if len(times) < 12:
        return None
    period = float(np.median(np.diff(times)))
    half = max(_HALF_S, 5.0 * period)
    seen = np.isfinite(run.marble).all(axis=1)
    # A window must not contain a gap of stamps or positions.
    breaks = np.cumsum(np.concatenate([[False], np.diff(times) > _GAP * period]))
    lost = np.concatenate([[0], np.cumsum(~seen)])
    speed, direction = _motion(times, run.marble)
    limits = np.array(edges) / 2.0 - _RIM_M
    data: list[Array] = []
    columns: list[Array] = []
    places, power, centres, free, directions = [], [], [], [], []
    for centre in np.arange(times[0] + half, times[-1] - half, hop):
        first, last = np.searchsorted(times, [centre - half, centre + half])
        if last - first < 8 or breaks[first] != breaks[last - 1] or lost[last] - lost[first]:
            continue
        s = (times[first:last] - centre) / half
        bump = 1.0 - s**2
        width = np.gradient(times[first:last])
        phi = width * bump**4
        curved = width * (48.0 * s**2 * bump**2 - 8.0 * bump**3) / half**2
        # Stamps are irregular: make the quadrature exact for rest, uniform motion and uniform acceleration.
        line = np.column_stack([np.ones_like(s), s])
        curved = curved - line @ np.linalg.solve(line.T @ line, line.T @ curved)
        curved *= phi.sum() / (curved @ (0.5 * (s * half) ** 2))
        mean = phi / phi.sum()
        at = run.marble[first:last]
        places.append(curved @ at / phi.sum())
        data.append(mean)
        columns.append(np.arange(first, last))
        power.append(mean @ mean)
        centres.append(centre)
        moving = float(np.nanmean(speed[first:last])) > _STUCK
        free.append((np.abs(at).max(axis=0) < limits) & moving)
        directions.append(mean @ np.nan_to_num(direction[first:last]))
    if not centres:
        return None
    starts = np.concatenate([[0], np.cumsum([len(one) for one in data])])
    average = csr_array(
        (np.concatenate(data), np.concatenate(columns), starts), shape=(len(centres), len(times))
    )
    return _Weak(
        np.array(places), average, np.array(power), np.array(centres), np.array(free), np.array(directions)
    )


def _motion(times: Array, marble: Array) -> tuple[Array, Array]:
    """Return speed [m/s] and direction of the marble, (n,) and (n, 2), over seven rows."""
    velocity = np.full(marble.shape, np.nan)
    velocity[3:-3] = (marble[6:] - marble[:-6]) / (times[6:] - times[:-6])[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    return speed, velocity / np.sqrt(speed**2 + _STUCK**2)[:, None]


def fit_windows(
    windows: Windows,
    families: Sequence[tuple[float, Family]],
    delays: Array,
    noises: Array,
    scales: Array,
) -> Map:
    """Fit the acceleration of both axes by two regressors at the best delay and lag.

    Parameters
    ----------
    windows : Windows
        Of all runs.
    families : sequence of (float, callable)
        Lags [s], and for each the regressors at a delay.
    delays : array
        Delays to try [s]. For a single one the offset to the best is estimated, but not applied.
    noises : (2,) array
        Standard deviation of white noise on each regressor's rows.
    scales : (2,) array
        Standard deviation of each regressor; a constant one is left out.
    """
    fits = _Fits(windows, noises, scales)
    choices = [(lag, family, float(delay)) for lag, family in families for delay in delays]
    costs = [fits.cost(family(delay)) for _, family, delay in choices] if len(choices) > 1 else [0.0]
    lag, family, delay = choices[int(np.argmin(costs))]
    fit = fits.at(family, delay)
    late = fit.shifts
    if len(choices) > 1:
        for _ in range(3):
            precision = 1.0 / np.maximum(fit.shift_errors, 1e-9) ** 2
            shift = float(np.sum(precision * fit.shifts) / max(precision.sum(), 1e-300))
            delay += float(np.clip(shift, -_STRIDE_S, _STRIDE_S))
            fit = fits.at(family, delay)
        late = np.full(2, delay)
    count = int(fits.free.any(axis=1).sum())
    return Map(
        fit.gains,
        fit.errors,
        late,
        fit.shift_errors,
        np.full(2, lag),
        fit.explained,
        scales,
        count,
        fit.constant,
        fit.constant_error,
    )


class _Fit(NamedTuple):
    """Gains and a constant with their errors, explained shares, and steps of the delay with their errors."""

    gains: Array
    errors: Array
    constant: Array
    constant_error: Array
    explained: Array
    shifts: Array
    shift_errors: Array


class _Fits:
    """Regressions of the same windows at many delays."""

    def __init__(self, windows: Windows, noises: Array, scales: Array) -> None:
        self.blocks = windows.blocks
        self.target = windows.stack("places")
        self.free = windows.stack("free").astype(bool)
        self.direction = windows.stack("direction")
        self.power = windows.stack("power")
        self.active = scales > 0.0
        self.variance = (noises**2)[self.active]
        # Windows with a wall must have the same loss at every delay.
        spread = [
            np.std(self.target[use, axis]) if use.any() else 1.0 for axis, use in enumerate(self.free.T)
        ]
        self.most = np.maximum(0.9 * np.array(spread), 1e-6)

    def design(self, values: Array, axis: int) -> Array:
        # Friction acts against the motion and must not be mistaken for a gain.
        return np.column_stack([values[:, self.active], self.direction[:, axis], np.ones(len(values))])

    def usable(self, values: Array, axis: int) -> Mask:
        return np.asarray(self.free[:, axis] & np.isfinite(values[:, self.active]).all(axis=1))

    def cost(self, values: Array) -> float:
        """Return the squared residual of both axes in units of their spread, outliers capped."""
        total = 0.0
        for axis in (0, 1):
            use = self.usable(values, axis)
            if use.sum() < _FEWEST:
                return float("inf")
            design, target = self.design(values, axis)[use], self.target[use, axis]
            coefficients, _ = robust_fit(design, target, np.zeros(design.shape[1]), rounds=3)
            left = np.abs(target - design @ coefficients) / self.most[axis]
            total += float(np.mean(np.minimum(left, 1.0) ** 2))
        return total

    def at(self, family: Family, delay: float) -> _Fit:
        """Fit both axes at a delay."""
        values = family(delay)
        slopes = (family(delay + _STEP_S) - family(delay - _STEP_S)) / (2.0 * _STEP_S)
        inputs = int(self.active.sum())
        gains, errors = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
        constant, constant_error = np.full(2, np.nan), np.full(2, np.nan)
        explained, shifts, shift_errors = np.full(2, np.nan), np.zeros(2), np.full(2, np.inf)
        for axis in (0, 1):
            use = self.usable(values + slopes, axis)
            if use.sum() < _FEWEST:
                continue
            design, target = self.design(values, axis)[use], self.target[use, axis]
            share = np.zeros((len(target), inputs + 3))
            share[:, :inputs] = self.power[use, None] * self.variance
            coefficients, weights = robust_fit(design, target, share[:, :-1])
            left = target - design @ coefficients
            jacobian = np.column_stack([design, slopes[:, self.active][use] @ coefficients[:inputs]])
            covariance = sandwich(jacobian, weights, left, self.blocks[use], share)
            normal = jacobian.T @ (weights[:, None] * jacobian)
            step = np.linalg.lstsq(normal, jacobian.T @ (weights * left), rcond=None)[0]
            gains[axis, self.active] = coefficients[:inputs]
            errors[axis, self.active] = np.sqrt(np.diag(covariance))[:inputs]
            constant[axis], constant_error[axis] = coefficients[-1], np.sqrt(covariance[-2, -2])
            shifts[axis], shift_errors[axis] = step[-1], np.sqrt(covariance[-1, -1])
            explained[axis] = _explained(target, left, weights)
        return _Fit(gains, errors, constant, constant_error, explained, shifts, shift_errors)


def _explained(target: Array, left: Array, weights: Array) -> float:
    spread = np.sum(weights * (target - np.average(target, weights=weights)) ** 2)
    return float(1.0 - np.sum(weights * left**2) / max(spread, 1e-300))
