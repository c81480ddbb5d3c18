"""Effects that explain the recordings as well in the place of another: honest ties, and why they are ties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.hypotheses import ALIKE, JITTER
from irt.diagnosis.score import Array, Scored, Scores
from irt.diagnosis.selection import Posterior, renamed


@dataclass(frozen=True, eq=False)
class Tie:
    """A set that has another effect in the place of one of the answer's, and is about as probable.

    Attributes
    ----------
    name, instead : str
        The effect, and the other.
    scored : Scored
        The set with the other.
    """

    name: str
    instead: str
    scored: Scored


def ties(posterior: Posterior, answer: Scored) -> list[Tie]:
    """Return for each effect of an answer those that do as well in its place, of all sets scored."""
    found = [one for one in exchanged(posterior) if one.name in answer.effects]
    for name in ALIKE.intersection(answer.effects):
        other = renamed(answer, name)
        instead = other.effects[answer.effects.index(name)]
        alike = _is_same(answer, other) or Scores.of(answer).push(answer) > config.SURE
        if alike and all(one.instead != instead for one in found):
            found.append(Tie(name, instead, other))
    return found


def exchanged(posterior: Posterior) -> list[Tie]:
    """Return sets about as probable as the best that have another effect in the place of one of its own."""
    found = []
    for one in posterior.sets:
        gone, instead = _difference(posterior.best, one)
        close = one.score > posterior.best.score - config.TIE
        if gone and JITTER not in {gone, instead} and close:
            found.append(Tie(gone, instead, one))
    return found


def _difference(best: Scored, one: Scored) -> tuple[str, str]:
    """Return which effect of a set another lacks, and which it has instead; empty unless it is one each."""
    gone, instead = set(best.effects) - set(one.effects), set(one.effects) - set(best.effects)
    return (gone.pop(), instead.pop()) if len(gone) == len(instead) == 1 else ("", "")


def _is_same(one: Scored, other: Scored) -> bool:
    """Whether two sets predict most rows alike: where in an update a command falls is no physics."""
    return float(np.nanmedian(np.abs(_between(one, other)))) < config.SAME * one.case.noise


def _between(one: Scored, other: Scored) -> Array:
    """Return by how much two sets' free runs differ, all coordinates in a row [board edges]."""
    pairs = zip(one.fitted.residuals, other.fitted.residuals, strict=True)
    return np.concatenate([(a - b).ravel() for a, b in pairs])


def reason(answer: Scored, tie: Tie) -> str:
    """Say why two sets cannot be distinguished, with the size of what is between them."""
    size = float(np.sqrt(np.nanmean(_between(answer, tie.scored) ** 2))) / answer.case.noise
    timed = "only what is timed by itself would distinguish them, as a lamp switched with a command"
    if {tie.name, tie.instead} == ALIKE:
        why = f"the marble is seen to move alike whether the command comes late or the picture does; {timed}"
        if not _is_same(answer, tie.scored):
            why = f"beside a push that never repeats, what they differ by is not weighed; {timed}"
    else:
        why = "these commands do not excite what is different about them"
    alike = f"to {size:.1f} times the tracker's scatter"
    return f"{tie.name} and {tie.instead} predict these recordings alike, {alike}: {why}."
