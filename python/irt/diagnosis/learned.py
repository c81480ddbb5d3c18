"""Learn a correction for physics outside the catalogue, as a formula inside the model.

The library term that explains most of the residuals is fitted inside the simulator together with everything
else, and the procedure repeats on the new residuals. Terms, effects and a random push compete by one score.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnosis import config
from irt.diagnosis.maxima import distinct
from irt.diagnosis.regressors import terms_of_motion, terms_of_residuals
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import DEPARTURE, PUSH, RESTITUTION, Scored, Scores
from irt.diagnosis.selection import Report
from irt.diagnosis.terms import AT_RIM, Term, forces_at_rim, in_slots, turning_picture

Array = NDArray[np.float64]


@dataclass(eq=False)
class Corrections:
    """Learned corrections of sets. Those of `of` are kept, because search and answer ask for them.

    Attributes
    ----------
    scores : Scores
        Scores of the sets.
    report : callable
        Called with the name of the next step.
    """

    scores: Scores
    report: Report
    _known: dict[Scored, Scored | None] = field(default_factory=dict)
    _of_one_term: dict[Scored, Scored | None] = field(default_factory=dict)

    def of(self, parent: Scored) -> Scored | None:
        """Return a set with a learned correction, or None if no term is worth its price."""
        if parent not in self._known:
            self._known[parent] = _learned(parent, self._with_one_term(parent), self._another, Scores.push)
        return self._known[parent]

    def at_rim(self, parent: Scored) -> Scored | None:
        """Return a set with forces at the rim, or None if none is worth its price."""
        first = self._force_at_rim(parent, parent)
        return _learned(parent, first, self._force_at_rim, Scores.rebounds)

    def _with_one_term(self, parent: Scored) -> Scored | None:
        if parent not in self._of_one_term:
            self._of_one_term[parent] = self._another(parent, parent)
        return self._of_one_term[parent]

    def alone(self) -> Scored | None:
        """Return the best correction in place of all effects, or None.

        Where much physics is missing, correlated noise or a push may be the whole path at the highest maximum
        of the five parameters, and no residual shows what is missing. Maxima whose free runs err clearly less
        therefore compete.
        """
        base = self.scores.base()
        others = [one for one in self.scores.fits_of_base if base.errs_more_than(one.fitted.noise)]
        learned = [self.of(one) for one in (base, *distinct(self.scores, others))]
        found = [one for one in learned if one is not None]
        return max(found, key=lambda one: one.score, default=None)

    def beat(self, best: Scored, is_last: bool) -> bool:
        """Whether a correction is complete, and far more probable than a set that is not.

        What one term explains has one cause, and more effects could only imitate it. But two of a kind, such
        as drags, may be one term, so that two must have been tried. Several terms may imitate several
        effects, and count if no further effect helps (`is_last`): then the correction is learned anyway,
        unless little of the error remains.
        """
        if self.scores.is_whole(best):
            return False
        if is_last and best.fitted.noise < config.WORTH * self.scores.base().fitted.noise:
            return False
        found = [self.alone(), self.of(best)] if is_last else [self._with_one_term(self.scores.base())]
        far = [one for one in found if one is not None and one.score > best.score + config.NEAR]
        return any(Scores.of(one).is_whole(one) for one in far)

    def _another(self, parent: Scored, now: Scored) -> Scored | None:
        """Return the most probable set with one more term.

        A picture that turns and forces at the rim are always tried. Residuals of predictions are looked at
        only if neither these nor a term that the observed motion shows gains.
        """
        terms = _other(now, [turning_picture(), *forces_at_rim()])
        found = self._tried(parent, now, terms if parent.effects else [*terms, *terms_of_motion(now, parent)])
        if not any(one.score > now.score + config.SURE for one in found):
            found += self._tried(parent, now, terms_of_residuals(now))
        return _thorough(max(found, key=_finite)) if found else None

    def _force_at_rim(self, parent: Scored, now: Scored) -> Scored | None:
        found = self._tried(parent, now, _other(now, forces_at_rim()))
        return _thorough(max(found, key=_finite)) if found else None

    def _tried(self, parent: Scored, now: Scored, terms: Sequence[Term]) -> list[Scored]:
        """Fit sets with one of the terms more."""
        for term in terms:
            self.report(term.title)
        return [_first(parent, now, (*now.terms, term)) for term in terms]


def _other(now: Scored, terms: Sequence[Term]) -> list[Term]:
    """Return terms of laws that a set lacks."""
    held = {term.law for term in now.terms}
    return [one for one in terms if one.law not in held]


def _learned(
    parent: Scored,
    first: Scored | None,
    another: Callable[[Scored, Scored], Scored | None],
    left: Callable[[Scores, Scored], float],
) -> Scored | None:
    """Add terms to a set while its score grows; return None if no term is worth its price.

    One term without a gain is allowed, because it may gain with the next: on a board with waves in two
    directions, one of them alone predicts nothing. It must be worth it but for the price of the choice from
    the library. Terms that become superfluous are removed.

    Parameters
    ----------
    parent : Scored
        The set to add terms to.
    first : Scored or None
        The set with the most probable term, if any was found.
    another : callable
        Called with the parent and a set; returns the most probable set with one more term.
    left : callable
        Called with scores and a set; returns the gain in log-likelihood by what terms stand for [nats]. No
        term is added to a set without one.
    """
    best, now, doubted, found = parent, parent, False, first
    while found is not None:
        now = found
        if now.score > best.score + config.SURE:
            best, doubted = now, False
            if left(Scores.of(now), now) < config.SURE:
                break
        elif doubted or now.score < best.score - math.log(config.LIBRARY):
            break
        else:
            doubted = True
        found = another(parent, now)
    return None if best is parent else _needed(best)


def _first(parent: Scored, now: Scored, terms: tuple[Term, ...]) -> Scored:
    """Fit a set with one more term, starting at the values at which the term explains most."""
    values = _neutral() | _of_unlisted(now)
    *before, last = in_slots(terms)
    shared = {name for term in before for name in term.free}
    values |= {name: value for name, value in last.values.items() if name not in shared}
    return _fitted((*parent.effects, UNLISTED), now, terms, values)


def _fitted(
    effects: tuple[str, ...], now: Scored, terms: tuple[Term, ...], values: dict[str, float]
) -> Scored:
    """Fit terms from these values of the engine's effect; all other values are held."""
    free = {name for term in in_slots(terms) for name in term.free}
    still = {name: value for name, value in values.items() if name not in free}
    scores = Scores(now.dataset.holding(UNLISTED, still), terms)
    problem = scores.problem(effects)
    begun = now.values | {f"{UNLISTED}.{name}": value for name, value in values.items()}
    point = np.array([begun.get(name, 0.0) for name in problem.names])
    noises = np.tile(now.noise, (len(config.PUSHES), 1))
    noises[1:, PUSH] = config.PUSHES[:-1]
    if any(term.law in AT_RIM for term in terms):
        # Random rebounds and departures stand for forces at the rim as a push does for others.
        noises[1:, [RESTITUTION, DEPARTURE]] = config.LITTLE[2], config.DEPARTURE
    points = np.tile(point, (len(noises), 1))
    return max(scores.ascend(effects, points, noises, now.top.states, iterations=config.FIRST), key=_finite)


def _finite(one: Scored) -> float:
    return one.score if np.isfinite(one.score) else -np.inf


def _thorough(one: Scored) -> Scored:
    scores = Scores.of(one)
    scores.remember(one)
    scores.ascend(
        one.effects, one.top.values[None], one.noise[None], one.top.states, iterations=config.THOROUGH
    )
    return scores.known[frozenset(one.effects)]


def _needed(one: Scored) -> Scored:
    """Remove terms that later terms make superfluous."""
    for index in reversed(range(len(one.terms) - 1)):
        less = _thorough(_without(one, index))
        if less.score > one.score - config.SURE:
            one = less
    return one


def _without(one: Scored, index: int) -> Scored:
    """Fit a set without one of its terms."""
    known, values = _of_unlisted(one), _neutral()
    kept = [
        (term, now)
        for place, (term, now) in enumerate(zip(one.terms, in_slots(one.terms), strict=True))
        if place != index
    ]
    rest = tuple(term for term, _ in kept)
    for (_, now), then in zip(kept, in_slots(rest), strict=True):
        values |= {name: known[before] for name, before in zip(then.values, now.values, strict=True)}
    return _fitted(one.effects, one, rest, values)


def _of_unlisted(one: Scored) -> dict[str, float]:
    """Return the values of a set's learned correction, by parameter name."""
    own = f"{UNLISTED}."
    return {key.removeprefix(own): value for key, value in one.values.items() if key.startswith(own)}


def _neutral() -> dict[str, float]:
    """Return the neutral values of all parameters of the learned correction."""
    return {one.name: one.neutral for one in effect(UNLISTED).parameters}
