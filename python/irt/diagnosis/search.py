"""Which effect of the catalogue, added to the base model, explains the recordings; and fits of others."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.evidence import Evidence, excess, is_explained, is_trusted
from irt.diagnosis.heldout import HeldOut, hold_out, is_supported
from irt.diagnosis.hypotheses import has_place, hypotheses
from irt.diagnosis.impacts import (
    between_impacts,
    is_explained_between,
    shows,
)
from irt.diagnosis.partners import WORTH, Report, moved_in, seeds
from irt.diagnosis.result import UNLISTED
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Effects fitted alone before all are, and beside delays that differ.
SINGLES, PARTNERS = 8, 6
#: Hypotheses of each size that are refined.
REFINED = 3
#: Once a hypothesis leaves nothing to explain, others are fitted if they explained this share of its share.
RIVAL = 0.3
#: A single effect that explains less is compared with all others [nats].
CLEAR = 100.0
#: Share of what chance leaves that an effect with a place takes away by more than chance.
MORE_THAN_CHANCE = 0.5


@dataclass
class Search:
    """What was tried, and what came of it.

    Attributes
    ----------
    case : Case
        The recordings.
    report : callable
        Called with the hypothesis that is tried next.
    fits : dict
        Hypotheses by the set of their effects, the best fit of each.
    """

    case: Case
    report: Report
    fits: dict[frozenset[str], Fitted] = field(default_factory=dict)
    _held_out: dict[tuple[str, ...], HeldOut] = field(default_factory=dict)
    _fitted: dict[tuple[tuple[str, ...], bytes, int], Fitted] = field(default_factory=dict)

    @property
    def base(self) -> Fitted:
        """The fit of the five parameters alone."""
        return self.fits[frozenset()]

    def ranked(self, size: int) -> list[Fitted]:
        """Return the hypotheses of so many effects, the best first."""
        found = [one for names, one in self.fits.items() if len(names) == size and UNLISTED not in names]
        return sorted(found, key=lambda one: (one.loss(self.case.noise), one.effects))

    def evidence(self) -> Evidence:
        """Return the yardstick for what was tried so far."""
        return Evidence.of(self.case, list(self.fits.values()))

    def singles(self) -> Fitted:
        """Try one effect at a time, and return the best hypothesis."""
        self.report("the five parameters")
        self.keep(self.case.fit(starts=8))
        seeds = self.seeds(self.base, hypotheses())
        ranked = list(seeds)
        best = self.base
        for names in (ranked[:SINGLES], ranked[SINGLES:]):
            self._fit(self.base, {name: seeds[name] for name in names})
            self._move_in(1)
            self._refine(1)
            best = self._grown(self.base, 1)
            if is_explained(self.case, best, self.base) or self.is_explained_between(best):
                break
        if best.effects and self.evidence().gain(best, self.base) < CLEAR:
            # Where little is to be explained, draws hardly tell which effect would explain most of it.
            left = {name: seeds[name] for name in ranked if frozenset({name}) not in self.fits}
            self._fit(self.base, left, rivals_alone=False)
            self._refine(1)
            best = self._grown(self.base, 1)
        return best

    def beside(self, parent: Fitted, names: Sequence[str]) -> Fitted:
        """Return a hypothesis that has to stay with the one effect more that is worth it, or as it is.

        Of what delays leave that differ by chance, something with a place takes a third, wherever it is.
        """
        self._expand(parent, names, PARTNERS)
        least = (1.0 - MORE_THAN_CHANCE) * excess(self.case, parent)
        tried = {name: self.fits.get(frozenset({*parent.effects, name}), parent) for name in names}
        found = [one for name, one in tried.items() if not has_place(name) or excess(self.case, one) < least]
        best = min([parent, *found], key=lambda one: (one.loss(self.case.noise), one.effects))
        return best if self._is_worth(best, parent) else parent

    def is_done(self, one: Fitted) -> bool:
        """Whether nothing is left to explain; of effects by more than what most windows look like."""
        if not is_explained(self.case, one, self.base):
            return False
        return not one.effects or is_trusted(self.case, one, self.base)

    def is_explained_between(self, one: Fitted) -> bool:
        """Whether nothing is left between impacts, so that what is left is how the marble meets the rim."""
        return is_explained_between(self.between_impacts, one)

    def fit(self, effects: Sequence[str], points: Array, *, rounds: int) -> Fitted:
        """Fit a hypothesis from points, unless that was done, and remember it if it is the best one."""
        key = (tuple(effects), points.tobytes(), rounds)
        if key not in self._fitted:
            self._fitted[key] = self.case.fit(effects, points=points, rounds=rounds)
            self.keep(self._fitted[key])
        return self._fitted[key]

    def keep(self, one: Fitted) -> None:
        """Remember a fit, if it is the best one of its effects."""
        key = frozenset(one.effects)
        known = self.fits.get(key)
        if known is None or one.loss(self.case.noise) < known.loss(self.case.noise):
            self.fits[key] = one

    def _expand(self, parent: Fitted, names: Sequence[str], count: int) -> None:
        """Fit a parent with one effect more: of those that would explain most of what it leaves over."""
        seeds = self.seeds(parent, names) if names else {}
        self._fit(parent, {name: seeds[name] for name in [*seeds][:count]})

    def _fit(
        self, parent: Fitted, seeds: Mapping[str, tuple[float, Array]], *, rivals_alone: bool = True
    ) -> None:
        """Fit a parent with one effect more, each in turn; once one explains all, its rivals alone."""
        enough: float | None = None
        for name in seeds:
            self.report(" + ".join([*parent.effects, name]))
            if enough is not None and seeds[name][0] < enough:
                continue
            fitted = self.fit((*parent.effects, name), seeds[name][1], rounds=0)
            if rivals_alone and is_explained(self.case, fitted, self.base):
                enough = RIVAL * seeds[name][0]

    def seeds(self, parent: Fitted, names: Iterable[str]) -> dict[str, tuple[float, Array]]:
        """Return for each effect the largest share that a draw explains, and points to begin a fit at."""
        return seeds(self.case, parent, names, self.report)

    def _move_in(self, size: int) -> None:
        """Try, where the best hypothesis of a size has an effect with a place, the others that have one.

        Slopes lead to a place from near it alone, and what pushes the marble there stands in for what does.
        """
        for best in self.ranked(size)[:1]:
            if is_explained(self.case, best, self.base):
                return
            placed = [other for other in hypotheses() if has_place(other) and other not in best.effects]
            for name, other in itertools.product(filter(has_place, best.effects), placed):
                names, points = moved_in(self.case, best, name, other)
                self.report(" + ".join(names))
                self.fit(names, points, rounds=0)

    def _refine(self, size: int) -> None:
        """Refine the best hypotheses of a size."""
        for one in self.ranked(size)[:REFINED]:
            self.report(" + ".join(one.effects))
            self.fit(one.effects, one.values[None], rounds=2)

    def _grown(self, best: Fitted, size: int) -> Fitted:
        """Return the best hypothesis of a size if it is worth its effects, else the one before."""
        self._returned(best, self.ranked(size))
        ranked, best = self.ranked(size), self.fits[frozenset(best.effects)]
        if not ranked or not self.evidence().is_better(ranked[0], best):
            return best
        best = self.thorough(best, ranked[0])
        return ranked[0] if self._is_worth(ranked[0], best) else best

    def _is_worth(self, one: Fitted, over: Fitted) -> bool:
        """Whether a larger hypothesis is better by enough, and on recordings held out."""
        if not self.evidence().is_better(one, over):
            return False
        if over.effects and not self._takes_enough(one, over):
            return False
        return self.is_supported(one, over)

    def _takes_enough(self, one: Fitted, over: Fitted) -> bool:
        """Whether a larger hypothesis takes away enough of what one leaves."""
        return excess(self.case, one) <= (1.0 - WORTH) * excess(self.case, over)

    def thorough(self, parent: Fitted, child: Fitted) -> Fitted:
        """Fit a hypothesis once more, from where it led and from where a larger one did, and look around."""
        points = np.array([parent.values, parent.begun_at(child)])
        self.fit(parent.effects, points, rounds=2)
        return self.fits[frozenset(parent.effects)]

    def without(self, one: Fitted, name: str) -> Fitted:
        """Return a hypothesis without one of its effects, fitted from where it led if need be."""
        rest = [other for other in one.effects if other != name]
        if frozenset(rest) not in self.fits:
            self._refine_within(one, rest)
        return self.fits[frozenset(rest)]

    def _refine_within(self, one: Fitted, names: Sequence[str]) -> None:
        """Refine some of the effects of a hypothesis from where it led."""
        values = dict(zip(one.names, one.values, strict=True))
        own = [*PARAMETERS, *(key for name in names for key in values if key.startswith(f"{name}."))]
        self.keep(self.case.refine(names, np.array([[values[key] for key in own]]))[0])

    def _returned(self, parent: Fitted, children: Sequence[Fitted]) -> None:
        """Refine a hypothesis from where a larger one led: it must not lose for want of a good start."""
        for child in [one for one in children if set(parent.effects) < set(one.effects)][:1]:
            self._refine_within(child, parent.effects)

    def is_supported(self, one: Fitted, over: Fitted) -> bool:
        """Whether recordings held out agree that a hypothesis is better, and the marble between impacts."""
        if not shows(self.between_impacts, one, over):
            return False
        return is_supported(self.held_out(one), self.held_out(over), self.evidence().scale)

    @functools.cached_property
    def between_impacts(self) -> Case:
        """The recordings without all that is near the rim."""
        return between_impacts(self.case, self.base)

    def with_effect(self, name: str, parent: Fitted | None = None) -> Fitted:
        """Return a hypothesis, by default the base model, with one effect more, fitted."""
        parent = parent or self.base
        effects = frozenset({*parent.effects, name})
        if effects not in self.fits:
            self._expand(parent, [name], 1)
        return self.fits[effects]

    def remember(self, one: Fitted, held: HeldOut) -> None:
        """Take a hypothesis among those tried, with what recordings held out say of it."""
        self.fits[frozenset(one.effects)] = one
        self._held_out[one.effects] = held

    def known_held_out(self, one: Fitted) -> HeldOut | None:
        """Return a hypothesis judged by recordings held out, if it was."""
        return self._held_out.get(one.effects)

    def held_out(self, one: Fitted) -> HeldOut:
        """Return a hypothesis judged by recordings held out."""
        key = one.effects
        if key not in self._held_out:
            self.report(f"{' + '.join(key) or 'the five parameters'}, held out")
            self._held_out[key] = hold_out(self.case, one)
        return self._held_out[key]
