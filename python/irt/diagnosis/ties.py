"""Effects that explain the recordings as well in the place of another: honest ties, and why they are ties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.hypotheses import ALIKE, JITTER
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.selection import Posterior


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


def ties(scores: Scores, posterior: Posterior, answer: Scored) -> list[Tie]:
    """Return for each effect of an answer those that do as well in its place.

    Two names of one thing are tried; others are those of the sets that the selection has scored.
    """
    found = []
    for name in answer.effects:
        if name in ALIKE:
            found += _renamed(scores, answer, name)
        found += [
            Tie(name, instead, one)
            for one in posterior.sets
            for gone, instead in [_difference(posterior.best, one)]
            if gone == name and {gone, instead} != ALIKE and JITTER not in {gone, instead}
            if one.score > posterior.best.score - config.TIE
        ]
    return found


def _difference(best: Scored, one: Scored) -> tuple[str, str]:
    """Return which effect of a set another lacks, and which it has instead; empty unless it is one each."""
    gone, instead = set(best.effects) - set(one.effects), set(one.effects) - set(best.effects)
    return (gone.pop(), instead.pop()) if len(gone) == len(instead) == 1 else ("", "")


def _renamed(scores: Scores, answer: Scored, name: str) -> list[Tie]:
    """Return the same set with the other name of an effect, if recordings do not tell them apart."""
    (other,) = ALIKE - {name}
    effects = tuple(other if one == name else one for one in answer.effects)
    problem = scores.problem(effects)
    own = iter([value for key, value in answer.values.items() if key.startswith(f"{name}.")])
    point = [answer.values[key] if key in answer.values else next(own) for key in problem.names]
    (renamed,) = scores.ascend(
        effects, np.array([point]), answer.noise[None], answer.top.states, iterations=config.THOROUGH
    )
    return [Tie(name, other, renamed)] if renamed.score > answer.score - config.TIE else []


def reason(answer: Scored, tie: Tie) -> str:
    """Say why two sets cannot be distinguished, with the size of what is between them."""
    pairs = zip(answer.fitted.residuals, tie.scored.fitted.residuals, strict=True)
    between = np.concatenate([(a - b).ravel() for a, b in pairs])
    size = float(np.sqrt(np.nanmean(between**2))) / answer.case.noise
    if {tie.name, tie.instead} == ALIKE:
        why = (
            "the marble is seen to move alike whether the command comes late or the picture does; only what "
            "is timed by itself would distinguish them, as a lamp switched with a command"
        )
    else:
        why = "these commands do not excite what is different about them"
    alike = f"to {size:.1f} times the tracker's scatter"
    return f"{tie.name} and {tie.instead} predict these recordings alike, {alike}: {why}."
