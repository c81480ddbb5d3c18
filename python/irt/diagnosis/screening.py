"""Screening: estimate to first order, from random draws, which effects could explain residuals."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectInfo, effect
from irt.diagnosis import config
from irt.diagnosis.hypotheses import JITTER, SHIFT_S, SIZES_OF_TIMES, SMOOTHED, SMOOTHED_S
from irt.diagnosis.score import KICK, Scored, Scores, start_unknown
from irt.engine import SUBSTEP_S
from irt.fitting.effect_size import size_of, sizes_of
from irt.fitting.problem import Problem, in_unit_of
from irt.fitting.solution import Filtered

Array = NDArray[np.float64]

#: Parameters that are a place on the board.
PLACE = ("x_m", "y_m")
#: Degrees of freedom of the tracker's errors, as in the engine's filter.
TAIL = 4.0
#: Step of finite differences, as a share of a parameter's range.
STEP = 1e-4
#: Smallest size drawn, as a share of the largest.
SMALLEST = 0.02
#: Spreads of a map's coefficients to try, as shares of their range.
SPREADS = np.geomspace(1e-3, 1.0, 31)


@dataclass(frozen=True, eq=False)
class Promise:
    """An effect with its screened gain and start values.

    Attributes
    ----------
    name : str
        Name of the effect.
    gain : float
        Estimated gain [nats].
    starts : (k, n) array
        Start values.
    noise : (k, 14) array
        Start noise sizes.
    """

    name: str
    gain: float
    starts: Array
    noise: Array


class Screening:
    """The residuals of a set, and their derivatives with its parameters.

    Parameters
    ----------
    scores : Scores
        Scores of the sets.
    parent : Scored
        The set.
    place : (float, float), optional
        A place on the board [m] at which effects that have one are tried besides.
    """

    def __init__(self, scores: Scores, parent: Scored, place: tuple[float, float] | None = None) -> None:
        self._scores, self._parent, self._place = scores, parent, place
        self._dataset = scores.dataset
        problem = scores.problem(parent.effects)
        here = np.array([parent.values[name] for name in problem.names])
        span = problem.ranges[:, 1] - problem.ranges[:, 0]
        free = [
            index for index in range(len(here)) if parent.top.deviations[index] > 0.0 and span[index] > 0.0
        ]
        moved = np.tile(here, (1 + len(free), 1))
        for row, index in enumerate(free, start=1):
            moved[row, index] += STEP * span[index]
        found = self._predicted(problem, moved, np.tile(parent.noise, (len(moved), 1)))
        seen = self._seen_of(found[0])
        predicted = [_joined(each.predicted, each.tilt) for each in found]
        variance = _joined(found[0].variance, found[0].tilt_variance)
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

    def _seen_of(self, one: Filtered) -> Array:
        """Return what was measured, in the order of `_joined`."""
        tilts = [
            predicted if run.tilt is None else run.tilt[: len(predicted)]
            for run, predicted in zip(self._dataset.runs, one.tilt, strict=True)
        ]
        return _joined([run.observed for run in self._dataset.runs], tilts)

    def promises(self, names: Sequence[str]) -> list[Promise]:
        """Return the screened effects, the largest gain first."""
        found = [self._promise_of(name) for name in names]
        return sorted(found, key=lambda one: -one.gain)

    def _promise_of(self, name: str) -> Promise:
        if name == JITTER:
            return self._of_jitter()
        return self._of_map(name) if effect(name).shrunk else self._promise(name)

    def _of_map(self, name: str) -> Promise:
        """Screen a map: its coefficients have one normal distribution of the best size."""
        steps = np.array([STEP * (one.high - one.low) for one in effect(name).required])
        own, values, found = self._filtered(name, np.diag(steps))
        slopes = np.array([self._change(one) for one in found]) / steps[:, None]
        spreads, vectors = np.linalg.eigh(slopes @ slopes.T)
        along = vectors.T @ (slopes @ self._off)
        variances = (SPREADS * steps.max() / STEP) ** 2
        shrunk = variances[:, None] / (1.0 + variances[:, None] * np.maximum(spreads, 0.0))
        gains = 0.5 * (shrunk * along**2 + np.log(shrunk / variances[:, None])).sum(axis=1)
        best = int(np.argmax(gains))
        start = values[:1].copy()
        start[0, own:] = vectors @ (shrunk[best] * along)
        return Promise(name, float(gains[best]), start, self._parent.noise[None])

    def _of_jitter(self) -> Promise:
        """Screen delay jitter: try each spread and mean."""
        problem = self._scores.problem(child(self._parent.effects, JITTER))
        shift, smoothing = (problem.names.index(one) for one in (SHIFT_S, SMOOTHED_S))
        known = sum(self._parent.values.get(one, 0.0) for one in SIZES_OF_TIMES.values())
        means = [known] if known > SUBSTEP_S else list(config.MEANS)
        tried = list(itertools.product(means, config.KICKS))
        values = np.tile([self._parent.values.get(one, 0.0) for one in problem.names], (len(tried), 1))
        noise = np.tile(self._parent.noise, (len(tried), 1))
        mean, spread = np.array(tried).T
        values[:, smoothing] = np.minimum(spread, mean)
        values[:, shift], noise[:, KICK] = mean - values[:, smoothing], spread
        found = self._predicted(problem, values, noise)
        gains = np.array([float(one.log_likelihood.sum()) - self._likelihood for one in found])
        gains = np.where(np.isfinite(gains), gains, -np.inf)
        best = np.argsort(-gains)[: config.STARTS]
        return Promise(JITTER, float(gains[best[0]]), values[best], noise[best])

    def _promise(self, name: str) -> Promise:
        info = in_unit_of(self._dataset.rig, effect(name))
        drawn = draws(info, config.DRAWS, self._dataset.seed)
        columns = place_columns(name)
        if self._place is not None and columns:
            there = drawn.copy()
            there[:, columns] = self._place
            drawn = np.concatenate([drawn, there])
        own, values, found = self._filtered(name, drawn)
        changes = np.array([self._change(one) for one in found])
        for _ in range(config.FINER if values.shape[1] == own + 1 else 0):
            between = _between(values[:, own], changes)
            if not len(between):
                break
            _, more, of_more = self._filtered(name, between[:, None])
            values, found = np.concatenate([values, more]), [*found, *of_more]
            changes = np.concatenate([changes, [self._change(one) for one in of_more]])
        actual, linear, share = np.full((3, len(values)), 0.0)
        for index, (one, change) in enumerate(zip(found, changes, strict=True)):
            actual[index] = float(one.log_likelihood.sum()) - self._likelihood
            square, along = float(change @ change), float(change @ self._off)
            if square > 1e-9:
                amount = along / square
                share[index] = amount
                amount = np.clip(amount, -3.0 if _both_ways(name) else 0.0, 3.0)
                linear[index] = amount * along - 0.5 * amount * amount * square
        scaled = self._scaled(info, own, values, share)
        best = [*np.argsort(-linear)[: config.STARTS], int(np.argmax(actual))]
        starts = [scaled[best[0]], values[best[-1]], *(scaled[index] for index in best[1:-1])]
        gain = float(max(linear.max(), actual.max()))
        noise = np.tile(self._parent.noise, (len(starts), 1))
        return Promise(name, gain if np.isfinite(gain) else -np.inf, np.array(starts), noise)

    def shown(self, name: str, values: Array) -> Array:
        """Return the expected gain [nats] of (k, p) values of an effect if they were true, (k,)."""
        changes = [self._change(one) for one in self._filtered(name, values)[2]]
        return np.array([0.5 * float(change @ change) for change in changes])

    def _filtered(self, name: str, drawn: Array) -> tuple[int, Array, list[Filtered]]:
        """Predict with (k, p) values of one more effect; return their column, values (k, n), predictions."""
        problem = self._scores.problem(child(self._parent.effects, name))
        own = next(i for i, one in enumerate(problem.names) if one.startswith(f"{name}."))
        count = len(drawn)
        values = np.tile([self._parent.values.get(one, 0.0) for one in problem.names], (count, 1))
        values[:, own:] = drawn
        noise = np.tile(self._parent.noise, (count, 1))
        return own, values, self._predicted(problem, values, noise)

    def _predicted(self, problem: Problem, values: Array, noise: Array) -> list[Filtered]:
        begun = start_unknown(self._dataset, noise, [self._parent.top.states] * len(values))
        return problem.filter(values, *begun)

    def _change(self, one: Filtered) -> Array:
        """Return the difference of predictions from the set's, beyond changes of its own parameters."""
        moved = _joined(one.predicted, one.tilt)[self._kept]
        return self._across((moved - self._here) / self._scale * self._root)

    @staticmethod
    def _scaled(info: EffectInfo, own: int, values: Array, share: Array) -> Array:
        """Return draws with their size scaled to the best fit, within their ranges."""
        scaled = values.copy()
        known = info.required
        size = size_of(info.name)
        for index, one in enumerate(known):
            if one.is_choice or not np.isfinite(one.neutral) or (size is not None and index != size):
                continue
            column = own + index
            moved = one.neutral + share * (values[:, column] - one.neutral)
            scaled[:, column] = np.clip(moved, max(one.low, one.least), min(one.high, one.most))
        return scaled

    def _across(self, vector: Array) -> Array:
        """Return a vector without its components along the set's own parameters."""
        return np.asarray(vector - self._basis @ (self._basis.T @ vector))


def _joined(places: Sequence[Array], tilts: Sequence[Array]) -> Array:
    """Return places of all recordings, then tilts, in one vector."""
    return np.concatenate([one.ravel() for one in (*places, *tilts)])


def _between(values: Array, changes: Array) -> Array:
    """Return midpoints between adjacent (k,) values whose changes (k, rows) are uncorrelated.

    An example are step sizes of a knob, whose changes are uncorrelated at a difference of 1 %. Only changes
    that would be detected if they were true are considered.
    """
    order = np.argsort(values)
    values, changes = values[order], changes[order]
    sizes = np.sqrt((changes**2).sum(axis=1))
    seen = 0.5 * np.minimum(sizes[:-1], sizes[1:]) ** 2 > config.SURE
    alike = (changes[:-1] * changes[1:]).sum(axis=1) > np.sqrt(0.5) * sizes[:-1] * sizes[1:]
    return np.asarray(0.5 * (values[:-1] + values[1:])[seen & ~alike])


def child(effects: Sequence[str], name: str) -> tuple[str, ...]:
    """Return a set with one more effect; delay jitter replaces the effects that it includes."""
    kept = [one for one in effects if name != JITTER or one not in SMOOTHED]
    return (*kept, name)


def place_columns(name: str) -> list[int]:
    """Return the indices of an effect's place among its parameters, x first; none if it has no place."""
    names = [one.name for one in effect(name).required]
    return [names.index(one) for one in PLACE] if set(PLACE) <= set(names) else []


def place_of(name: str, values: Mapping[str, float]) -> tuple[float, float] | None:
    """Return the place of an effect on the board [m], if it has one."""
    if not place_columns(name):
        return None
    x, y = (values[f"{name}.{one}"] for one in PLACE)
    return x, y


def _both_ways(name: str) -> bool:
    """Whether an effect may have either sign."""
    return all(one.low < one.neutral < one.high for one in sizes_of(name))


def draws(info: EffectInfo, count: int, seed: int) -> Array:
    """Draw values of an effect, (count, p): sizes log-uniformly, other parameters uniformly."""
    from scipy.stats import qmc  # noqa: PLC0415

    known = info.required
    size = size_of(info.name)
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
