"""Which set of effects is the most probable: effects are added, dropped and swapped while the score grows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.hypotheses import JITTER, MEAN, SMOOTHED
from irt.diagnosis.score import KICK, PUSH, Scored, Scores
from irt.diagnosis.screening import Promise, Screening, child

Report = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Posterior:
    """The sets that were scored, and how probable each is.

    Attributes
    ----------
    best : Scored
        The most probable set.
    sets : tuple of Scored
        All, the most probable first.
    """

    best: Scored
    sets: tuple[Scored, ...]

    def any_of(self, names: Sequence[str]) -> float:
        """Return the probability that one of these effects is at work, or several."""
        highest = max(one.score for one in self.sets)
        weights = np.exp([one.score - highest for one in self.sets])
        with_it = [not set(names).isdisjoint(one.effects) for one in self.sets]
        return float(weights[with_it].sum() / weights.sum())

    def probabilities(self) -> dict[str, float]:
        """Return the probability of each effect that was tried, as far as it is worth a mention."""
        names = sorted({name for one in self.sets for name in one.effects})
        found = {name: self.any_of([name]) for name in names}
        return {name: chance for name, chance in found.items() if chance > config.MENTIONED}


@dataclass(eq=False)
class Selection:
    """A search for the most probable set among some effects."""

    scores: Scores
    names: Sequence[str]
    report: Report
    _without: dict[tuple[frozenset[str], str, float], Scored] = field(default_factory=dict)

    def run(self) -> Posterior:
        """Add what raises the score most, drop what became needless, then try others in each one's place."""
        best = self.scores.base()
        seen: set[frozenset[str]] = set()
        # A set that comes back has a better top than before, and leads nowhere else.
        while frozenset(best.effects) not in seen:
            seen.add(frozenset(best.effects))
            better = self._grown(best) or self._swapped(best)
            if better is not None:
                best = self._pruned(better)
        scored = [one for one in self.scores.known.values() if math.isfinite(one.score)]
        return Posterior(best, tuple(sorted(scored, key=lambda one: (-one.score, one.effects)) or [best]))

    def _grown(self, parent: Scored) -> Scored | None:
        """Return the best set with one effect more, if it is better."""
        names = self._other(parent)
        better = self._best_child(parent, names, config.FITTED)
        return better if better is not None and better.score > parent.score + config.SURE else None

    def _other(self, one: Scored) -> list[str]:
        """Return the effects that a set lacks."""
        held = {*one.effects, *(SMOOTHED if JITTER in one.effects else ())}
        return [name for name in self.names if name not in held]

    def _best_child(self, parent: Scored, names: Sequence[str], count: int) -> Scored | None:
        """Return the best set with one effect more, of those that promise most."""
        promises = Screening(self.scores, parent).promises(names)
        tried = (self._first(parent, promise) for promise in promises[:count])
        found = sorted((one for one in tried if one is not None), key=lambda one: -one.score)
        tops = [self.thorough(one) for one in found[: config.TOPS]]
        return max(tops, key=lambda one: one.score, default=None)

    def _first(self, parent: Scored, promise: Promise) -> Scored | None:
        """Fit a set with one effect more for a few steps, from where it promises to explain most."""
        effects = child(parent.effects, promise.name)
        self.report(" + ".join(effects))
        found = self.scores.ascend(
            effects, promise.starts, promise.noise, parent.top.states, iterations=config.FIRST
        )
        found = [one for one in found if math.isfinite(one.score)]
        return max(found, key=lambda one: one.score, default=None)

    def thorough(self, one: Scored) -> Scored:
        """Fit a set from where it is, and with a small and a middling push."""
        noises = np.tile(one.noise, (3, 1))
        noises[1:, PUSH] = 1e-8, 1e-5
        values = np.tile(one.top.values, (3, 1))
        self.scores.ascend(one.effects, values, noises, one.top.states, iterations=config.THOROUGH)
        return self.scores.known[frozenset(one.effects)]

    def without(self, one: Scored, name: str) -> Scored:
        """Return a set without one of its effects, fitted from where the set is; of jitter the mean stays."""
        key = (frozenset(one.effects), name, one.score)
        if key in self._without:
            return self._without[key]
        rest = tuple(other for other in one.effects if other != name)
        if name == JITTER:
            rest = (*rest, MEAN)
        problem = self.scores.problem(rest)
        values = np.tile(self.scores.from_where(problem, one), (3, 1))
        noises = np.tile(one.noise, (3, 1))
        noises[1:, PUSH] = 1e-6, 1e-4
        if name == JITTER:
            noises[:, KICK] = 0.0
        self.scores.ascend(rest, values, noises, one.top.states, iterations=config.THOROUGH)
        self._without[key] = self.scores.known[frozenset(rest)]
        return self._without[key]

    def _pruned(self, one: Scored) -> Scored:
        """Drop effects that are worth nothing beside the others."""
        for name in one.effects:
            less = self.without(one, name)
            if less.score > one.score - config.SURE:
                return self._pruned(less)
        return one

    def _swapped(self, one: Scored) -> Scored | None:
        """Return a better set with another effect in the place of one, if there is any."""
        for name in one.effects:
            less = self.without(one, name)
            names = [other for other in self._other(less) if other not in one.effects]
            better = self._best_child(less, names, config.SWAPPED)
            if better is not None and better.score > one.score + config.BETTER:
                return better
        return None
