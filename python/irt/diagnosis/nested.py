"""The choice once more without each recording: the others choose the set that predicts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from irt.diagnosis.score import Scored
from irt.diagnosis.validation import Validation


@dataclass(frozen=True)
class Nested:
    """Choices of which no recording that judges them was a part.

    Attributes
    ----------
    chosen : tuple of frozenset of str
        For each recording the effects of the set that the others make the most probable.
    mae : float
        Mean over the recordings of the error with which that set, fitted to the others, predicts it
        [board edges].
    """

    chosen: tuple[frozenset[str], ...]
    mae: float

    def share_with(self, names: Sequence[str]) -> float:
        """Return the share of the recordings without which one of these effects is chosen, or several."""
        return float(np.mean([not one.isdisjoint(names) for one in self.chosen]))


def nested(sets: Sequence[Scored], validation: Validation) -> Nested:
    """Choose among some sets without each recording, and predict it by the choice.

    The sets come from a search that has seen all recordings; which of them is chosen, and its values, do not
    (Varma and Simon, BMC Bioinformatics 7:91, 2006).

    Parameters
    ----------
    sets : sequence of Scored
        What competes; sets with values by free runs do so by their likelihood in a filter.
    validation : Validation
        Of the same case, with two recordings or more.
    """
    unique = list({frozenset(one.effects): one for one in reversed(sets)}.values())
    filtered = [replace(one, is_free=False) if one.is_free else one for one in unique]
    scores = np.array([validation.of(one).scores for one in filtered])
    best = np.argmax(np.where(np.isnan(scores), -np.inf, scores), axis=0)
    errors = [validation.of(unique[i]).runs[run].mae for run, i in enumerate(best)]
    return Nested(tuple(frozenset(unique[i].effects) for i in best), float(np.mean(errors)))
