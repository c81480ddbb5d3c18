"""Search for the most probable set of effects: add, drop and swap effects while the score grows."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from irt.catalogue import effect
from irt.diagnosis import config
from irt.diagnosis.hypotheses import ALIKE, INERTIA, JITTER, MAP, ON_AVERAGE, SMOOTHED
from irt.diagnosis.maxima import as_expected, from_draws, promising, without_pull
from irt.diagnosis.score import PULL, PUSH, Array, Scored, Scores, quiet
from irt.diagnosis.screening import Promise, Screening, child, place_of
from irt.diagnosis.sets import Posterior, is_rival, renamed
from irt.diagnosis.validation import Validation

Report = Callable[[str], None]


@dataclass(eq=False)
class Selection:
    """A search for the most probable set of effects.

    Attributes
    ----------
    scores : Scores
        Scores of the sets.
    names : sequence of str
        Effects to search.
    report : callable
        Called with the name of the next step.
    validation : Validation
        Decides between sets of similar probability.
    """

    scores: Scores
    names: Sequence[str]
    report: Report
    validation: Validation = field(default_factory=Validation)
    #: Sets, effects that they were refitted without, and scores of the sets.
    _without: set[tuple[frozenset[str], str, float]] = field(default_factory=set)
    #: Sets that were fitted from least squares, and fits from which thorough ones began.
    _from_free_runs: set[frozenset[str]] = field(default_factory=set)
    _thorough: set[Scored] = field(default_factory=set)

    def run(self, is_beaten: Callable[[Scored, bool], bool] = lambda _, __: False) -> Posterior:
        """Add the effect with the largest gain, drop superfluous effects, then try replacements of each.

        A set with white residuals is complete, and only challenged by replacements, or by a law of impacts if
        its rebounds are random. A slope map, which can
        describe any dependence on the position, is tried once no other effect helps; effects that
        approximated it are then dropped, and the map itself is challenged by the effects that it may
        approximate.

        Parameters
        ----------
        is_beaten : callable
            Called with the best set of two effects or more, and whether it has or refuses a slope map, the
            last resort; if it returns True, no more are added.
        """
        best = self.scores.base()
        challenges = [self._rebounding, self._grown_where_expected, self._swapped, self.merged]
        additions = [
            self._grown,
            self._grown_without_pull,
            self._grown_where_expected,
            self._swapped,
            self._mapped,
        ]
        laborious = [self._restarted, self._grown_from_rival, self.merged]
        # Steps that were tried from a set are not repeated when the set comes back with a better fit.
        tried: set[tuple[str, frozenset[str]]] = set()
        better: Scored | None = best
        while better is not None:
            is_whole = self.scores.is_whole(best)
            better = self._first_better(best, challenges if is_whole else additions, tried)
            if better is None and not is_whole:
                if len(best.effects) > 1 and is_beaten(best, True):
                    break
                better = self._first_better(best, laborious, tried)
            if better is not None:
                if set(better.effects) == set(best.effects):
                    # From other values the other steps may lead elsewhere.
                    tried = {(step, own) for step, own in tried if step == self._restarted.__name__}
                best = self._pruned(better)
                if len(best.effects) > 1 and is_beaten(best, MAP in best.effects):
                    break
        best = self._likelier_name(best)
        scored = [one for one in self.scores.known.values() if math.isfinite(one.score)]
        return Posterior(best, tuple(sorted(scored, key=lambda one: (-one.score, one.effects)) or [best]))

    @staticmethod
    def _first_better(
        one: Scored,
        steps: Sequence[Callable[[Scored], Scored | None]],
        tried: set[tuple[str, frozenset[str]]],
    ) -> Scored | None:
        """Return the better set of the first step that finds one, of those not tried from this set."""
        own = frozenset(one.effects)
        for step in steps:
            if (step.__name__, own) not in tried:
                tried.add((step.__name__, own))
                better = step(one)
                if better is not None:
                    return better
        return None

    @functools.cached_property
    def baseline(self) -> Scored:
        """The five parameters that predict held-out recordings best, to which effects are compared.

        Where much physics is missing, a noise that is the whole path may be likelier than parameters that
        predict. Effects get no credit for what least squares from the best free runs do without them.
        """
        base = self.scores.base()
        if base.is_exact:
            return base
        least = min(self.scores.fits_of_base, key=lambda one: one.fitted.noise)
        free = [self.scores.freed(one) for one in dict.fromkeys([base, least])]
        return min([base, *free], key=lambda one: self.validation.of(one).mae)

    def _likelier_name(self, one: Scored) -> Scored:
        """Return the more probable of a set and the same set with an equivalent effect of `ALIKE`."""
        own = ALIKE.intersection(one.effects)
        if not own or self.scores.dataset.has_tilt:
            return one
        other = renamed(one, *own)
        found = self.scores.ascend(
            other.effects,
            other.top.values[None],
            one.noise[None],
            one.top.states,
            iterations=config.THOROUGH,
        )
        return max((one, *found), key=lambda each: each.score)

    def _grown(self, parent: Scored) -> Scored | None:
        """Return the best set with one more effect, if it is better.

        If a first effect gains little, it competes with those that show at other local maxima of the five
        parameters.
        """
        names = self._other(parent)
        screened = Screening(self.scores, parent).promises(names)
        found = self._fitted(parent, screened[: config.FITTED], parent.score)
        better = self._if_better(found, parent, None)
        if parent.effects or (better is not None and better.score > parent.score + config.NEAR):
            return better
        for maximum, promises in promising(self.scores, names, {parent: screened}):
            to_beat = parent if better is None else better
            if maximum is not parent and maximum.score + promises[0].gain > to_beat.score - config.NEAR:
                found = self._fitted(maximum, promises[: config.SWAPPED], to_beat.score)
                better = self._if_better(found, to_beat, better)
        return better

    def _grown_without_pull(self, parent: Scored) -> Scored | None:
        """Return the best set with one more effect that shows with a white push only, if it is better.

        A slowly varying push absorbs constants. No such effect shows in the screening then, although the push
        would be smaller with it.
        """
        if parent.noise[PULL] <= config.LITTLE[1]:
            return None
        still, promises = without_pull(self.scores, parent, self._other(parent))
        found = self._fitted(still, promises[: config.SWAPPED], parent.score)
        return self._if_better(found, parent, None)

    def _grown_where_expected(self, parent: Scored) -> Scored | None:
        """Return the best set with one effect that shows in the middle of the ranges only, if it is better.

        At the maxima of the five parameters alone board and marble may stand still. No effect shows there,
        least of all one that holds the board, such as backlash larger than most commands.
        """
        if parent.effects or parent.is_exact:
            return None
        expected = as_expected(self.scores, parent)
        promises = Screening(self.scores, expected).promises(self._other(parent))
        found = self._fitted(expected, promises[: config.SWAPPED], parent.score)
        return self._if_better(found, parent, None)

    def _rebounding(self, parent: Scored) -> Scored | None:
        """Return the set with an additional law of impacts, if it is better and its rebounds are random."""
        laws = [name for name in self._other(parent) if effect(name).of_rims]
        if not laws or self.scores.rebounds(parent) < config.SURE:
            return None
        return self._if_better(self._best_child(parent, laws, len(laws), parent.score), parent, None)

    def with_inertia(self, one: Scored) -> Scored:
        """Return a set, with inertial forces of the turning board in addition if it is better then."""
        if INERTIA in one.effects:
            return one
        found = self._best_child(one, [INERTIA], 1, one.score)
        return self._if_better(found, one, one) or one

    def _mapped(self, parent: Scored) -> Scored | None:
        """Return the set with an additional slope map, if it is better."""
        if MAP in parent.effects:
            return None
        return self._if_better(self._best_child(parent, [MAP], 1, parent.score), parent, None)

    def _restarted(self, one: Scored) -> Scored | None:
        """Return a better fit of a set, from draws of all its effects and of each beside the others.

        An effect that was added at a poor maximum of the others leads to a poor one itself, at which the
        right set may have wrong values.
        """
        if not one.effects or one.is_exact:
            return None
        found = from_draws(self.scores, one)
        for name in one.effects:
            less = self._stripped(found, name)
            self._best_child(less, [name], 1, found.score, place_of(name, found.values))
            found = self.scores.known[frozenset(one.effects)]
        better = self._if_better(found, one, None)
        return better if better is not None and self._better(one, better) is better else None

    def _grown_from_rival(self, one: Scored) -> Scored | None:
        """Return a better set that adds an effect to a rival of a set, if there is one.

        Of two effects that explain about as much, the wrong one may leave less for the next effect.
        """
        for rival in _best([each for each in self.scores.known.values() if is_rival(one, each)], config.TOPS):
            for names in (self._other(rival), *([] if MAP in rival.effects else [[MAP]])):
                found = self._best_child(rival, names, config.SWAPPED, one.score)
                if found is not None and found.score > one.score:
                    better = self._if_better(self._settled(found), one, None)
                    if better is not None:
                        return better
        return None

    def _if_better(self, found: Scored | None, to_beat: Scored, otherwise: Scored | None) -> Scored | None:
        return found if found is not None and self._is_worth(found, to_beat) else otherwise

    def _is_worth(self, one: Scored, less: Scored) -> bool:
        """Whether a set is worth more effects than another.

        It must be more probable by odds of 99 to 1, or of 20 to 1 if the held-out recordings agree that it
        predicts better: few contacts may not say more.
        """
        gain = one.score - less.score
        return gain > config.SURE or (gain > config.TIE and self.validation.is_better(one, less))

    def _other(self, one: Scored) -> list[str]:
        """Return the effects that a set lacks, except the slope map and other names of its effects.

        A measured tilt distinguishes the effects of `ALIKE`, and both may act.
        """
        held = {*one.effects, MAP, *(SMOOTHED if JITTER in one.effects else ())}
        held |= ALIKE if ALIKE.intersection(one.effects) and not self.scores.dataset.has_tilt else set()
        return [name for name in self.names if name not in held]

    def _best_child(
        self,
        parent: Scored,
        names: Sequence[str],
        count: int,
        to_beat: float,
        place: tuple[float, float] | None = None,
    ) -> Scored | None:
        """Return the best set with one more effect, among those with the largest screened gains.

        Effects that have a place are also tried at `place` [m].
        """
        promises = Screening(self.scores, parent, place).promises(names)[:count]
        return self._fitted(parent, promises, to_beat)

    def _fitted(self, parent: Scored, promises: Sequence[Promise], to_beat: float) -> Scored | None:
        """Return the best set with one of the screened effects, which start with the largest gain.

        All starts take a few steps, the best of them more, and the best effects are fitted thoroughly, unless
        they are much less probable than the score to beat by then.
        """
        worth = max(config.LEAST, config.PROMISING * max((one.gain for one in promises), default=0.0))
        promises = [one for rank, one in enumerate(promises) if one.gain > worth or rank < config.TOPS]
        begun: list[Scored] = []
        # With small pushes a fit is poor for longer, but sees what larger ones hide: ranked on its own.
        for regime in zip(*(self._begun(parent, promise) for promise in promises), strict=True):
            early = list(itertools.chain(*regime))
            begun += early
            for one in _best(early, config.SECOND):
                begun += self._further(one, one.noise[None], config.FIRST)
        effects: dict[tuple[str, ...], Scored] = {}
        for one in _best(begun, len(begun)):
            effects.setdefault(one.effects, one)
        chosen = list(effects.values())[: config.TOPS]
        # The most promising effect may have started in a poor local maximum.
        first = child(parent.effects, promises[0].name) if promises else ()
        if first in effects and effects[first] not in chosen:
            chosen.append(effects[first])
        found = [self.thorough(one) for one in chosen if one.score > to_beat - config.NEAR]
        best = max(found, key=lambda one: one.score, default=None)
        if best is None or best.score < parent.score + config.SURE:
            return best
        near = [one for one in found if one.score > max(best.score - config.NEAR, parent.score)]
        return functools.reduce(self._better, [self._settled(one) for one in near]) if len(near) > 1 else best

    def _settled(self, one: Scored) -> Scored:
        """Repeat thorough fits of a set, and fits from draws of its posterior, until they gain nothing."""
        for _ in range(config.AGAIN):
            before, one = one, self.scores.shaken(self.thorough(one))
            if one.score < before.score + config.BETTER:
                break
        return one

    def _better(self, one: Scored, other: Scored) -> Scored:
        """Return the more probable of two sets, or of two similarly probable sets the better predictor.

        A random push compensates for much in the filter, but not in free runs. Delay jitter does not improve
        predictions, so only its likelihood counts.
        """
        alike = (JITTER in one.effects) == (JITTER in other.effects)
        if alike and abs(one.score - other.score) < config.CLOSE:
            return min(one, other, key=lambda each: self.validation.of(each).mae)
        return max(one, other, key=lambda each: each.score)

    def _begun(self, parent: Scored, promise: Promise) -> tuple[list[Scored], list[Scored]]:
        """Fit a set with one more effect for a few steps from its screened start values.

        Noise sizes start at those without the effect, and at those of a complete model: a list of fits each.
        """
        effects = child(parent.effects, promise.name)
        self.report(" + ".join(effects))
        values, noise = promise.starts[:2], promise.noise[:2]
        found = self.scores.ascend(
            effects,
            np.concatenate([values, values]),
            np.concatenate([noise, quiet(noise)]),
            parent.top.states,
            iterations=config.BEGUN,
        )
        return found[: len(values)], found[len(values) :]

    def _further(self, one: Scored, noise: Array, iterations: int) -> list[Scored]:
        values = np.tile(one.top.values, (len(noise), 1))
        return self.scores.ascend(one.effects, values, noise, one.top.states, iterations=iterations)

    def thorough(self, one: Scored) -> Scored:
        """Fit a set from its values, with its own and with small noise sizes, and once from least squares.

        Free runs are sensitive to a sticking marble, which a filter that corrects every row may miss.
        """
        key = frozenset(one.effects)
        if one in self._thorough:
            return self.scores.known[key]
        self._thorough.add(one)
        values, noise = [one.top.values] * 2, [one.noise, *quiet(one.noise[None])]
        if key not in self._from_free_runs:
            self._from_free_runs.add(key)
            values.append(self.scores.least_squares(one))
            noise.append(noise[1])
        self.scores.ascend(
            one.effects, np.stack(values), np.stack(noise), one.top.states, iterations=config.THOROUGH
        )
        return self.scores.known[key]

    def without(self, one: Scored, name: str) -> Scored:
        """Return a set without one of its effects, fitted from the values of the set.

        Delay jitter is replaced by its mean effect.
        """
        rest = tuple(other for other in one.effects if other != name)
        if name == JITTER:
            rest = (*rest, *ON_AVERAGE)
        if not rest:
            return self.scores.base()
        key = (frozenset(one.effects), name, one.score)
        if key not in self._without:
            self._without.add(key)
            self._refitted(one, rest)
        return self.scores.known[frozenset(rest)]

    def _refitted(self, one: Scored, rest: tuple[str, ...]) -> list[Scored]:
        """Fit some of the effects of a set, from the values of the set and with small and larger pushes."""
        values = np.tile(self.scores.from_where(self.scores.problem(rest), one), (3, 1))
        noises = np.tile(one.noise, (3, 1))
        noises[1:, PUSH] = config.PUSHES[1:3]
        return self.scores.ascend(rest, values, noises, one.top.states, iterations=config.THOROUGH)

    def _stripped(self, one: Scored, name: str) -> Scored:
        """Return a set without one of its effects, with all other values unchanged.

        A refit would let the others compensate, possibly too far from the optimum of a replacement: for
        example a changed drag destroys the phase of an eccentric marble. Noise sizes are those of the refit,
        because the posterior is rough where a model that lacks an effect hardly has any.
        """
        less = self.without(one, name)
        values = Scores.from_where(self.scores.problem(less.effects), one)
        return replace(less, top=replace(less.top, values=values, states=one.top.states))

    def _pruned(self, one: Scored) -> Scored:
        """Drop effects that gain nothing in addition to the others, the least important first.

        The set without an effect is searched as thoroughly as the set: at a poor maximum of it, an effect may
        gain what only the values of the others were wrong by.
        """
        smaller = [self.without(one, name) for name in one.effects]
        smaller = [self._settled(each) if each.score > one.score - config.NEAR else each for each in smaller]
        less = max(smaller, key=lambda each: each.score, default=one)
        return one if less is one or self._is_worth(one, less) else self._pruned(less)

    def _swapped(self, one: Scored) -> Scored | None:
        """Return a better set with one effect replaced, if there is one.

        The replacements of a single effect were tried before it was added, except those of a slope map, and
        of delay jitter by two effects, as which it counts.
        """
        return self._with_another(
            one, one.effects if len(one.effects) > 1 else {MAP, JITTER}.intersection(one.effects)
        )

    def _with_another(self, one: Scored, names: Collection[str]) -> Scored | None:
        for name in names:
            less = self._stripped(one, name)
            others = [other for other in self._other(less) if other not in one.effects]
            place = place_of(name, one.values)
            better = self._best_child(less, others, config.SWAPPED, one.score, place)
            is_better = better is not None and better.score > one.score + config.BETTER
            if better is not None and is_better and self._better(one, better) is better:
                return better
        return None

    def merged(self, one: Scored) -> Scored | None:
        """Return a better set with two effects replaced by one, if there is one.

        Two effects may imitate one that is missing, and neither can be replaced without the other. What one
        effect does happens at one stage, so both act at the same. With two effects in all nothing is left to
        try: each effect was compared with the first.
        """
        if len(one.effects) < 3:
            return None
        for pair in itertools.combinations(one.effects, 2):
            if len({effect(name).stage for name in pair}) > 1:
                continue
            rest = tuple(name for name in one.effects if name not in pair)
            # Whichever goes first, the same set remains; the search goes on from its better fit.
            fits = [fit for first in pair for fit in self._refitted(self.without(one, first), rest)]
            for less in _best(fits, 1):
                others = [other for other in self._other(less) if other not in pair]
                better = self._best_child(less, others, config.SWAPPED, one.score)
                if better is not None and better.score > one.score + config.BETTER:
                    return better
        return None


def _best(found: Sequence[Scored], count: int) -> list[Scored]:
    """Return the `count` best sets, the best first."""
    kept = [one for one in found if math.isfinite(one.score)]
    return sorted(kept, key=lambda one: -one.score)[:count]
