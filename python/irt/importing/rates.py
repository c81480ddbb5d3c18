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

from irt.importing.conventions import (
    DECIDED,
    GRID_S,
    MOST_DELAY_S,
    MOST_OF_IT,
    MOST_OFFSET_S,
    command_scales,
)
from irt.importing.log import Held
from irt.importing.regression import robust_fit, sandwich, time_blocks
from irt.importing.weak_form import Map, Run

Array = NDArray[np.float64]

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
    choices = [windows.choice(axis, active) for axis in (0, 1)]
    known = [one for one in choices if one is not None]
    if not known or min(one.explained for one in known) < MOST_OF_IT:
        return None
    by_angle, by_rate = (sum(squares) for squares in zip(*(one.squares for one in known), strict=True))
    if _agree(np.asarray(by_angle), np.asarray(by_rate), windows.blocks) < DECIDED:
        return None
    gains, errors = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    delays, delay_errors, lags, explained = (np.full(2, np.nan) for _ in range(4))
    dead = np.zeros(2)
    for axis, choice in enumerate(choices):
        if choice is None:
            continue
        law = windows.law(axis, active, choice.move)
        gains[axis, active], errors[axis, active] = law.gains, law.errors
        delays[axis], lags[axis], dead[axis] = law.move
        delay_errors[axis], explained[axis] = law.delay_error, law.explained
    return Rates(Map(gains, errors, delays, delay_errors, lags, explained, scales, len(windows.blocks)), dead)


#: Delay [s], lag of the speed [s], and dead zone [unit].
_Move = tuple[float, float, float]


@dataclass(frozen=True)
class _Choice:
    """How well both laws explain a column of the tilt on coarse grids.

    ``squares`` are the squared errors of the windows, by angles and by rates, over the changes' mean square.
    """

    move: _Move
    explained: float
    squares: tuple[Array, Array]


@dataclass(frozen=True)
class _Law:
    """The rates of a column of the tilt, with standard errors."""

    gains: Array
    errors: Array
    move: _Move
    delay_error: float
    explained: float


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
            if len(self._beyond) > len(_DEAD):
                self._beyond.clear()
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

    def choice(self, axis: int, active: NDArray[np.intp]) -> _Choice | None:
        """Compare both laws for a column of the tilt; None if it was hardly measured or never changes."""
        change = self.changes[:, axis]
        use = np.isfinite(change)
        if use.sum() < _FEWEST or np.std(change[use]) < 1e-9:
            return None
        target, blocks = change[use], self.blocks[use]
        _, by_angle = _best(self.angle_designs[:, use][..., active], target)
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
        squares = np.zeros((2, len(change)))
        squares[:, use] = np.array([by_angle, by_rate]) ** 2 / np.mean(target**2)
        share = 1.0 - float(by_rate @ by_rate / (target @ target))
        return _Choice((*_MOVES[which], dead), share, (squares[0], squares[1]))

    def law(self, axis: int, active: NDArray[np.intp], start: _Move) -> _Law:
        """Fit the rates of a column of the tilt, from the best of the grids; no dead zone stays none."""
        from scipy.optimize import minimize  # noqa: PLC0415

        use = np.isfinite(self.changes[:, axis])
        target, blocks = self.changes[use, axis], self.blocks[use]
        free = [0, 1, 2] if start[2] else [0, 1]
        steps = np.array([0.25 * GRID_S, 0.25 * GRID_S, 0.1 * start[2]])[free]

        def design(point: Array) -> Array:
            delay, lag, dead = (*point.tolist(), 0.0)[:3]
            return self.turned(delay, lag, dead)[use][:, active]

        def cost(point: Array) -> float:
            if (point[1:] < 0.0).any() or point[0] > MOST_DELAY_S:
                return float("inf")
            _, left = _best(design(point)[None], target)
            return float(left @ left)

        begin = np.array(start)[free]
        simplex = np.vstack([begin, begin + 2.0 * np.diag(steps)])
        options = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-12, "maxfev": 200}
        best = np.asarray(minimize(cost, begin, method="Nelder-Mead", options=options).x)
        found = design(best)
        gains, weights = robust_fit(found, target, np.zeros(len(active)))
        left = target - found @ gains
        # Neither a lag nor a dead zone is negative: there the slope is one-sided.
        floor = np.array([-np.inf, 0.0, 0.0])[free]
        ends = [(np.maximum(best - step, floor), best + step) for step in np.diag(steps)]
        slopes = [(design(high) - design(low)) @ gains / float(np.sum(high - low)) for low, high in ends]
        jacobian = np.column_stack([found, *slopes])
        covariance = sandwich(jacobian, weights, left, blocks, np.zeros(jacobian.shape[1]))
        errors = np.sqrt(np.diag(covariance))
        delay, lag, dead = (*best.tolist(), 0.0)[:3]
        return _Law(
            gains,
            errors[: len(active)],
            (delay, lag, dead),
            float(errors[len(active)]),
            1.0 - float(left @ left / (target @ target)),
        )


def _best(designs: Array, target: Array) -> tuple[int, Array]:
    """Return which of designs (m, k, n) explains a target (k,) best by least squares, and its residuals."""
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
