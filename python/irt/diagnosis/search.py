"""Which effects, added to the base model, explain the recordings: forward and backward over the catalogue."""

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
from irt.diagnosis.hypotheses import ALIKE, acts_on_impacts_alone, has_place, hypotheses
from irt.diagnosis.impacts import (
    between_impacts,
    is_explained_between,
    shows,
)
from irt.diagnosis.partners import WORTH, Report, likeliest_partner, moved_in, seeds
from irt.diagnosis.result import UNLISTED
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Effects fitted alone before all are, and as partners of the best of those and of the second.
SINGLES, PARTNERS = 8, (6, 4)
#: Of the best effects alone so many are fitted in twos.
PAIRED = 4
#: Effects tried in the place of each one of the best hypothesis.
SWAPS = 4
#: Hypotheses of each size that are refined.
REFINED = 3
#: Once a hypothesis leaves nothing to explain, others are fitted if they explained this share of its share.
RIVAL = 0.3
#: A single effect that explains less is compared with all others [nats].
CLEAR = 100.0
#: Share of what chance leaves that an effect with a place takes away by more than chance.
MORE_THAN_CHANCE = 0.5
#: Effects that are named together, at most.
MOST_EFFECTS = 3


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

    def larger(self, best: Fitted, size: int) -> Fitted:
        """Try so many effects together where fewer leave something, and return the best hypothesis."""
        # Two effects may show together where neither does alone; a third one needs two.
        if size > max(2, len(best.effects) + 1) or self.is_done(best):
            return best
        between = self.is_explained_between(best)
        # Few rows between impacts may take one effect's values for two: what leaves much of whole runs has to
        # stand up to a second one. A third has to show between impacts.
        if between and (size > 2 or not best.effects or is_trusted(self.case, best, self.base)):
            return self._with_impacts(best)
        if size == 2:
            self._pair_up()
        counts = PARTNERS if size == 2 else PARTNERS[:1]
        for parent, count in zip(self._different(size - 1), counts, strict=False):
            if self.ranked(size) and self.is_done(self.ranked(size)[0]):
                break
            self._expand_by_any(parent, count)
        self._move_in(size)
        self._refine(size)
        if self._takes_enough(self.ranked(size)[0], self.ranked(size - 1)[0]):
            self._replace(self.ranked(size)[0])
            self._swap(self.ranked(size)[0])
        grown = self._grown(best, size)
        return self._with_impacts(grown) if between and grown.effects == best.effects else grown

    def pruned(self, best: Fitted) -> Fitted:
        """Return the best hypothesis without effects that turn out to be worth nothing beside the others."""
        for name in best.effects:
            without = self.without(best, name)
            if not self.evidence().is_better(best, without) or not self.is_supported(best, without):
                return self.pruned(without)
        return best

    def beside(self, parent: Fitted, names: Sequence[str]) -> Fitted:
        """Return a hypothesis that has to stay with the one effect more that is worth it, or as it is.

        Of what delays leave that differ by chance, something with a place takes a third, wherever it is.
        """
        self._expand(parent, names, PARTNERS[0])
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

    def _with_impacts(self, best: Fitted) -> Fitted:
        """Try a law of impacts beside a hypothesis that leaves nothing between them."""
        names = [name for name in hypotheses() if acts_on_impacts_alone(name)]
        if set(names) & set(best.effects):
            return best
        self._expand(best, names, len(names))
        size = len(best.effects) + 1
        self._refine(size)
        return self._grown(best, size)

    def with_partners(self, best: Fitted) -> Fitted:
        """Add what explains most between impacts, where whole runs go astray at the rim and hide it."""
        while len(best.effects) < MOST_EFFECTS:
            if is_explained(self.case, best, self.base) or self.is_explained_between(best):
                break
            found = likeliest_partner(self.between_impacts, best, self.case.noise, self.report)
            if found is None:
                break
            points = np.array([found.values, found.begun_at(best)])
            whole = self.fit(found.effects, points, rounds=0)
            if whole.loss(self.case.noise) > best.loss(self.case.noise):
                break
            best = self.fits[frozenset(whole.effects)]
        return best

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

    def _different(self, size: int) -> list[Fitted]:
        """Return the hypotheses of a size, the best first, of those that are one by two names the better."""
        found: dict[frozenset[str], Fitted] = {}
        for one in self.ranked(size):
            names = frozenset(one.effects)
            found.setdefault(names - ALIKE | ({min(ALIKE)} if names & ALIKE else set()), one)
        return list(found.values())

    def _pair_up(self) -> None:
        """Fit the best effects alone in twos, from where each led.

        A draw of one, laid beside what the other leaves, hardly tells them: alone each also did what it could
        of the other's part.
        """
        count = len(PARAMETERS)
        for one, other in itertools.combinations(self._different(1)[:PAIRED], 2):
            values = [*one.values[count:], *other.values[count:]]
            self._fit_from_both((*one.effects, *other.effects), values, (one, other))

    def _expand_by_any(self, parent: Fitted, count: int) -> None:
        """Fit a parent with one effect more, of all that it does not have."""
        self._expand(parent, [name for name in hypotheses() if name not in parent.effects], count)

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

    def _swap(self, one: Fitted) -> None:
        """Try others in the place of each effect of a hypothesis: what came first may only have stood in.

        And each effect anew beside the others: which came first decides in which minimum a fit ends.
        """
        for name in one.effects:
            self._expand_by_any(self.without(one, name), SWAPS)
        self._refine(len(one.effects))

    def _replace(self, one: Fitted) -> None:
        """Try what does most alone, from where it led, in the place of each effect of a hypothesis.

        Without what stands in for it the others may be lost, and a draw beside them hardly tells anything.
        """
        count = len(PARAMETERS)
        for name, single in itertools.product(one.effects, self._different(1)[:PAIRED]):
            if single.effects[0] in one.effects:
                continue
            rest = [other for other in one.effects if other != name]
            kept = [value for other in rest for value in one.value_of(other).values()]
            self._fit_from_both((*single.effects, *rest), [*single.values[count:], *kept], (single, one))

    def _fit_from_both(
        self, names: tuple[str, ...], values: Sequence[float], begun: tuple[Fitted, Fitted]
    ) -> None:
        """Fit effects from these values of theirs, with the five parameters of each of two hypotheses."""
        self.report(" + ".join(names))
        points = [[*one.values[: len(PARAMETERS)], *values] for one in begun]
        self.fit(names, np.array(points), rounds=0)

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
