"""Which effects of a set matter: distinct from none, and missed by recordings held out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from irt.diagnosis import config, intervals
from irt.diagnosis.hypotheses import JITTER, group_of
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.selection import Posterior, Selection
from irt.diagnosis.ties import exchanged
from irt.diagnosis.validation import Validation
from irt.model import Parameter

#: Parameters of a set with 95 % intervals, and sentences on what the recordings cannot pin down.
Estimates = tuple[dict[str, Parameter], tuple[str, ...]]


@dataclass(eq=False)
class Relevance:
    """Effects of sets, judged by recordings held out.

    No engine is the rig: what a marble does at walls and in its last millimetre differs between any two, and
    in long recordings some small effect of the catalogue describes it better than nothing does. So a set
    keeps an effect only if its interval leaves the neutral value out, and recordings that were held out are
    predicted worse without it by a share of the tracker's noise.

    Attributes
    ----------
    selection, posterior
        The search, and what it found.
    """

    selection: Selection
    posterior: Posterior
    _without: dict[Scored, dict[str, Scored]] = field(default_factory=dict)
    _parameters: dict[Scored, Estimates] = field(default_factory=dict)

    @property
    def validation(self) -> Validation:
        """The recordings held out."""
        return self.selection.validation

    def without(self, one: Scored, name: str) -> Scored:
        """Return a set without one of its effects, its values found as those of the set were."""
        if one not in self._without:
            self._without[one] = {}
        known = self._without[one]
        if name not in known:
            selection = self.selection
            if one.case is not selection.scores.case:
                selection = Selection(Scores.of(one), (), selection.report)
            known[name] = self.as_free(selection.without(one, name), one)
        return known[name]

    def as_free(self, one: Scored, other: Scored) -> Scored:
        """Return a set with values by free runs if those of another are."""
        return Scores.of(one).freed(one) if other.is_free and not one.is_free else one

    def freed(self, one: Scored) -> Scored:
        """Return a set with values by free runs, if these predict recordings held out better.

        A filter corrects a marble that sticks, or just does not, in every row; a free run sees where it
        leads. Where free runs are off by about the tracker's noise there is nothing to gain.
        """
        if one.is_free or one.fitted.noise < (1.0 + config.MATTERS) * one.case.noise:
            return one
        other = Scores.of(one).freed(one)
        return min(one, other, key=lambda each: self.validation.of(each).mae)

    def loss(self, one: Scored, name: str) -> float:
        """Return by how much the error on recordings held out grows without an effect [board edges].

        From start to end, or in windows of `config.HORIZON_S`, where it grows more: a push that does not
        repeat hides in long runs what each window shows.
        """
        without, full = (self.validation.of(each) for each in (self.without(one, name), one))
        windows = without.windowed - full.windowed
        return max(without.mae - full.mae, windows if np.isfinite(windows) else -np.inf)

    def _is_probable(self, name: str) -> bool:
        """Whether an effect is likely enough to be at work, or one of those that do as well in its place.

        What was learned is weighed as a whole set.
        """
        instead = [one.instead for one in exchanged(self.posterior) if one.name == name]
        alike = [*group_of(name), *instead]
        return name == UNLISTED or self.posterior.any_of(alike) > config.PROBABLE

    def parameters(self, one: Scored) -> Estimates:
        """Return the parameters of a set with 95 % intervals, and what the recordings cannot pin down."""
        if one not in self._parameters:
            likelihood = one.top.log_likelihood
            losses = {name: likelihood - self.without(one, name).top.log_likelihood for name in one.effects}
            self._parameters[one] = intervals.parameters(one, self.validation.of(one), losses)
        return self._parameters[one]

    def kept(self, one: Scored) -> tuple[Scored, frozenset[str]]:
        """Return a set without effects that do not matter, the least of them first, and which these were.

        An effect that is not probable goes too, and is not among those.
        """
        immaterial = []
        while (found := self._superfluous(one)) is not None:
            name, matters = found
            immaterial += [] if matters else [name]
            one = self.without(one, name)
        return one, frozenset(immaterial)

    def _superfluous(self, one: Scored) -> tuple[str, bool] | None:
        """Return an effect that a set does not need, and whether it matters; None if it needs all."""
        if not one.effects:
            return None
        found, _ = self.parameters(one)
        losses = {name: self.loss(one, name) for name in one.effects}
        for name in sorted(losses, key=lambda name: losses[name]):
            # Delays that differ predict no run better: their likelihood is all there is of them, and a mean
            # that goes with their spread, by free runs too.
            if name == JITTER:
                counts = math.isfinite(one.score)
            else:
                counts = losses[name] >= config.MATTERS * one.case.noise
            matters = counts and intervals.is_named(name, found)
            if not (matters and self._is_probable(name)):
                return name, matters
        return None
