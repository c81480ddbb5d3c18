"""Ties: effects that explain the recordings as well in place of another, and the reasons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.hypotheses import ALIKE
from irt.diagnosis.score import Array, Scored, Scores
from irt.diagnosis.sets import Posterior, exchange, is_rival, renamed
from irt.diagnosis.validation import Validation, agree


@dataclass(frozen=True, eq=False)
class Tie:
    """A set of similar probability in which another effect replaces one of the answer.

    Attributes
    ----------
    name, instead : str
        The effect of the answer, and its replacement.
    scored : Scored
        The set with the replacement.
    """

    name: str
    instead: str
    scored: Scored


def ties(exchanges: Sequence[Tie], answer: Scored) -> list[Tie]:
    """Return the ties of each effect of an answer, from those of the best set.

    A measured tilt distinguishes the effects of `ALIKE`: they tie as any others do.
    """
    found = [one for one in exchanges if one.name in answer.effects]
    for name in ALIKE.intersection(() if answer.dataset.has_tilt else answer.effects):
        other = renamed(answer, name)
        instead = other.effects[answer.effects.index(name)]
        alike = (
            _is_same(answer, other)
            or Scores.of(answer).push(answer) > config.SURE
            or not _fits_better(answer, other)
        )
        if alike and all(one.instead != instead for one in found):
            found.append(Tie(name, instead, other))
    return found


def exchanged(posterior: Posterior, validation: Validation) -> list[Tie]:
    """Return sets that are about as good as the best, and in which one effect is replaced.

    Within `config.TIE` the recordings say nothing. Within `config.CLOSE`, by which engines with equal physics
    differ, the held-out errors decide as in the search: a replacement that would itself be named is as good
    unless the recordings agree that it predicts worse.
    """
    best, found = posterior.best, []
    scores = {frozenset(one.effects): one.score for one in posterior.sets}
    for one in posterior.sets:
        if not is_rival(best, one):
            continue
        gone, instead = exchange(best, one)
        less = best.score - one.score
        gain = one.score - scores.get(frozenset(best.effects) - {gone}, -math.inf)
        if less < config.TIE or (gain > config.SURE and not validation.is_better(best, one)):
            found.append(Tie(gone, instead, one))
    return found


def _is_same(one: Scored, other: Scored) -> bool:
    """Whether two sets predict most rows alike, up to the phase of commands within a time step."""
    return float(np.nanmedian(np.abs(_between(one, other)))) < config.SAME * one.dataset.noise


def _fits_better(one: Scored, than: Scored) -> bool:
    """Whether the recordings agree that free runs of a set are nearer than those of another.

    Rebounds magnify what the phase of commands within a time step changes, so that most rows may differ.
    """
    pairs = zip(one.fitted.residuals, than.fitted.residuals, strict=True)
    gains = np.array([np.nanmean(np.abs(other)) - np.nanmean(np.abs(own)) for own, other in pairs])
    folds = one.dataset.folds
    of_recordings = np.array([gains[folds == fold].mean() for fold in np.unique(folds)])
    return len(of_recordings) > 1 and agree(of_recordings)


def _between(one: Scored, other: Scored) -> Array:
    """Return the differences of two sets' free runs, flattened [board edges]."""
    pairs = zip(one.fitted.residuals, other.fitted.residuals, strict=True)
    return np.concatenate([(a - b).ravel() for a, b in pairs])


def reason(answer: Scored, tie: Tie) -> str:
    """Return a sentence on why two sets cannot be distinguished, with the size of their difference."""
    size = float(np.sqrt(np.nanmean(_between(answer, tie.scored) ** 2))) / answer.dataset.noise
    timed = "only an independently timed event would distinguish them, such as a lamp switched with a command"
    if {tie.name, tie.instead} == ALIKE:
        why = f"a late command and a late picture give the same observed motion; {timed}"
        if not _is_same(answer, tie.scored):
            why = f"the random push hides their difference; {timed}"
    else:
        why = "these commands do not excite their difference"
    return (
        f"The predictions of {tie.name} and {tie.instead} for these recordings differ by {size:.1f} times "
        f"the tracker's noise: {why}."
    )
