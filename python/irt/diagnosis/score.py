"""The score of a set of effects: the evidence of a simulator that has them, and is also pushed at random."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import hypothetical
from irt.diagnosis import config
from irt.diagnosis.case import Case
from irt.engine import SUBSTEP_S
from irt.fitting.problem import Problem
from irt.fitting.solution import Probable
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Where the sizes of what is random stand, as `Problem.filter` takes them.
WHITE, LASTING, LASTING_S, PUSH, PULL, PULL_S, RESTITUTION, START_VELOCITY = range(8)


#: Effects that say when commands act: each has in it what steps in time differ by.
TIMES = frozenset({"delay", "latency"})


@dataclass(frozen=True, eq=False)
class Scored:
    """A set of effects beside the five parameters, at the top of its posterior.

    Attributes
    ----------
    effects : tuple of str
        In the order of addition.
    names : tuple of str
        Of the n parameters: the five, then ``effect.parameter``.
    top : Probable
        Values, deviations, sizes of what is random, likelihood and evidence.
    """

    effects: tuple[str, ...]
    names: tuple[str, ...]
    top: Probable

    @property
    def score(self) -> float:
        """The log posterior of the set, up to a constant [nats]."""
        return self.top.log_evidence - price(len(self.effects))

    @property
    def values(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.top.values.tolist(), strict=True))

    @property
    def noise(self) -> Array:
        """Sizes of what is random, as `Problem.filter` takes them, (8,)."""
        return np.asarray(self.top.noise)


def price(effects: int) -> float:
    """Return what a set of so many effects costs [nats]: one is expected, each of the catalogue as likely."""
    return effects * math.log(len(hypothetical()))


@dataclass(eq=False)
class Scores:
    """Scores of a case's sets, the best of each that was found."""

    case: Case
    known: dict[frozenset[str], Scored] = field(default_factory=dict)

    def base(self) -> Scored:
        """Score the five parameters alone: from least squares, and from several sizes of what is random."""
        key: frozenset[str] = frozenset()
        if key not in self.known:
            values, noises = self._starts()
            found = self.ascend((), values, noises, iterations=config.FIRST_OF_BASE)
            found.sort(key=lambda one: -one.score)
            for one in found[: config.TOPS]:
                self.ascend(
                    (), one.top.values[None], one.noise[None], one.top.states, iterations=config.THOROUGH
                )
        return self.known[key]

    def problem(self, effects: Sequence[str]) -> Problem:
        """Return the problem of a set, and of a time by which engines that step in time are apart."""
        if set(effects) & TIMES:
            return self.case.problem(effects)
        return self.case.problem(["delay", *effects], within={"delay.delay_s": (0.0, SUBSTEP_S)})

    def _starts(self) -> tuple[Array, Array]:
        """Return values and sizes of what is random to begin at: least squares, and the middle of ranges.

        Where much is missing least squares go far astray, but for the signs of the gears, and their size for
        a given clock.
        """
        found = self.case.fit((), starts=6, rounds=1).values
        middle = found.copy()
        friction, clock, scale = range(2, 5)
        if self.case.time_scale is None:
            middle[clock] = np.mean(self.case.rig.ranges[PARAMETERS[clock]])
            middle[:2] *= (found[clock] / middle[clock]) ** 2
        middle[friction] = np.mean(self.case.rig.ranges[PARAMETERS[friction]])
        middle[scale] = 1.0
        values, noises = [], []
        for begin, pushes in ((found, config.PUSHES[:-1]), (middle, config.PUSHES[1:])):
            for push in pushes:
                values.append([*begin, SUBSTEP_S / 2.0])
                noises.append(self.noise(push, self.case.noise))
        return np.array(values), np.array(noises)

    def noise(self, push: float, lasting: float) -> Array:
        """Return sizes of what is random to begin at, (8,)."""
        white = max(self.case.noise, 1e-5)
        return np.array(
            [white, max(lasting, 1e-6), 0.15, push, config.PULL, config.PULL_S, 0.1, config.START_VELOCITY]
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
        """Go uphill from (k, n) values, (k, 8) sizes and (s, 4) states; remember the best."""
        problem = self.problem(effects)
        tops = problem.ascend(
            values, noise, None if states is None else [states] * len(values), iterations=iterations
        )
        found = [Scored(tuple(effects), problem.names, top) for top in tops]
        for one in found:
            self.remember(one)
        return found

    def push(self, one: Scored) -> float:
        """Return by how many nats a set is likelier with a random push than without; infinite if unknown."""
        problem = self.problem(one.effects)
        noise = one.noise.copy()
        noise[[PUSH, PULL]] = 0.0
        (top,) = problem.ascend(
            self.from_where(problem, one)[None], noise[None], [one.top.states], iterations=config.THOROUGH
        )
        gain = one.top.log_likelihood - float(top.log_likelihood)
        return max(0.0, gain) if math.isfinite(gain) else math.inf

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
