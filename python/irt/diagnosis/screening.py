"""Which effects might explain what a set leaves over: a look at draws of each, to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from irt.catalogue import effect
from irt.diagnosis import config
from irt.diagnosis.score import Scored, Scores
from irt.fitting.effect_size import size_of

Array = NDArray[np.float64]

#: Degrees of freedom of the tracker's errors, as in the engine's filter.
TAIL = 4.0
#: Step of finite differences, as a share of a parameter's range.
STEP = 1e-4
#: Smallest size drawn, as a share of the largest.
SMALLEST = 0.02


@dataclass(frozen=True, eq=False)
class Promise:
    """An effect, by how many nats it might help to first order, and values to begin at."""

    name: str
    gain: float
    starts: Array


class Screening:
    """What a set leaves over, and how its own parameters would change that."""

    def __init__(self, scores: Scores, parent: Scored) -> None:
        self._scores, self._parent = scores, parent
        self._case = scores.case
        problem = scores.problem(parent.effects)
        here = np.array([parent.values[name] for name in problem.names])
        span = problem.ranges[:, 1] - problem.ranges[:, 0]
        free = [
            index for index in range(len(here)) if parent.top.deviations[index] > 0.0 and span[index] > 0.0
        ]
        moved = np.tile(here, (1 + len(free), 1))
        for row, index in enumerate(free, start=1):
            moved[row, index] += STEP * span[index]
        found = problem.filter(
            moved, np.tile(parent.noise, (len(moved), 1)), [parent.top.states] * len(moved)
        )
        seen = np.concatenate([one.observed.ravel() for one in self._case.segments])
        predicted = [np.concatenate([one.ravel() for one in each.predicted]) for each in found]
        variance = np.concatenate([one.ravel() for one in found[0].variance])
        self._kept = np.isfinite(seen) & np.isfinite(variance)
        self._seen = seen[self._kept]
        self._here = predicted[0][self._kept]
        self._scale = np.sqrt(variance[self._kept])
        self._likelihood = float(found[0].log_likelihood.sum())
        off = (self._seen - self._here) / self._scale
        root = np.sqrt((TAIL + 1.0) / (TAIL + off * off))
        self._root = root
        slopes = np.array([(each[self._kept] - self._here) / self._scale * root for each in predicted[1:]]).T
        self._basis = np.linalg.qr(slopes)[0] if slopes.size else np.zeros((len(off), 0))
        self._off = self._across(off * root)

    def promises(self, names: Sequence[str]) -> list[Promise]:
        """Return what each effect might do, the most promising first."""
        found = [self._promise(name) for name in names]
        return sorted(found, key=lambda one: -one.gain)

    def _promise(self, name: str) -> Promise:
        problem = self._scores.problem([*self._parent.effects, name])
        own = next(i for i, one in enumerate(problem.names) if one.startswith(f"{name}."))
        drawn = draws(name, config.DRAWS, self._case.seed)
        values = np.tile(
            np.array([self._parent.values.get(one, 0.0) for one in problem.names]), (len(drawn), 1)
        )
        values[:, own:] = drawn
        found = problem.filter(
            values,
            np.tile(self._parent.noise, (len(values), 1)),
            [self._parent.top.states] * len(values),
        )
        actual, linear, share = np.full((3, len(values)), 0.0)
        for index, one in enumerate(found):
            actual[index] = float(one.log_likelihood.sum()) - self._likelihood
            moved = np.concatenate([each.ravel() for each in one.predicted])[self._kept]
            change = self._across((moved - self._here) / self._scale * self._root)
            square, along = float(change @ change), float(change @ self._off)
            if square > 1e-9:
                amount = along / square
                share[index] = amount
                amount = np.clip(amount, -3.0 if _both_ways(name) else 0.0, 3.0)
                linear[index] = amount * along - 0.5 * amount * amount * square
        scaled = self._scaled(name, own, values, share)
        best = [*np.argsort(-linear)[: config.STARTS], int(np.argmax(actual))]
        starts = [scaled[best[0]], values[best[-1]], *(scaled[index] for index in best[1:-1])]
        gain = float(max(linear.max(), actual.max()))
        return Promise(name, gain if np.isfinite(gain) else -np.inf, np.array(starts))

    def _scaled(self, name: str, own: int, values: Array, share: Array) -> Array:
        """Return draws with their size as large as explains most, within their ranges."""
        scaled = values.copy()
        known = effect(name).required
        size = size_of(name)
        for index, one in enumerate(known):
            if one.is_choice or not np.isfinite(one.neutral) or (size is not None and index != size):
                continue
            column = own + index
            moved = one.neutral + share * (values[:, column] - one.neutral)
            scaled[:, column] = np.clip(moved, max(one.low, one.least), min(one.high, one.most))
        return scaled

    def _across(self, vector: Array) -> Array:
        """Return what the set's own parameters cannot make up for."""
        return np.asarray(vector - self._basis @ (self._basis.T @ vector))


def _both_ways(name: str) -> bool:
    """Whether an effect may be of either sign."""
    size = size_of(name)
    required = effect(name).required
    asked = required if size is None else (required[size],)
    return all(one.low < one.neutral < one.high for one in asked)


def draws(name: str, count: int, seed: int) -> Array:
    """Draw values of an effect, (count, p): its sizes log-uniformly, everything else over its range."""
    known = effect(name).required
    size = size_of(name)
    cube = qmc.Sobol(2 * len(known), seed=np.random.default_rng([seed, 7])).random(count)
    drawn = np.empty((count, len(known)))
    for index, one in enumerate(known):
        place, side = cube[:, 2 * index], cube[:, 2 * index + 1]
        beside = size is not None and index != size and len(known) > 1
        if one.is_choice:
            drawn[:, index] = np.where(place < 0.5, *one.choices)
        elif beside or not np.isfinite(one.neutral):
            drawn[:, index] = one.low + place * (one.high - one.low)
        else:
            up = side < (one.high - one.neutral) / (one.high - one.low)
            end = np.where(up, one.high, one.low)
            drawn[:, index] = one.neutral + (end - one.neutral) * SMALLEST**place
    return drawn
