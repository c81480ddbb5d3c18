"""The missing push of a set of effects in each row, and the variables that it depends on.

The smoother of the filter estimates the acceleration of the marble beyond that of the simulator from all rows
of a recording. If this push is the same in the same circumstances, physics is missing; otherwise it does not
repeat. Its dependence on each variable is found by regression. The p-value is that of circular shifts: the
push of a recording is shifted in time relative to the variable, which preserves its autocorrelation (Harris,
"Nonsense correlations in neuroscience", 2020).

What a rebound does to the velocity appears as a push in the rows around it, and commands and positions are
alike whenever a marble leaves the rim. Where rebounds are random, a dependence therefore has to be there in
the rows that no impact disturbs, too.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis import config
from irt.diagnosis.free_motion import FREE, SLOW, path_and_velocity
from irt.diagnosis.result import Finding, Kind
from irt.diagnosis.score import Scored, Scores
from irt.fitting.solution import Smoothed

Array = NDArray[np.float64]

#: Number of random shifts, and largest power of a polynomial.
SHIFTS, POWER = 399, 3
#: Fewest rows of a recording that is shifted.
FEWEST = 20
#: Most half waves over the board.
WAVES = 16
#: Variables that the push may depend on: description, and kind of finding.
VARIABLES: dict[str, tuple[str, Kind]] = {
    "position": ("the position on the board", "region"),
    "velocity": ("the velocity of the marble", "regime"),
    "heading": ("the direction of motion", "regime"),
    "command": ("the command", "stage"),
    "command rate": ("the rate of the command", "stage"),
    "time": ("the time since the start of the recording", "time"),
}


@dataclass(frozen=True)
class Dependence:
    """The dependence of a push on a variable.

    Attributes
    ----------
    variable : str
        A key of `VARIABLES`.
    share : float
        Explained share of the push's sum of squares, minus the mean share of shifted pushes.
    p_value : float
        Probability of explaining as much without a dependence, over all variables.
    """

    variable: str
    share: float
    p_value: float


class Needed:
    """The missing push of a set in free motion.

    Parameters
    ----------
    one : Scored
        The set.
    """

    def __init__(self, one: Scored) -> None:
        seed = one.dataset.seed
        #: Duration of a row [s] if recordings have no stamps; accelerations are then given in rows.
        self._row_s = None if one.dataset.time_scale is not None else one.dataset.row_s(one.fitted)
        found = smoothed(one)
        #: Push in each row and its standard deviation, (n, 2) [m/s^2], by recording; NaN if unknown.
        self.over_time = {
            run.recording: (_padded(push, len(run.run.knobs)), _padded(deviation, len(run.run.knobs)))
            for run, push, deviation in zip(one.dataset.runs, found.push, found.push_deviation, strict=True)
            if run.run.has_marble
        }
        free = list(_free(one, found))
        self._regressions = [Regression(free, seed)]
        if free and Scores.of(one).rebounds(one) >= config.SURE:
            self._regressions.append(Regression(list(undisturbed(free, found.push)), seed))

    @property
    def size(self) -> float:
        """RMS of the push [m/s^2]."""
        return self._regressions[0].size

    @functools.cached_property
    def dependences(self) -> list[Dependence]:
        """Dependences of the push on each variable, by p-value; empty if there are too few rows.

        Where rebounds are random, each is the less certain one of all rows and of the undisturbed rows.
        """
        by_variable = [{one.variable: one for one in each.dependences()} for each in self._regressions]
        found = [
            max((each[name] for each in by_variable), key=lambda one: (one.p_value, -one.share))
            for name in VARIABLES
            if all(name in each for each in by_variable)
        ]
        return sorted(found, key=lambda one: (one.p_value, -one.share))

    @property
    def p_value(self) -> float:
        """The p-value of the hypothesis that the push depends on no variable that repeats."""
        return min((one.p_value for one in self.dependences), default=1.0)

    def repeating(self, clear: float) -> float:
        """Return the largest explained share of the push among dependences with p-values up to `clear`."""
        return max((one.share for one in self.dependences if one.p_value <= clear), default=0.0)

    def findings(self, clear: float) -> list[Finding]:
        """Return dependences with p-values up to `clear` as findings."""
        return [
            Finding(
                VARIABLES[one.variable][1],
                f"the missing push ({self._shown}) depends on {VARIABLES[one.variable][0]}",
                min(1.0, one.share),
                one.p_value,
            )
            for one in self.dependences
            if one.p_value <= clear and one.share > 0.0
        ]

    @property
    def _shown(self) -> str:
        if self._row_s is None:
            return f"{self.size:.2g} m/s²"
        return f"{1000.0 * self.size * self._row_s**2:.2g} mm/row²"


@dataclass(frozen=True)
class FreeRows:
    """Rows of a recording in free motion.

    Attributes
    ----------
    push : (n, 2) array
        The missing push [m/s^2].
    against : dict of (n, c) arrays
        Values of each variable.
    since_rim : (n,) array
        Rows to the nearest one at the rim, before or after; infinite if there is none.
    """

    push: Array
    against: dict[str, Array]
    since_rim: Array

    def cut(self, kept: NDArray[np.bool_]) -> FreeRows:
        """Return some of the rows."""
        against = {name: values[kept] for name, values in self.against.items()}
        return FreeRows(self.push[kept], against, self.since_rim[kept])


class Regression:
    """The regression of a push on each variable.

    Parameters
    ----------
    parts : list of FreeRows
        Rows of each recording.
    seed : int
        Random seed of the shifts.
    """

    def __init__(self, parts: list[FreeRows], seed: int) -> None:
        self._seed = seed
        self._lengths = [len(one.push) for one in parts]
        self._push = np.concatenate([one.push for one in parts]) if parts else np.zeros((0, 2))
        against = {name: np.concatenate([one.against[name] for one in parts]) for name in VARIABLES if parts}
        #: Orthonormal basis (n, k) of functions of each variable.
        self._bases = {name: _basis(values) for name, values in against.items()}
        #: Waves over the board, (n, k), cosines and sines.
        self._waves = _waves(against["position"]) if parts else []

    @property
    def size(self) -> float:
        """RMS of the push [m/s^2]."""
        return float(np.sqrt((self._push**2).mean())) if len(self._push) else 0.0

    def dependences(self) -> list[Dependence]:
        """Return the dependences on each variable; none if there are too few rows."""
        if not self._push.any():
            return []
        random = np.random.default_rng([self._seed, 11])
        pushes = np.stack([self._push, *(self._shifted(random) for _ in range(SHIFTS))], axis=-1)
        pushes -= pushes.mean(axis=0)
        total = (pushes[..., 0] ** 2).sum()
        explained = [
            (name, sum(((basis.T @ pushes[:, axis]) ** 2).sum(axis=0) for axis in (0, 1)) / total)
            for name, basis in self._bases.items()
        ]
        of_waves = sum((wave.T @ pushes[:, axis]) ** 2 for wave in self._waves for axis in (0, 1))
        explained.append(("position", np.max(of_waves, axis=0) / total))
        heights = [_standardised(np.asarray(share)) for _, share in explained]
        highest = np.max([one[1:] for one in heights], axis=0)
        found = [
            Dependence(
                name,
                max(0.0, float(share[0] - np.mean(share[1:]))),
                float((1 + (highest >= height[0]).sum()) / (1 + SHIFTS)),
            )
            for (name, share), height in zip(explained, heights, strict=True)
        ]
        found.sort(key=lambda one: (one.p_value, -one.share))
        first: dict[str, Dependence] = {}
        for one in found:
            first.setdefault(one.variable, one)
        return list(first.values())

    def _shifted(self, random: np.random.Generator) -> Array:
        """Return the push of each recording, circularly shifted by a random number of rows."""
        ends = itertools.accumulate(self._lengths)
        return np.concatenate(
            [
                np.roll(self._push[end - length : end], int(random.integers(length)), axis=0)
                for end, length in zip(ends, self._lengths, strict=True)
            ]
        )


def smoothed(one: Scored) -> Smoothed:
    """Return the missing push of a set in each row of each recording."""
    problem = Scores.of(one).problem(one.effects)
    values = np.array([one.values[name] for name in problem.names])
    return problem.smooth(values, one.noise, one.top.states)


def _padded(values: Array, rows: int) -> Array:
    """Return the (k, 2) values of a recording's last rows, preceded by NaN, (rows, 2)."""
    return np.concatenate([np.full((rows - len(values), 2), np.nan), values])


def _free(one: Scored, found: Smoothed) -> Iterator[FreeRows]:
    """Yield the rows of each recording in free motion, if there are enough."""
    dataset, reach = one.dataset, one.fitted.model.reach
    for run, push in zip(dataset.runs, found.push, strict=True):
        if len(push) < FEWEST:
            continue
        path, velocity = path_and_velocity(run.observed)
        knobs = run.knobs[len(run.knobs) - len(push) :]
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        heading = velocity / np.maximum(speed, 1e-12)
        against = {
            "position": path,
            "velocity": velocity,
            "heading": np.concatenate([heading, heading[:, :1] * heading], axis=1),
            "command": knobs,
            "command rate": np.diff(knobs, axis=0, prepend=knobs[:1]),
            "time": np.arange(len(push), dtype=np.float64)[:, None],
        }
        at_rim = (np.abs(path) >= reach - FREE).any(axis=1)
        since_rim = _distance(np.flatnonzero(at_rim), len(push))
        free = np.isfinite(path).all(axis=1) & np.isfinite(push).all(axis=1)
        free &= ~at_rim & (speed[:, 0] > SLOW * dataset.noise)
        if free.sum() >= FEWEST:
            yield FreeRows(push, against, since_rim).cut(free)


def _distance(rows: NDArray[np.int64], count: int) -> Array:
    """Return the distance of each of `count` rows to the nearest of some rows, infinite if there is none."""
    if not len(rows):
        return np.full(count, np.inf)
    return np.asarray(np.abs(np.arange(count, dtype=np.float64)[:, None] - rows).min(axis=1))


def undisturbed(parts: list[FreeRows], pushes: list[Array]) -> Iterator[FreeRows]:
    """Yield the rows of each recording that are farther from the rim than twice the memory of the push.

    What an impact leaves has fallen to 2 % of its power there.
    """
    least = 2.0 * memory(pushes)
    for one in parts:
        kept = one.since_rim > least
        if kept.sum() >= FEWEST:
            yield one.cut(kept)


def memory(pushes: list[Array]) -> int:
    """Return the first lag [rows] at which the autocorrelation of (n, 2) pushes is below 1/e."""
    known = [np.nan_to_num(one) for one in pushes]
    power = sum(float((one**2).sum()) for one in known)
    lags = max((len(one) for one in known), default=0)
    for lag in range(1, lags):
        if sum(float((one[lag:] * one[:-lag]).sum()) for one in known) < power / math.e:
            return lag
    return lags


def _basis(values: Array) -> Array:
    """Return an orthonormal basis (n, k) of polynomials of (n, c) values, without their mean."""
    spread = values.std(axis=0)
    values = (values - values.mean(axis=0))[:, spread > 0.0] / spread[spread > 0.0]
    count = values.shape[1]
    powers = [
        power
        for power in itertools.product(range(POWER + 1), repeat=min(count, 2))
        if 0 < sum(power) <= POWER
    ]
    columns = [np.prod(values[:, : len(power)] ** power, axis=1) for power in powers] if count else []
    columns += [values[:, index] for index in range(2, count)]
    if not columns:
        return np.zeros((len(values), 0))
    matrix = np.column_stack(columns)
    matrix -= matrix.mean(axis=0)
    left, singular, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(left[:, singular > 1e-8 * max(float(singular.max()), 1e-300)])


def _waves(place: Array) -> list[Array]:
    """Return normalised cosines and sines (n, k) of waves in all directions over (n, 2) positions."""
    span = np.maximum(np.ptp(place, axis=0), 1e-12)
    numbers = [
        (i, j)
        for i in range(WAVES + 1)
        for j in range(-WAVES, WAVES + 1)
        if 0 < i * i + j * j <= WAVES**2 and (i > 0 or j > 0)
    ]
    angles = (place / span) @ (np.pi * np.array(numbers, dtype=np.float64).T)
    waves = [wave - wave.mean(axis=0) for wave in (np.cos(angles), np.sin(angles))]
    return [wave / np.maximum(np.linalg.norm(wave, axis=0), 1e-12) for wave in waves]


def _standardised(values: Array) -> Array:
    """Standardise values by the mean and standard deviation of all but the first."""
    return np.asarray((values - values[1:].mean()) / max(float(values[1:].std()), 1e-300))
