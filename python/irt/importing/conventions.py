"""Which tilt moves which axis of the marble, and which command which tilt: fitted, with errors.

The equations of motion are taken in their weak form. For a test function phi that vanishes with its slope at
both ends of a window, ``x'' = A tilt + c`` gives, by two partial integrations,

    integral of x phi'' dt = A * integral of tilt phi dt + c * integral of phi dt,

so that no place is ever differentiated (Messenger and Bortz, Weak SINDy, 2021). Noise of the tilt would bias
the gains towards zero; its known share is subtracted from the normal matrix (Fuller, Measurement Error
Models, 1987). Walls and held places are outliers: Tukey's biweight. Standard errors are those of a sandwich
over blocks of two seconds, within which windows overlap and errors are correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import noise_of
from irt.importing.log import Held

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A ball that rolls on a tilted plane accelerates by 5/7 g per radian [m/s^2].
ROLLING_GAIN = 5.0 / 7.0 * 9.81

#: Half of a window [s]: long against noise of the places, short against a swing of the board.
_HALF_S = 0.2
#: Windows begin this far apart [s].
_HOP_S = 0.08
#: Most windows and rows that are fitted: half an hour decides as well as a day.
_MOST_WINDOWS = 20_000
_MOST_ROWS = 12_000
#: A window with rows further apart than this many periods has a gap.
_GAP = 2.6
#: Errors are correlated within blocks of so long [s].
_BLOCK_S = 2.0
#: Below this mean speed [m/s] a marble may be stuck, which says nothing of the tilt.
_STUCK = 0.02
#: The marble touches the rim within this distance [m].
_RIM_M = 0.004
#: Offsets between clocks are searched up to this [s].
_MOST_OFFSET_S = 0.6
_MOST_DELAY_S = 1.0
#: Coarse grid of lags of an actuator [s].
_LAGS = (0.0, 0.03, 0.07, 0.15, 0.3)
#: Tukey's constant for 95 % efficiency under normal noise.
_TUKEY = 4.685
#: Standard errors from which a gain counts as decided, and as sure. The search over delays picks the best
#: of a hundred, hence not 2.
DECIDED, SURE = 5.0, 10.0


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch without breaks: what the fits see.

    Attributes
    ----------
    stamps : (n,) array
        Time of each row [s].
    marble : (n, 2) array
        Places [m], NaN where lost.
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
        Of outputs (rows) by inputs (columns), and their standard errors; NaN where an input is idle.
    delay, delay_error : (2,) array
        Dead time by output [s].
    lag : (2,) array
        First-order lag by output [s].
    explained : (2,) array
        Share of the variance of each output that is explained, 0 to 1.
    scales : (2,) array
        Standard deviation of each input.
    count : int
        Windows or rows that were fitted.
    """

    gains: Array
    errors: Array
    delay: Array
    delay_error: Array
    lag: Array
    explained: Array
    scales: Array
    count: int

    @property
    def z(self) -> Array:
        """Gains in standard errors, (2, 2); zero where undefined."""
        with np.errstate(all="ignore"):
            return np.nan_to_num(self.gains / self.errors, nan=0.0, posinf=0.0, neginf=0.0)

    @property
    def effects(self) -> Array:
        """What each input does to each output at its own size, (2, 2)."""
        return np.nan_to_num(np.abs(self.gains) * self.scales)


def tilt_to_marble(runs: Sequence[Run], edges: tuple[float, float], *, search: bool) -> Map | None:
    """Fit the acceleration of the marble [m/s^2] by the tilt [rad].

    Parameters
    ----------
    runs : sequence of Run
        Stretches of one rig.
    edges : (float, float)
        Size of the area in which the marble's centre moves [m].
    search : bool
        Whether the tilt's clock may differ from the marble's by up to 0.6 s; else it is the same, and a
        small difference (of filters) is only estimated. `Map.delay` is how much later the marble's stamps
        are than the tilt's for the same moment.

    Returns
    -------
    Map or None
        None where there is no tilt or hardly any free motion.
    """
    windows = _Windows.of(runs, edges)
    if windows is None or all(run.tilt is None for run in runs):
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

    tilts = [run.tilt for run in runs if run.tilt is not None]
    noises = np.array([np.nanmedian([noise_of(tilt[:, axis]) for tilt in tilts]) for axis in (0, 1)])
    noises = np.nan_to_num(noises)
    grid = np.arange(-_MOST_OFFSET_S, _MOST_OFFSET_S + 0.01, 0.02) if search else np.zeros(1)
    return _fit_windows(windows, [(0.0, regressors)], grid, noises, np.nanstd(np.concatenate(tilts), axis=0))


def commands_to_marble(runs: Sequence[Run], edges: tuple[float, float]) -> Map | None:
    """Fit the acceleration of the marble [m/s^2] by the commands, where no tilt was measured."""
    windows = _Windows.of(runs, edges)
    if windows is None or not any(run.commands.stamps.size for run in runs):
        return None

    def regressors(lag: float, delay: float) -> Array:
        return np.concatenate(
            [
                weak.smooth(run.commands.lagged(run.stamps - delay, lag))
                for run, weak in zip(windows.runs, windows.weak, strict=True)
            ]
        )

    grid = np.arange(-_MOST_OFFSET_S, _MOST_DELAY_S, 0.02)
    lags = [(lag, lambda delay, lag=lag: regressors(lag, delay)) for lag in _LAGS]
    return _fit_windows(windows, lags, grid, np.zeros(2), _command_scales(runs))


def commands_to_tilt(runs: Sequence[Run]) -> Map | None:
    """Fit the tilt [rad] by the commands: gains, dead time and lag by axis of the tilt.

    The dead time holds whatever the clocks of commands and states differ by: from these signals alone the
    two cannot be separated.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415

    usable = [run for run in runs if run.tilt is not None and run.commands.stamps.size]
    scales = _command_scales(runs)
    if not usable or not (scales > 0.0).any():
        return None
    active = scales > 0.0
    rows = sum(len(run.stamps) for run in usable)
    stride = max(1, rows // _MOST_ROWS)
    times = [run.tilt_stamps[::stride] for run in usable]
    tilt = np.concatenate([run.tilt[::stride] for run in usable if run.tilt is not None])
    blocks = _blocks(times)

    ends = np.cumsum([len(one) for one in times])

    def lagged(delay: float, lag: float, rows: NDArray[np.intp] | None = None) -> Array:
        parts = []
        for run, t, end in zip(usable, times, ends.tolist(), strict=True):
            if rows is not None:
                inside = rows[(rows >= end - len(t)) & (rows < end)]
                t = t[inside - (end - len(t))]
            parts.append(run.commands.lagged(t - delay, lag))
        return np.asarray(np.concatenate(parts)[:, active])

    # A row without a command before it says nothing, at any delay that is tried.
    known = np.isfinite(lagged(_MOST_DELAY_S, 0.0)).all(axis=1)
    gains, errors = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    delays, delay_errors, lags, explained = (np.full(2, np.nan) for _ in range(4))
    step = 0.02
    coarse = [(d, g) for g in _LAGS for d in np.arange(-_MOST_OFFSET_S, _MOST_DELAY_S, step)]
    thin = max(1, known.sum() // 3000)
    picked = np.flatnonzero(known)[::thin]
    designs = [lagged(delay, lag, picked) for delay, lag in coarse]
    for axis in (0, 1):
        use = known & np.isfinite(tilt[:, axis])
        if use.sum() < 50 or np.std(tilt[use, axis]) < 1e-9:
            continue
        target = tilt[picked, axis]
        seen = np.isfinite(target)
        costs = [_linear_cost(design[seen], target[seen]) for design in designs]
        delay, lag = coarse[int(np.argmin(costs))]
        values = tilt[use, axis]
        scale = max(noise_of(tilt[:, axis]) if stride == 1 else 0.0, 0.1 * float(np.sqrt(min(costs))), 1e-6)

        def residual(p: Array, use: Mask = use, values: Array = values) -> Array:
            return np.asarray(lagged(p[0], max(p[1], 0.0))[use] @ p[2:-1] + p[-1] - values)

        design = np.column_stack([lagged(delay, lag)[use], np.ones(use.sum())])
        start = np.linalg.lstsq(design, values, rcond=None)[0]
        spread = np.concatenate([[0.01, 0.02], np.abs(start) + 1e-9])
        best = least_squares(
            residual,
            np.concatenate([[delay, max(lag, 0.01)], start]),
            bounds=([-1.0, 0.0, *[-np.inf] * len(start)], [1.5, 1.0, *[np.inf] * len(start)]),
            x_scale=spread,
            loss="soft_l1",
            f_scale=3.0 * scale,
            # Held commands make the cost piecewise smooth in the dead time: steps that average over its kinks.
            diff_step=np.concatenate([[0.02, 0.05], np.full(len(start), 1e-6)]),
            max_nfev=60,
        )
        delays[axis], lags[axis] = _polished(residual, best.x, 3.0 * scale)
        design = np.column_stack([lagged(delays[axis], lags[axis])[use], np.ones(use.sum())])
        slopes = [
            (
                lagged(delays[axis] + dd, lags[axis] + dl)[use]
                - lagged(delays[axis] - dd, max(lags[axis] - dl, 0.0))[use]
            )
            / (2.0 * dd + dl + min(dl, lags[axis]))
            for dd, dl in ((0.004, 0.0), (0.0, 0.004))
        ]
        coefficients, weights = _robust(design, values, np.zeros(design.shape[1]))
        jacobian = np.column_stack([design, *(slope @ coefficients[:-1] for slope in slopes)])
        left = values - design @ coefficients
        covariance = _sandwich(jacobian, weights, left, blocks[use], np.zeros(jacobian.shape[1]))
        gains[axis, active] = coefficients[:-1]
        errors[axis, active] = np.sqrt(np.diag(covariance))[: active.sum()]
        delay_errors[axis] = np.sqrt(covariance[-2, -2])
        explained[axis] = 1.0 - np.sum(weights * left**2) / np.sum(
            weights * (values - np.average(values, weights=weights)) ** 2
        )
    return Map(gains, errors, delays, delay_errors, lags, explained, scales, int(known.sum()))


def _polished(residual, start: Array, scale: float) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Return dead time and lag at the least cost near ``start``, by a search without slopes."""
    from scipy.optimize import minimize  # noqa: PLC0415

    def cost(p: Array) -> float:
        if p[1] < 0.0:
            return float("inf")
        full = start.copy()
        full[:2] = p
        # Gains follow in closed form: the residual is linear in them.
        base = residual(np.concatenate([p, np.zeros(len(start) - 2)]))
        columns = [residual(np.concatenate([p, unit])) - base for unit in np.eye(len(start) - 2)]
        design = np.column_stack(columns)
        coefficients = start[2:]
        for _ in range(3):
            left = base + design @ coefficients
            weight = 1.0 / np.sqrt(1.0 + (left / scale) ** 2)
            coefficients = np.linalg.lstsq(
                design * np.sqrt(weight)[:, None], -base * np.sqrt(weight), rcond=None
            )[0]
        left = base + design @ coefficients
        return float(np.sum(2.0 * (np.sqrt(1.0 + (left / scale) ** 2) - 1.0)))

    simplex = np.array([start[:2], start[:2] + [0.01, 0.0], start[:2] + [0.0, 0.015]])
    found = minimize(
        cost,
        start[:2],
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 2e-4, "fatol": 1e-9, "maxfev": 120},
    )
    return float(found.x[0]), float(max(found.x[1], 0.0))


# --- the weak form -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Weak:
    """Windows of one run as two sparse matrices from rows to windows."""

    places: Array  # (k, 2): weighted mean acceleration [m/s^2]
    average: object  # (k, n) sparse: weighted mean
    power: Array  # (k,): sum of squared weights of the mean
    centres: Array
    free: Mask  # (k, 2): off the rim along each axis, and moving
    direction: Array  # (k, 2)

    @property
    def count(self) -> int:
        return len(self.centres)

    def smooth(self, values: Array) -> Array:
        """Return the mean over each window, (k, 2); NaN where it has a gap."""
        return np.asarray(self.average @ values)  # type: ignore[operator]


@dataclass(frozen=True, eq=False)
class _Windows:
    runs: list[Run]
    weak: list[_Weak]
    blocks: Array

    @classmethod
    def of(cls, runs: Sequence[Run], edges: tuple[float, float]) -> _Windows | None:
        total = sum(float(run.stamps[-1] - run.stamps[0]) for run in runs if len(run.stamps) > 1)
        hop = max(_HOP_S, total / _MOST_WINDOWS)
        pairs = [(run, weak) for run in runs if (weak := _weak_form(run, edges, hop)) is not None]
        if sum(weak.count for _, weak in pairs) < 20:
            return None
        blocks = _blocks([weak.centres for _, weak in pairs])
        return cls([run for run, _ in pairs], [weak for _, weak in pairs], blocks)

    def stack(self, field: str) -> Array:
        return np.concatenate([getattr(weak, field) for weak in self.weak])


def _weak_form(run: Run, edges: tuple[float, float], hop: float) -> _Weak | None:
    from scipy.sparse import csr_array  # noqa: PLC0415

    times = run.stamps
    if len(times) < 12:
        return None
    period = float(np.median(np.diff(times)))
    half = max(_HALF_S, 5.0 * period)
    seen = np.isfinite(run.marble).all(axis=1)
    # A window must not span a gap: neither of stamps nor of places.
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
        # Stamps are not regular: make the rule exact for a marble at rest, in steady motion and accelerating.
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


def _fit_windows(windows: _Windows, families, grid: Array, noises: Array, scales: Array) -> Map:  # type: ignore[no-untyped-def]
    """Fit the acceleration of both axes by two regressors at the best delay of a grid, then refined."""
    target = windows.stack("places")
    free = windows.stack("free").astype(bool)
    direction = windows.stack("direction")
    power = windows.stack("power")
    active = scales > 0.0
    noise = (noises**2)[active]

    def design(values: Array, axis: int) -> Array:
        # Friction acts against the motion and must not be taken for a gain.
        return np.column_stack([values[:, active], direction[:, axis], np.ones(len(values))])

    def cost(values: Array) -> float:
        total = 0.0
        for axis in (0, 1):
            use = free[:, axis] & np.isfinite(values[:, active]).all(axis=1)
            if use.sum() < 20:
                return float("inf")
            x, y = design(values, axis)[use], target[use, axis]
            # Tukey's loss about the best fit: windows with a wall in them cost the same at every delay.
            coefficients, _ = _robust(x, y, np.zeros(x.shape[1]), rounds=3)
            left = np.abs(y - x @ coefficients)
            total += float(np.mean(np.minimum(left, 3.0 * spread[axis]) ** 2)) / spread[axis] ** 2
        return total

    spread = np.array(
        [
            max(1e-6, 0.3 * float(np.std(target[free[:, axis], axis]))) if free[:, axis].any() else 1.0
            for axis in (0, 1)
        ]
    )
    choices = [(lag, family, delay) for lag, family in families for delay in grid]
    costs = [cost(family(delay)) for _, family, delay in choices] if len(choices) > 1 else [0.0]
    lag, family, delay = choices[int(np.argmin(costs))]
    step = 0.01
    gains, errors = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    delay_error, explained = np.full(2, np.nan), np.full(2, np.nan)
    shifts, shift_errors = np.zeros(2), np.full(2, np.inf)
    for round_ in range(4):
        values, ahead, behind = family(delay), family(delay + step), family(delay - step)
        for axis in (0, 1):
            use = free[:, axis] & np.isfinite(values + ahead + behind)[:, active].all(axis=1)
            if use.sum() < 20:
                continue
            x, y = design(values, axis)[use], target[use, axis]
            share = np.zeros((use.sum(), x.shape[1]))
            share[:, : active.sum()] = power[use, None] * noise
            coefficients, weights = _robust(x, y, share)
            left = y - x @ coefficients
            slope = ((ahead - behind)[:, active][use] / (2.0 * step)) @ coefficients[: active.sum()]
            jacobian = np.column_stack([x, slope])
            padded = np.column_stack([share, np.zeros(use.sum())])
            covariance = _sandwich(jacobian, weights, left, windows.blocks[use], padded)
            normal = jacobian.T @ (weights[:, None] * jacobian)
            shifts[axis] = np.linalg.lstsq(normal, jacobian.T @ (weights * left), rcond=None)[0][-1]
            shift_errors[axis] = np.sqrt(covariance[-1, -1])
            gains[axis, active] = coefficients[: active.sum()]
            errors[axis, active] = np.sqrt(np.diag(covariance))[: active.sum()]
            delay_error[axis] = shift_errors[axis]
            explained[axis] = 1.0 - np.sum(weights * left**2) / max(
                np.sum(weights * (y - np.average(y, weights=weights)) ** 2), 1e-300
            )
        precision = 1.0 / np.maximum(shift_errors, 1e-9) ** 2
        shift = float(np.sum(precision * shifts) / np.sum(precision)) if precision.sum() > 0.0 else 0.0
        if len(choices) == 1:
            # One clock: a difference is estimated about zero, and not followed.
            return Map(
                gains,
                errors,
                shifts,
                delay_error,
                np.full(2, lag),
                explained,
                scales,
                int(free.any(axis=1).sum()),
            )
        if round_ < 3:
            delay += float(np.clip(shift, -0.03, 0.03))
    return Map(
        gains,
        errors,
        np.full(2, delay),
        delay_error,
        np.full(2, lag),
        explained,
        scales,
        int(free.any(axis=1).sum()),
    )


# --- regression --------------------------------------------------------------------------------------------


def _robust(design: Array, target: Array, share: Array, rounds: int = 12) -> tuple[Array, Array]:
    """Return coefficients and weights of Tukey's M-estimate, less the known noise of the regressors.

    ``share`` is the variance of the noise in each entry of the design, (n, k) or (k,).
    """
    weights = np.ones(len(target))
    coefficients = np.zeros(design.shape[1])
    for _ in range(rounds):
        weighted = design * weights[:, None]
        normal = design.T @ weighted - np.diag(
            np.sum(weights[:, None] * share, axis=0) * np.ones(design.shape[1])
        )
        coefficients = np.linalg.lstsq(normal, weighted.T @ target, rcond=None)[0]
        left = np.abs(target - design @ coefficients)
        scale = 1.4826 * float(np.median(left))
        if scale < 1e-12:
            break
        weights = np.clip(1.0 - (left / (_TUKEY * scale)) ** 2, 0.0, None) ** 2
    return coefficients, weights


def _sandwich(jacobian: Array, weights: Array, left: Array, blocks: Array, share: Array) -> Array:
    """Return the covariance of an M-estimate whose errors are correlated within blocks."""
    scores = jacobian * (weights * left)[:, None]
    _, which = np.unique(blocks, return_inverse=True)
    sums = np.zeros((which.max() + 1, jacobian.shape[1]))
    np.add.at(sums, which, scores)
    normal = jacobian.T @ (weights[:, None] * jacobian)
    normal = normal - np.diag(np.sum(weights[:, None] * share, axis=0) * np.ones(jacobian.shape[1]))
    inverse = np.linalg.pinv(normal)
    # The usual small-sample factor: few blocks fit themselves.
    groups = len(sums)
    factor = groups / max(groups - 1, 1)
    return np.asarray(factor * inverse @ (sums.T @ sums) @ inverse)


def _linear_cost(design: Array, target: Array) -> float:
    full = np.column_stack([design, np.ones(len(target))])
    normal = full.T @ full
    coefficients = np.linalg.lstsq(normal, full.T @ target, rcond=None)[0]
    return float(np.mean((target - full @ coefficients) ** 2))


def _blocks(times: Sequence[Array]) -> Array:
    """Return a number for each row that changes every two seconds and with each run."""
    parts, done = [], 0
    for one in times:
        block = np.floor((one - one[0]) / _BLOCK_S).astype(int) if len(one) else np.zeros(0, dtype=int)
        parts.append(block + done)
        done += int(block.max()) + 1 if len(one) else 0
    return np.concatenate(parts).astype(np.float64)


def _interpolated(times: Array, stamps: Array, values: Array) -> Array:
    """Return values between stamps, (k, 2); NaN outside, and next to rows that are NaN."""
    columns = [np.interp(times, stamps, column, left=np.nan, right=np.nan) for column in values.T]
    return np.column_stack(columns)


def _command_scales(runs: Sequence[Run]) -> Array:
    """Return the standard deviation of each command while the runs last, (2,); 0 where it never moves."""
    parts = [run.commands.lagged(run.stamps, 0.0) for run in runs]
    values = np.concatenate(parts)
    values = values[np.isfinite(values).all(axis=1)]
    return np.asarray(values.std(axis=0)) if len(values) else np.zeros(2)
