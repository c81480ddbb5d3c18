"""The score of a set of effects: the evidence of a simulator that has them, and is also pushed at random."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect, hypothetical
from irt.diagnosis import config
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.hypotheses import (
    ALIKE,
    JITTER,
    MAP,
    MEAN,
    SHIFT_S,
    SMOOTHED_S,
    SPIN,
    SPINNING,
    simulated,
)
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.terms import Term
from irt.engine import SUBSTEP_S
from irt.fitting.problem import Problem
from irt.fitting.solution import Probable
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Where the sizes of what is random stand, as `Problem.filter` takes them.
WHITE, LASTING, LASTING_S, PUSH, PULL, PULL_S, RESTITUTION, KICK, DEPARTURE, START_VELOCITY = range(10)

#: Effects that say when commands act: each has in it what steps in time differ by.
TIMES = ALIKE | {JITTER}


@dataclass(frozen=True, eq=False)
class Scored:
    """A set of effects beside the five parameters, at the top of its posterior.

    Attributes
    ----------
    case : Case
        The recordings, with what of the effects is held.
    effects : tuple of str
        In the order of addition.
    names : tuple of str
        Of the n parameters: the five, then ``effect.parameter``.
    top : Probable
        Values, deviations, sizes of what is random, likelihood and evidence.
    price : float
        What the choice of the set costs [nats].
    terms : tuple of Term
        Of what was learned, where that is among the effects.
    is_free : bool
        Whether the values are those of free runs, by least squares, and not of the filter.
    """

    case: Case
    effects: tuple[str, ...]
    names: tuple[str, ...]
    top: Probable
    price: float
    terms: tuple[Term, ...] = ()
    is_free: bool = False

    @property
    def score(self) -> float:
        """The log posterior of the set, up to a constant [nats]; none where delays would be negative.

        Delays that are never negative have a spread that is not much larger than their mean. Friction against
        spins is at its best, as what is random is: where it stands at none it has no width to integrate over.
        """
        if JITTER in self.effects and self.noise[KICK] > config.SPREAD * mean_delay(self.values):
            return -math.inf
        spin = self.names.index(SPIN)
        width = float(self.top.deviations[spin] / self.top.values[spin]) / _width_before()
        return self.top.log_evidence - self.price - math.log(width)

    @property
    def values(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.top.values.tolist(), strict=True))

    @property
    def noise(self) -> Array:
        """Sizes of what is random, as `Problem.filter` takes them, (10,)."""
        return np.asarray(self.top.noise)

    @functools.cached_property
    def fitted(self) -> Fitted:
        """Its free runs."""
        effects = simulated(self.effects)
        problem = self.case.problem(effects)
        values = np.array([self.values[name] for name in problem.names])
        return self.case.judge(effects, values[None])[0]


@functools.cache
def _width_before() -> float:
    """Return the deviation of the logarithm of the friction against spins before anything was seen."""
    (size,) = effect(SPINNING).required
    return math.log(size.high / size.low) / math.sqrt(12.0)


def mean_delay(values: Mapping[str, float]) -> float:
    """Return the mean of delays that differ [s]: the shift, and what the smoothing is late by."""
    return values[SHIFT_S] + values[SMOOTHED_S]


@dataclass(eq=False)
class Scores:
    """Scores of a case's sets, the best of each that was found.

    Attributes
    ----------
    case : Case
        The recordings, with what of the effects is held.
    terms : tuple of Term
        Of what is learned, where that is among the effects.
    known : dict
        The best of each set.
    """

    case: Case
    terms: tuple[Term, ...] = ()
    known: dict[frozenset[str], Scored] = field(default_factory=dict)

    @classmethod
    def of(cls, one: Scored) -> Scores:
        """Return scores of the sets that hold what a set does."""
        return cls(one.case, one.terms)

    def price(self, effects: Sequence[str]) -> float:
        """Return what the choice of a set costs [nats].

        One effect is expected, each of the catalogue as likely; and one term of the library, if any is there.
        Delays that differ are two effects: their mean, and their spread.
        """
        named = sum(name != UNLISTED for name in effects) + (JITTER in effects)
        learned = len(self.terms) if UNLISTED in effects else 0
        return named * math.log(len(hypothetical())) + learned * math.log(config.LIBRARY)

    def base(self) -> Scored:
        """Score the five parameters alone: from least squares, and from several sizes of what is random."""
        key: frozenset[str] = frozenset()
        if key not in self.known:
            values, noises = self._starts()
            found = self.ascend((), values, noises, iterations=config.FIRST_OF_BASE)
            found.sort(key=lambda one: -one.score)
            for one in found:
                self.ascend(
                    (), one.top.values[None], one.noise[None], one.top.states, iterations=config.THOROUGH
                )
            self._spun(self.known[key])
        return self.known[key]

    def _spun(self, one: Scored) -> None:
        """Fit a set from other frictions against spins: where one is strong enough, more changes nothing."""
        count = len(config.SPINNING)
        values = np.tile(one.top.values, (2 * count, 1))
        values[:, one.names.index(SPIN)] = np.tile(config.SPINNING, 2)
        noise = np.tile(one.noise, (len(values), 1))
        noise[count:] = quiet(noise[count:])
        self.ascend(one.effects, values, noise, one.top.states, iterations=config.THOROUGH)

    def problem(self, effects: Sequence[str]) -> Problem:
        """Return the problem of a set, and of a time by which engines that step in time are apart."""
        if set(effects) & TIMES:
            return self.case.grey_box(simulated(effects))
        return self.case.grey_box([MEAN, *simulated(effects)], within={SHIFT_S: (0.0, SUBSTEP_S)})

    def _starts(self) -> tuple[Array, Array]:
        """Return values and sizes of what is random to begin at: least squares, and the middle of ranges.

        Where much is missing least squares go far astray, but for the signs of the gears, and their size for
        a given time scale.
        """
        found = self.case.fit((), starts=6, rounds=1).values
        middle = found.copy()
        friction, time, scale = range(2, 5)
        if self.case.time_scale is None:
            middle[time] = np.mean(self.case.rig.ranges[PARAMETERS[time]])
            middle[:2] *= (found[time] / middle[time]) ** 2
        middle[friction] = np.mean(self.case.rig.ranges[PARAMETERS[friction]])
        middle[scale] = 1.0
        values, noises = [], []
        for begin, pushes in ((found, config.PUSHES[:-1]), (middle, config.PUSHES[1:])):
            for push in pushes:
                values.append([*begin, SUBSTEP_S / 2.0, config.SPINNING[1]])
                noises.append(self.noise(push))
        return np.array(values), np.array(noises)

    def noise(self, push: float) -> Array:
        """Return sizes of what is random to begin at, (10,)."""
        white, lasting = max(self.case.noise, 1e-5), max(self.case.noise, 1e-6)
        return np.array(
            [
                white,
                lasting,
                0.15,
                push,
                config.PULL,
                config.PULL_S,
                0.1,
                0.0,
                config.DEPARTURE,
                config.START_VELOCITY,
            ]
        )

    def ascend(
        self,
        effects: Sequence[str],
        values: Array,
        noise: Array,
        states: Array | None = None,
        *,
        iterations: int,
    ) -> list[Scored]:
        """Go uphill from (k, n) values, (k, 10) sizes and (s, 4) states; remember the best."""
        problem = self.problem(effects)
        tops = problem.ascend(
            values, noise, None if states is None else [states] * len(values), iterations=iterations
        )
        price = self.price(effects)
        terms = self.terms if UNLISTED in effects else ()
        found = [Scored(self.case, tuple(effects), problem.names, top, price, terms) for top in tops]
        for one in found:
            self.remember(one)
        return found

    def freed(self, one: Scored) -> Scored:
        """Return a set with the values to which free runs lead."""
        return replace(one, top=replace(one.top, values=self.least_squares(one)), is_free=True)

    def least_squares(self, one: Scored) -> Array:
        """Return the values of a set to which free runs lead from where it is, (n,); a map stays as it is."""
        effects, case = simulated(one.effects), self.case
        if MAP in effects:
            own = f"{MAP}."
            held = {key.removeprefix(own): one.values[key] for key in one.names if key.startswith(own)}
            case = case.holding(MAP, held)
        names = case.problem(effects).names
        found = case.fit(effects, points=np.array([[one.values[name] for name in names]]), rounds=0)
        values = one.values | dict(zip(names, found.values.tolist(), strict=True))
        return np.array([values[name] for name in one.names])

    def loss_without(self, one: Scored, sizes: Sequence[int]) -> float:
        """Return by how many nats a set is likelier with something random than without; infinite if unknown.

        Parameters
        ----------
        one : Scored
            The set.
        sizes : sequence of int
            Where the sizes that are to be zero stand, such as `PUSH`. A push that is no larger than what
            engines differ by is none.
        """
        if {PUSH, PULL}.issuperset(sizes) and (one.noise[[PUSH, PULL]] <= config.LITTLE[:2]).all():
            return 0.0
        problem = self.problem(one.effects)
        noise = one.noise.copy()
        if LASTING in sizes:
            noise[WHITE] = np.hypot(noise[WHITE], noise[LASTING])
        noise[list(sizes)] = 0.0
        (top,) = problem.ascend(
            self.from_where(problem, one)[None], noise[None], [one.top.states], iterations=config.THOROUGH
        )
        gain = one.top.log_likelihood - float(top.log_likelihood)
        return max(0.0, gain) if math.isfinite(gain) else math.inf

    def push(self, one: Scored) -> float:
        """Return by how many nats a set is likelier with a random push than without."""
        return self.loss_without(one, [PUSH, PULL])

    def remember(self, one: Scored) -> None:
        """Keep a set, if it is the best of its effects."""
        key = frozenset(one.effects)
        known = self.known.get(key)
        if known is None or one.score > known.score or math.isnan(known.score):
            self.known[key] = one

    @staticmethod
    def from_where(problem: Problem, source: Scored) -> Array:
        """Return the values that a set has of a problem, (n,); engines may be half a step apart."""
        values = source.values
        return np.array([values.get(name, SUBSTEP_S / 2.0) for name in problem.names])


def quiet(noise: Array) -> Array:
    """Return (k, 10) sizes with as little push, and chance at the rim, as on a rig that lacks nothing."""
    sizes = noise.copy()
    sizes[:, [PUSH, PULL, RESTITUTION]] = config.LITTLE
    return sizes
