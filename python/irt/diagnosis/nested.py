"""Nested cross-validation: repeat the selection of a set without each recording, and predict it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.score import Scored
from irt.diagnosis.validation import Validation


@dataclass(frozen=True)
class Nested:
    """Results of the nested cross-validation.

    Attributes
    ----------
    chosen : tuple of frozenset of str
        Effects of the set selected without each recording.
    mae : float
        Mean error of these sets, fitted to the other recordings, on the recording left out [board edges].
    """

    chosen: tuple[frozenset[str], ...]
    mae: float

    def share_with(self, names: Sequence[str]) -> float:
        """Return the share of the selections that contain at least one of these effects."""
        return float(np.mean([not one.isdisjoint(names) for one in self.chosen]))


def nested(sets: Sequence[Scored], validation: Validation) -> Nested:
    """Select among sets without each recording, and predict it by the selected set.

    The sets come from a search over all recordings, but neither the selection nor its values depend on the
    recording left out (Varma and Simon, BMC Bioinformatics 7:91, 2006). As in the search, each effect must
    gain `config.SURE`.

    Parameters
    ----------
    sets : sequence of Scored
        The competing sets; sets with values from free runs compete by those from the filter.
    validation : Validation
        Validation of the same dataset, with two recordings or more.
    """
    unique = list({frozenset(one.effects): one for one in reversed(sets)}.values())
    scores = np.array([validation.of(one.filtered or one).scores for one in unique])
    scores -= config.SURE * np.array([len(one.effects) for one in unique])[:, None]
    best = np.argmax(np.where(np.isnan(scores), -np.inf, scores), axis=0)
    errors = [validation.of(unique[i]).runs[run].mae for run, i in enumerate(best)]
    return Nested(tuple(frozenset(unique[i].effects) for i in best), float(np.mean(errors)))
