"""Commands that set the rate of the tilt instead of the tilt: a motor's speed, or its current.

With dead time ``d``, lag ``T`` of the speed (``T L' + L = u``) and gains ``k``, the tilt changes from ``a``
to ``b`` by

    tilt(b) - tilt(a) = k * integral of L(t - d) dt from a to b,

while an actuator that follows angles, with lag ``T``, changes it by ``g * (L(b - d) - L(a - d))``. Both are
fitted to the same changes over windows. A level at which the tilt stays is in neither, so that a tilt that
drifts by friction, slack and stops counts for neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from irt.importing.conventions import DECIDED, GRID_S, MOST_DELAY_S, MOST_OFFSET_S, command_scales
from irt.importing.log import Held
from irt.importing.regression import robust_fit, sandwich, time_blocks
from irt.importing.weak_form import Map, Run

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Length of a window [s]: a few time constants of a motor, and far less than a drift takes.
_WINDOW_S = 0.4
#: Maximum number of windows.
_MOST_WINDOWS = 4_000
#: Minimum number of windows.
_FEWEST = 20
#: Lags of actuators that follow angles [s]. One of over a second follows the integral as well as an angle.
_LAGS = (0.0, 0.03, 0.07, 0.15, 0.3, 0.6, 1.0)
#: Delays [s], and pairs of a delay and a lag of a motor's speed [s].
_DELAYS = np.arange(-MOST_OFFSET_S, MOST_DELAY_S, GRID_S)
_MOVES = [(float(delay), lag) for lag in (0.0, 0.05, 0.1, 0.2) for delay in _DELAYS]
#: Distance from the extremes of the tilt, as a share of its range, within which a board may be at a stop.
_STOP = 0.05
#: Dead zones to try, as shares of the largest command.
_DEAD = np.arange(0.0, 0.61, 0.05)
#: Share of the changes that a rate has to explain: more than half.
_MOST_OF_IT = 0.5


@dataclass(frozen=True, eq=False)
class Rates:
    """How fast commands turn the board.

    Attributes
    ----------
    map : Map
        Rates of the tilt's columns [rad/s per unit] by command; dead times, lags of the speed, and the
        explained share of the changes over 0.4 s.
    dead : (2,) array
        Largest command that does not turn the board, by column of the tilt [unit]; 0 if none is significant.
    """

    map: Map
    dead: Array


def commands_to_rates(runs: Sequence[Run]) -> Rates | None:
    """Return the rates that commands set; None unless the measured tilt shows that they set rates.

    They have to explain most of the tilt's changes, and more than any actuator that follows angles: blocks of
    two seconds agree about the ratio of the two errors to five standard errors.
    """
    usable = [run for run in runs if run.tilt is not None and run.commands.stamps.size]
    scales = command_scales(usable) if usable else np.zeros(2)
    windows = _Windows.of(usable) if (scales > 0.0).any() else None
    if windows is None:
        return None
    active = np.flatnonzero(scales > 0.0)
    gains, errors = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    delays, delay_errors, lags, explained = (np.full(2, np.nan) for _ in range(4))
    dead, by_angle, by_rate = np.zeros(2), np.zeros(len(windows.blocks)), np.zeros(len(windows.blocks))
    for axis in (0, 1):
        fit = windows.fit(axis, active)
        if fit is None:
            continue
        gains[axis, active], errors[axis, active] = fit.gains, fit.errors
        delays[axis], delay_errors[axis], lags[axis] = fit.delay, fit.delay_error, fit.lag
        explained[axis] = fit.explained
        dead[axis] = fit.dead
        by_angle, by_rate = by_angle + fit.by_angle, by_rate + fit.by_rate
    known = np.isfinite(explained)
    if (
        not known.any()
        or explained[known].min() < _MOST_OF_IT
        or _agree(by_angle, by_rate, windows.blocks) < DECIDED
    ):
        return None
    found = Map(gains, errors, delays, delay_errors, lags, explained, scales, len(windows.blocks))
    return Rates(found, dead)


@dataclass(frozen=True)
class _Fit:
    """One column of the tilt.

    ``by_angle`` and ``by_rate`` are squared errors of the windows over the mean square of their changes.
    """

    gains: Array
    errors: Array
    delay: float
    delay_error: float
    lag: float
    explained: float
    dead: float
    by_angle: Array
    by_rate: Array


@dataclass(frozen=True, eq=False)
class _Windows:
    """Begins and ends of windows in each run, and how much the tilt changed in them, (k, 2)."""

    commands: list[Held]
    begins: list[Array]
    ends: list[Array]
    changes: Array
    blocks: Array
    _beyond: dict[float, list[Held]] = field(default_factory=dict, repr=False)

    @cached_property
    def angle_designs(self) -> Array:
        """Changes of lagged commands, for all delays and lags of an actuator, (m, k, 2)."""
        return np.array([self.followed(delay, lag) for lag in _LAGS for delay in _DELAYS])

    @cached_property
    def rate_designs(self) -> Array:
        """Integrals of lagged commands, for all delays and lags of the speed, (m, k, 2)."""
        return np.array([self.turned(*move, 0.0) for move in _MOVES])

    @classmethod
    def of(cls, runs: Sequence[Run]) -> _Windows | None:
        total = sum(float(run.tilt_stamps[-1] - run.tilt_stamps[0]) for run in runs)
        hop = max(0.5 * _WINDOW_S, total / _MOST_WINDOWS)
        together = np.concatenate([run.tilt for run in runs if run.tilt is not None])
        seen = np.isfinite(together).any(axis=1)
        low, high = np.nanmin(together[seen], axis=0), np.nanmax(together[seen], axis=0)
        margin = _STOP * (high - low)
        commands, begins, ends, changes = [], [], [], []
        for run in runs:
            times = run.tilt_stamps
            assert run.tilt is not None
            free = np.where((run.tilt > low + margin) & (run.tilt < high - margin), run.tilt, np.nan)
            first = np.searchsorted(times, np.arange(times[0], times[-1] - _WINDOW_S, hop))
            last = np.searchsorted(times, times[first] + _WINDOW_S)
            first, last = first[last < len(times)], last[last < len(times)]
            # All delays that are tried are of the same windows: those whose commands are known.
            known = times[first] - MOST_DELAY_S >= run.commands.stamps[0]
            first, last = first[known], last[known]
            commands.append(run.commands)
            begins.append(times[first])
            ends.append(times[last])
            changes.append(free[last] - free[first])
        if sum(len(one) for one in begins) < _FEWEST:
            return None
        return cls(commands, begins, ends, np.concatenate(changes), time_blocks(begins))

    def beyond(self, dead: float) -> list[Held]:
        """Return the commands of each run beyond a dead zone; runs of one log share theirs, with its lags."""
        if dead not in self._beyond:
            own = {
                id(held): replace(held, values=held.values - np.clip(held.values, -dead, dead), _states={})
                for held in self.commands
            }
            self._beyond[dead] = [own[id(held)] for held in self.commands]
        return self._beyond[dead]

    def turned(self, delay: float, lag: float, dead: float) -> Array:
        """Return the integrals of the lagged commands beyond a dead zone over the windows, (k, 2)."""
        parts = []
        for held, begins, ends in zip(self.beyond(dead), self.begins, self.ends, strict=True):
            first, last = begins - delay, ends - delay
            turned = held.mean(first, last) * (ends - begins)[:, None]
            # Of T L' + L = u.
            parts.append(turned - lag * (held.lagged(last, lag) - held.lagged(first, lag)) if lag else turned)
        return np.concatenate(parts)

    def followed(self, delay: float, lag: float) -> Array:
        """Return the changes of the commands after a lag over the windows, (k, 2)."""
        return np.concatenate(
            [
                held.lagged(ends - delay, lag) - held.lagged(begins - delay, lag)
                for held, begins, ends in zip(self.commands, self.begins, self.ends, strict=True)
            ]
        )

    def fit(self, axis: int, active: NDArray[np.intp]) -> _Fit | None:
        """Fit one column of the tilt; None if it was hardly measured or never changes."""
        change = self.changes[:, axis]
        use = np.isfinite(change)
        if use.sum() < _FEWEST or np.std(change[use]) < 1e-9:
            return None
        target, blocks = change[use], self.blocks[use]
        which, by_angle = _best(self.angle_designs[:, use][..., active], target)
        which, by_rate = _best(self.rate_designs[:, use][..., active], target)
        most = max(float(np.abs(held.values[:, active]).max()) for held in self.commands)
        zones = [float(share) * most for share in _DEAD]
        by_zone = np.array([self.turned(*_MOVES[which], dead)[use][:, active] for dead in zones])
        zone = zones[_best(by_zone, target)[0]]
        within = np.array([self.turned(*move, zone)[use][:, active] for move in _MOVES])
        again, beyond = _best(within, target)
        dead = 0.0
        if _agree(by_rate**2, beyond**2, blocks) >= DECIDED:
            which, by_rate, dead = again, beyond, zone
        delay, lag = _MOVES[which]
        design = self.turned(delay, lag, dead)[use][:, active]
        coefficients, weights = robust_fit(design, target, np.zeros(len(active)))
        step = 0.5 * GRID_S
        slope = (self.turned(delay + step, lag, dead) - self.turned(delay - step, lag, dead))[use][
            :, active
        ] / GRID_S
        jacobian = np.column_stack([design, slope @ coefficients])
        residual = target - design @ coefficients
        covariance = sandwich(jacobian, weights, residual, blocks, np.zeros(len(active) + 1))
        errors = np.sqrt(np.diag(covariance))
        squares = np.zeros((2, len(change)))
        squares[:, use] = np.array([by_angle, by_rate]) ** 2 / np.mean(target**2)
        return _Fit(
            coefficients,
            errors[:-1],
            delay,
            float(np.hypot(errors[-1], GRID_S / np.sqrt(12.0))),
            lag,
            1.0 - float(by_rate @ by_rate / (target @ target)),
            dead,
            squares[0],
            squares[1],
        )


def _best(designs: Array, target: Array) -> tuple[int, Array]:
    """Return which of designs (m, k, n) explains a target (k,) best by least squares, and what is left."""
    products = target @ designs
    normal = np.swapaxes(designs, 1, 2) @ designs
    gains = (np.linalg.pinv(normal) @ products[..., None])[..., 0]
    which = int(np.argmax(np.sum(products * gains, axis=1)))
    return which, target - designs[which] @ gains[which]


def _agree(worse: Array, better: Array, blocks: Array) -> float:
    """Return the mean logarithm of the ratio of squared errors over blocks, in its standard errors."""
    _, which = np.unique(blocks, return_inverse=True)
    sums = [np.bincount(which, weights=squares) for squares in (worse, better)]
    ratios = np.log(np.maximum(sums[0], 1e-300) / np.maximum(sums[1], 1e-300))
    error = np.std(ratios, ddof=1) / np.sqrt(len(ratios)) if len(ratios) > 1 else np.inf
    return float(np.mean(ratios) / max(error, 1e-300))
