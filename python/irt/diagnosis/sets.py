"""Scored sets of effects: how probable they are, and which differ by one effect."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.hypotheses import ALIKE, JITTER
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import Array, Scored, Scores


@dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior over the scored sets.

    Attributes
    ----------
    best : Scored
        The most probable set.
    sets : tuple of Scored
        All scored sets, the most probable first.
    """

    best: Scored
    sets: tuple[Scored, ...]

    def any_of(self, names: Sequence[str]) -> float:
        """Return the probability that at least one of these effects acts."""
        with_it = [not set(names).isdisjoint(one.effects) for one in self.sets]
        # Rounding may raise the sum above 1.
        return min(1.0, float(probabilities([one.score for one in self.sets])[with_it].sum()))

    def beside(self, one: Scored) -> Posterior:
        """Return the posterior with one more set, which is the most probable one."""
        return Posterior(one, (one, *self.sets))

    def likely(self, answer: Scored, renamed: Sequence[Scored] = ()) -> list[tuple[Scored, float]]:
        """Return the sets that are worth a mention, with probabilities that add up to 1.

        Parameters
        ----------
        answer : Scored
            The answer, which comes first. It lacks effects that do not matter to held-out errors, which may
            still be present, and it may predict better than a set of higher score. Therefore it gets the
            probability of the most probable set.
        renamed : sequence of Scored
            The answer with another name of an effect; these get the same probability.
        """
        most = max([answer.score, *(one.score for one in self.sets)])
        scores = dict.fromkeys([answer, *renamed], most)
        known = {frozenset(one.effects) for one in scores}
        scores |= {one: one.score for one in self.sets if frozenset(one.effects) not in known}
        chances = probabilities(list(scores.values())).tolist()
        pairs = zip(scores, chances, strict=True)
        found = [pair for pair in pairs if pair[1] > config.MENTIONED][: config.PLAUSIBLE]
        total = sum(chance for _, chance in found)
        return [(one, chance / total) for one, chance in found]

    def probabilities(self, immaterial: Container[str]) -> dict[str, float]:
        """Return the probabilities of effects of the catalogue above `config.MENTIONED`.

        Parameters
        ----------
        immaterial : container of str
            Effects to leave out because they do not matter: they describe differences between engines.
        """
        names = {name for one in self.sets for name in one.effects if name not in immaterial} - {UNLISTED}
        found = {name: self.any_of([name]) for name in sorted(names)}
        return {name: chance for name, chance in found.items() if chance > config.MENTIONED}


def probabilities(scores: Sequence[float]) -> Array:
    """Return normalised probabilities, (k,), from log posteriors."""
    weights = np.exp(np.array(scores) - max(scores))
    return np.asarray(weights / weights.sum())


def renamed(one: Scored, name: str) -> Scored:
    """Return a set with the same values, with one effect replaced by its equivalent in `ALIKE`.

    With a random push, the likelihood does not distinguish the two fairly: the filter applies an observation
    to the current state, not to the state at the time of an old picture, which penalises true latencies.
    """
    (instead,) = ALIKE - {name}
    effects = tuple(instead if each == name else each for each in one.effects)
    return replace(one, effects=effects, names=Scores.of(one).problem(effects).names)


def exchange(one: Scored, other: Scored) -> tuple[str, str]:
    """Return the effect that another set lacks and its replacement; empty unless exactly one is replaced."""
    gone, instead = set(one.effects) - set(other.effects), set(other.effects) - set(one.effects)
    return (gone.pop(), instead.pop()) if len(gone) == len(instead) == 1 else ("", "")


def is_rival(one: Scored, other: Scored) -> bool:
    """Whether another set is about as probable, with one effect replaced; jittered delays have no rival."""
    gone, instead = exchange(one, other)
    return bool(gone) and JITTER not in {gone, instead} and one.score - other.score <= config.CLOSE
