"""Which set of effects is the most probable: effects are added, dropped and swapped while the score grows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.score import PUSH, Scored, Scores
from irt.diagnosis.screening import Promise, Screening

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

    def inclusion(self, name: str) -> float:
        """Return the probability that an effect is at work."""
        weights = np.exp([one.score - self.best.score for one in self.sets])
        with_it = [name in one.effects for one in self.sets]
        return float(weights[with_it].sum() / weights.sum())


@dataclass(eq=False)
class Selection:
    """A search for the most probable set among some effects."""

    scores: Scores
    names: Sequence[str]
    report: Report

    def run(self) -> Posterior:
        """Add what raises the score most, drop what became needless, then try others in each one's place."""
        best = self.scores.base()
        while True:
            grown = self._grown(best)
            if grown is None:
                swapped = self._swapped(best)
                if swapped is None:
                    break
                best = self._pruned(swapped)
            else:
                best = self._pruned(grown)
        ranked = sorted(self.scores.known.values(), key=lambda one: (-one.score, one.effects))
        return Posterior(best, tuple(ranked))

    def _grown(self, parent: Scored) -> Scored | None:
        """Return the best set with one effect more, if it is better."""
        names = [name for name in self.names if name not in parent.effects]
        child = self._best_child(parent, names, config.FITTED)
        return child if child is not None and child.score > parent.score + config.SURE else None

    def _best_child(self, parent: Scored, names: Sequence[str], count: int, beside: Sequence[Scored] = ()) -> Scored | None:
        promises = Screening(self.scores, parent).promises(names)
        found = [self._first(parent, promise) for promise in promises[:count]]
        found = [one for one in found if one is not None]
        found.sort(key=lambda one: -one.score)
        tops = [self.thorough(one) for one in found[:3]]
        return max(tops, key=lambda one: one.score, default=None)

    def _first(self, parent: Scored, promise: Promise) -> Scored | None:
        """Fit a set with one effect more for a few steps, from where it promises to explain most."""
        effects = (*parent.effects, promise.name)
        self.report(" + ".join(effects))
        noise = np.tile(parent.noise, (len(promise.starts), 1))
        found = self.scores.ascend(effects, promise.starts, noise, parent.top.states, iterations=config.FIRST)
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
        """Return a set without one of its effects, fitted from where the set is."""
        rest = tuple(other for other in one.effects if other != name)
        problem = self.scores.problem(rest)
        values = np.tile(self.scores.from_where(problem, one), (3, 1))
        noises = np.tile(one.noise, (3, 1))
        noises[1:, PUSH] = 1e-6, 1e-4
        self.scores.ascend(rest, values, noises, one.top.states, iterations=config.THOROUGH)
        return self.scores.known[frozenset(rest)]

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
            names = [other for other in self.names if other not in one.effects]
            child = self._best_child(less, names, 5)
            if child is not None and child.score > one.score + 0.5:
                return child
        return None
