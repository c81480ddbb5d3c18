"""Several effects at once beside a random push: the most probable set, as far as it matters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irt.diagnosis import config
from irt.diagnosis.case import Fitted
from irt.diagnosis.hypotheses import ALIKE, hypotheses, is_law_of_impacts
from irt.diagnosis.impacts import LEAST_OF_IMPACTS, size_of_law
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.search import Search
from irt.diagnosis.selection import Posterior, Selection


@dataclass(frozen=True, eq=False)
class Several:
    """The most probable set of effects.

    Attributes
    ----------
    fitted : Fitted
        Its free runs, without effects that do not matter.
    scored : Scored
        The set as it was scored.
    push : float
        By how many nats it is likelier with a random push: below `config.SURE` it lacks nothing.
    posterior : Posterior
        All sets that were scored.
    """

    fitted: Fitted
    scored: Scored
    push: float
    posterior: Posterior

    @property
    def is_whole(self) -> bool:
        """Whether the set needs no random push."""
        return self.push < config.SURE


def several(search: Search) -> Several:
    """Search the most probable set of effects, the marble being pushed at random besides."""
    scores = Scores(search.case)
    names = [name for name in hypotheses() if name != max(ALIKE)]
    posterior = Selection(scores, names, search.report).run()
    best = posterior.best
    if not best.effects:
        return Several(search.base, best, scores.push(best), posterior)
    values = [best.values[name] for name in search.case.problem(best.effects).names]
    fitted = search.fit(best.effects, np.array([values]), rounds=0)
    for one in posterior.instead():
        others = [one.values[name] for name in search.case.problem(one.effects).names]
        search.fit(one.effects, np.array([others]), rounds=0)
    return Several(_what_matters(search, fitted), best, scores.push(best), posterior)


def _what_matters(search: Search, fitted: Fitted) -> Fitted:
    """Drop effects without which runs held out are predicted as well, to a share of the tracker's noise.

    No engine is the rig: what a marble does at walls and in its last millimetre differs between any two, and
    in long recordings some small effect of the catalogue describes it better than nothing does.
    """
    losses = {name: _loss_without(search, fitted, name) for name in fitted.effects}
    for name in sorted(losses, key=lambda name: losses[name]):
        little = is_law_of_impacts(name) and size_of_law(fitted, name) < LEAST_OF_IMPACTS
        if little or losses[name] < config.MATTERS * search.case.noise:
            return _what_matters(search, search.without(fitted, name))
    return fitted


def _loss_without(search: Search, fitted: Fitted, name: str) -> float:
    """Return by how much the mean absolute error on runs held out grows without an effect [board edges]."""
    without = search.without(fitted, name)
    return _error(search, without) - _error(search, fitted)


def _error(search: Search, one: Fitted) -> float:
    judged = search.held_out(one).judged or (one,)
    return float(np.nanmean(np.abs(np.concatenate([r for each in judged for r in each.residuals]))))
