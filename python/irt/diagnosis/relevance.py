"""Reduce a set to the effects that matter: nonzero, and needed to predict held-out recordings."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field

import numpy as np

from irt.catalogue import effect
from irt.diagnosis import calibration, config, intervals, words
from irt.diagnosis.hypotheses import INERTIA, JITTER, SIZES_OF_TIMES, group_of
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.selection import Selection
from irt.diagnosis.sets import Posterior
from irt.diagnosis.ties import Tie, exchanged
from irt.diagnosis.validation import Validation
from irt.fitting.problem import in_unit_of
from irt.model import Parameter

#: Parameters of a set with 95 % intervals, and sentences on unidentifiable combinations.
Estimates = tuple[dict[str, Parameter], tuple[str, ...]]


@dataclass(eq=False)
class Relevance:
    """Relevance of the effects of sets, by held-out recordings.

    No engine reproduces a rig exactly at walls and close to rest, and in long recordings a small effect of
    the catalogue can describe the difference. Therefore a set keeps an effect only if its interval excludes
    the neutral value, if it is chosen again without most of the recordings, and if it is needed: the held-out
    error increases without it by a share of the tracker's noise, or the held-out recordings are certainly
    likelier with it, and by more than engines with equal physics differ, or it moves predictions by the
    tracker's noise. Inertial forces need no such proof, unless their fitted value is the neutral one: they
    act on every board that turns.

    Attributes
    ----------
    selection, posterior
        The search and its result.
    """

    selection: Selection
    posterior: Posterior
    _without: dict[Scored, dict[str, Scored]] = field(default_factory=dict)
    _freed: dict[tuple[Scored, str], Scored] = field(default_factory=dict)
    _parameters: dict[Scored, Estimates] = field(default_factory=dict)
    _whole: dict[Scored, Scored] = field(default_factory=dict)

    @property
    def validation(self) -> Validation:
        """The cross-validation."""
        return self.selection.validation

    @functools.cached_property
    def exchanges(self) -> list[Tie]:
        """The ties of the best set."""
        return exchanged(self.posterior, self.validation)

    def without(self, one: Scored, name: str) -> Scored:
        """Return a set without one of its effects, fitted in the same way as the set."""
        if one not in self._without:
            self._without[one] = {}
        known = self._without[one]
        if name not in known:
            selection = self.selection
            if one.dataset is not selection.scores.dataset:
                selection = Selection(Scores.of(one), (), selection.report)
            known[name] = self.as_free(selection.without(one, name), one)
        return known[name]

    def as_free(self, one: Scored, other: Scored) -> Scored:
        """Return a set with values from free runs if those of `other` are."""
        return Scores.of(one).freed(one) if other.is_free and not one.is_free else one

    def freed(self, one: Scored) -> Scored:
        """Return a set with values from free runs if these predict held-out recordings better.

        A filter corrects a sticking marble in every row, whereas a free run is sensitive to sticking. If the
        residuals of free runs are about the tracker's noise, there is nothing to gain. A push accumulates in
        free runs, and their values may undo an effect: such values are rejected. Free runs do not see a
        measured tilt, so beside one the filter's values stay.
        """
        if one.is_free or one.is_exact or one.dataset.has_tilt:
            return one
        other = Scores.of(one).freed(one)
        if self._undoes_an_effect(other, one):
            return one
        return min(one, other, key=lambda each: self.validation.of(each).mae)

    def _undoes_an_effect(self, free: Scored, one: Scored) -> bool:
        """Whether a set without one of the effects explains the rows better than values from free runs do."""
        problem = Scores.of(one).problem(one.effects)
        (found,) = problem.filter(free.top.values[None], one.noise[None], [one.top.states])
        own = float(found.log_likelihood.sum())
        return any(self.without(one, name).top.log_likelihood > own for name in one.effects)

    def loss(self, one: Scored, name: str) -> float:
        """Return the increase of the held-out error without an effect [board edges].

        It is the larger increase of complete runs and of windows of `config.HORIZON_S`: in long runs, a push
        that does not repeat can hide what each window shows. Without the effect, complete runs are predicted
        by the better of the values from the filter and from free runs, as those of a set are. If the values
        from free runs are too poor even for the recordings that they were fitted to, they are not fitted
        without each recording, which takes as many times as long. Beside a measured tilt, which free runs do
        not see, neither set has values from them.
        """
        without, full = (self.validation.of(each) for each in (self.without(one, name), one))
        windows = without.windowed - full.windowed
        if not np.isfinite(windows):
            windows = -np.inf
        runs, least = without.mae - full.mae, config.MATTERS * one.dataset.noise
        if runs >= least and runs > windows and self._competes_freed(one):
            free = self._freed_without(one, name)
            of_free = self.validation.fitted_mae(free) - full.mae
            if of_free < least:
                of_free = self.validation.of(free).mae - full.mae
            runs = min(runs, of_free)
        return max(runs, windows)

    def _freed_without(self, one: Scored, name: str) -> Scored:
        """Return a set without one of its effects, with values from free runs."""
        key = (one, name)
        if key not in self._freed:
            self._freed[key] = Scores.of(one).freed(self.without(one, name))
        return self._freed[key]

    def _is_certain(self, one: Scored, name: str) -> bool:
        """Whether held-out recordings agree that a set predicts better with an effect than without it.

        In windows, in complete runs, or by likelihood, together or each by itself. If the set leaves only
        noise, or nothing is held out, there is nothing to test.
        """
        validation, without = self.validation, self.without(one, name)
        if one.is_exact or not validation.of(one).is_proof:
            return True
        if validation.windows_agree(one, without) or validation.is_likelier(one, without):
            return True
        if validation.each_is_likelier(one, without):
            return True
        others = [without, *([self._freed_without(one, name)] if self._competes_freed(one) else [])]
        return validation.runs_agree(one, min(others, key=lambda other: validation.of(other).mae))

    @staticmethod
    def _competes_freed(one: Scored) -> bool:
        """Whether a set is compared with smaller ones at their values from free runs, too.

        Not if its own are from free runs, as then all are; nor if its own could not be.
        """
        return not (one.is_free or one.is_exact or one.dataset.has_tilt)

    def _is_needed(self, one: Scored, name: str) -> bool:
        """Whether an effect matters to predictions of held-out recordings.

        The errors without it must be larger, and not by chance: what a model leaves on a real rig differs
        between recordings by more than some effects do.

        Delay jitter does not improve predictions, so only its likelihood counts. It must be finite: the
        spread must be compatible with the mean, also for values from free runs. Likelihoods alone do not
        count if the recordings agree that errors are smaller without the effect: then the random push, which
        the likelihoods contain, stands for something else.
        """
        noise, without = one.dataset.noise, self.without(one, name)
        if name == JITTER:
            return math.isfinite(one.score) and not self._only_seems_random(one)
        if self.loss(one, name) >= config.MATTERS * noise and self._is_certain(one, name):
            return True
        if not self.validation.is_likelier(one, without) or self.validation.is_better(without, one):
            return False
        gain = float(self.validation.likelihood_gains(one, without).sum())
        return gain > config.CLOSE or self.validation.difference(one, without) >= noise

    def _only_seems_random(self, one: Scored) -> bool:
        """Whether held-out recordings are predicted better by the mean effect of jitter without a spread.

        By as much as an effect has to matter, and not by chance: complete runs part at the rim and where a
        delay happens to be long, so the windows have to agree.
        """
        is_worse = self.loss(one, JITTER) <= -config.MATTERS * one.dataset.noise
        return is_worse and self.validation.windows_agree(self.without(one, JITTER), one)

    def _is_chosen_again(self, one: Scored, name: str) -> bool:
        """Whether the set without an effect is left for the set with it without most recordings, too.

        Each recording is left out once, and the effect must gain `config.SURE` on the others. What is
        selected without less than half of them depends on which were recorded (after stability selection:
        Meinshausen and Bühlmann, J. R. Stat. Soc. B 72:417, 2010; their bound is for halves of the data, and
        does not hold here).
        """
        here, other = (self.validation.of(each.filtered or each) for each in (one, self.without(one, name)))
        gains = here.scores - other.scores
        return bool(2 * np.count_nonzero(gains > config.SURE) >= len(gains))

    def _is_probable(self, name: str) -> bool:
        """Whether an effect or one of its ties is probable enough to be named.

        A learned correction always is, because it competes as a set.
        """
        instead = [one.instead for one in self.exchanges if one.name == name]
        alike = [*group_of(name), *instead]
        return name == UNLISTED or self.posterior.any_of(alike) > config.PROBABLE

    def parameters(self, one: Scored) -> Estimates:
        """Return the parameters of a set with 95 % intervals, and its unidentifiable combinations."""
        if one not in self._parameters:
            likelihood = one.top.log_likelihood
            losses = {name: likelihood - self.without(one, name).top.log_likelihood for name in one.effects}
            self._parameters[one] = intervals.parameters(one, self.validation.of(one), losses)
        return self._parameters[one]

    def named(self, one: Scored) -> list[str]:
        """Return the effects of a reduced set that are missing physics.

        Others are differences between engines, errors of the tracker's calibration, or forces that act on
        every board that turns.
        """
        found, _ = self.parameters(one)
        rig, noise = one.dataset.rig, one.dataset.noise
        return [
            name
            for name in one.effects
            if name != INERTIA
            and intervals.is_named(in_unit_of(rig, effect(name)), found)
            and not calibration.is_within_error(name, one.fitted.value_of(name), rig, noise)
        ]

    def kept(self, one: Scored) -> tuple[Scored, frozenset[str]]:
        """Return a set reduced to effects that matter and are probable, and the effects that do not matter.

        Effects are removed one by one, the least important first.
        """
        whole, immaterial = one, []
        while (found := self._superfluous(one)) is not None:
            name, matters = found
            immaterial += [] if matters else [name]
            one = self.without(one, name)
        self._whole[one] = whole
        return one, frozenset(immaterial)

    def estimates(self, one: Scored) -> Estimates:
        """Return `parameters` with intervals that hold beside effects that may be there, too.

        Those are the effects that were removed, and of delay and lag the one that was not found.
        """
        found, unknown = self.parameters(one)
        found = intervals.spanning(found, self.parameters(self._whole.get(one, one))[0])
        both = intervals.with_delay_and_lag(one)
        if both is None:
            return found, unknown
        both = self.as_free(both, one)
        wider = intervals.spanning(found, intervals.parameters(both, self.validation.of(both), {})[0])
        own = [name for name, size in SIZES_OF_TIMES.items() if found.get(size) != wider.get(size)]
        (more,) = set(both.effects).difference(one.effects)
        return wider, (*unknown, *(words.of_the_sum(name, more) for name in own))

    def _superfluous(self, one: Scored) -> tuple[str, bool] | None:
        """Return a superfluous effect of a set, and whether it matters; None if there is none."""
        if not one.effects:
            return None
        if INERTIA in one.effects and _turns_slowly(one):
            return INERTIA, False
        found, _ = self.parameters(one)
        losses = {name: self.loss(one, name) for name in one.effects if name != INERTIA}
        for name in sorted(losses, key=lambda name: losses[name]):
            info = in_unit_of(one.dataset.rig, effect(name))
            matters = (
                self._is_needed(one, name)
                and self._is_chosen_again(one, name)
                and intervals.is_distinct(info, found)
            )
            if not (matters and self._is_probable(name)):
                return name, matters
        return None


def _turns_slowly(one: Scored) -> bool:
    """Whether the board was fitted to turn more slowly than the catalogue's range, and throws no marble."""
    (rate,) = in_unit_of(one.dataset.rig, effect(INERTIA)).required
    return one.fitted.value_of(INERTIA)[rate.name] < rate.low
