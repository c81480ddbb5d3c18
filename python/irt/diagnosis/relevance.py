"""Which effects of a set matter: those that are told from none, and without which recordings are missed."""

from __future__ import annotations

from dataclasses import dataclass

from irt.diagnosis import config, intervals
from irt.diagnosis.hypotheses import JITTER
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.selection import Selection
from irt.diagnosis.validation import Validation


@dataclass(eq=False)
class Relevance:
    """Effects of sets, judged by recordings held out.

    No engine is the rig: what a marble does at walls and in its last millimetre differs between any two, and
    in long recordings some small effect of the catalogue describes it better than nothing does. So a set
    keeps an effect only if its interval leaves the neutral value out, and recordings that were held out are
    predicted worse without it by a share of the tracker's noise.
    """

    selection: Selection
    validation: Validation

    def without(self, one: Scored, name: str) -> Scored:
        """Return a set without one of its effects."""
        if one.case is self.selection.scores.case:
            return self.selection.without(one, name)
        return Selection(Scores.of(one), (), self.selection.report).without(one, name)

    def loss(self, one: Scored, name: str) -> float:
        """Return by how much the error on recordings held out grows without an effect [board edges]."""
        return self.validation.of(self.without(one, name)).mae - self.validation.of(one).mae

    def kept(self, one: Scored) -> Scored:
        """Return a set without effects that do not matter, the least of them first."""
        if not one.effects:
            return one
        found, _ = intervals.parameters(one, self.validation.of(one))
        losses = {name: self.loss(one, name) for name in one.effects}
        for name in sorted(losses, key=lambda name: losses[name]):
            # Delays that differ predict no run better: their likelihood is all there is of them.
            matters = name == JITTER or losses[name] >= config.MATTERS * one.case.noise
            if not matters or not intervals.is_named(name, found):
                return self.kept(self.without(one, name))
        return one
