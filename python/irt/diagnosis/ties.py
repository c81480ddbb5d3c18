"""Effects that explain the recordings as well in the place of another: honest ties, and why they are ties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.hypotheses import ALIKE, JITTER
from irt.diagnosis.score import Array, Scored
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


def ties(posterior: Posterior, answer: Scored) -> list[Tie]:
    """Return for each effect of an answer those that do as well in its place, of all sets scored."""
    found = []
    for one in posterior.sets:
        gone, instead = _difference(posterior.best, one)
        close = one.score > posterior.best.score - config.TIE
        if (
            gone in answer.effects
            and JITTER not in {gone, instead}
            and (close or ({gone, instead} == ALIKE and _is_same(posterior.best, one)))
        ):
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
    if {tie.name, tie.instead} == ALIKE:
        why = (
            "the marble is seen to move alike whether the command comes late or the picture does; only what "
            "is timed by itself would distinguish them, as a lamp switched with a command"
        )
    else:
        why = "these commands do not excite what is different about them"
    alike = f"to {size:.1f} times the tracker's scatter"
    return f"{tie.name} and {tie.instead} predict these recordings alike, {alike}: {why}."
