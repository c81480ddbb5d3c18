"""From recordings to a diagnosis: fit, locate, name, compare, prove."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from irt import arguments
from irt.catalogue import effect
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.evidence import is_explained, is_most_left
from irt.diagnosis.found import Found
from irt.diagnosis.grip import grips
from irt.diagnosis.heldout import hold_out
from irt.diagnosis.hypotheses import ALIKE, hypotheses
from irt.diagnosis.jitter import kicks, matters, spread
from irt.diagnosis.latent import Leftover
from irt.diagnosis.library import Term
from irt.diagnosis.locate import locate, stages, variables
from irt.diagnosis.partners import Report
from irt.diagnosis.result import UNLISTED, Diagnosis, Finding, NamedEffect
from irt.diagnosis.rivals import rivals
from irt.diagnosis.search import Search
from irt.diagnosis.several import Several, several
from irt.diagnosis.unlisted import Library, is_more_probable
from irt.files import PathLike
from irt.fitting.effect_size import size_of
from irt.fitting.fit import Progress
from irt.model import Parameter
from irt.rig import Rig, as_rig

#: Effects that make up for what delays that differ come late by in the mean.
MADE_UP = ("delay", "latency", "lag")
#: The effect that stands for the mean of delays that differ.
MEAN = "delay"
#: What leaves far more than noise, and more than this share of the error on recordings held out, only stands
#: in for something else: no name is better than such a one.
BELIEVED = 0.85
#: Steps that a diagnosis takes at most, for the progress bar alone.
_STEPS = 120


@arguments.entry
def diagnose(
    rig: Rig | PathLike, *, seed: int = 0, threads: int | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Fit, locate the mismatch, name the missing physics, model it, and prove it on recordings held out.

    Parameters
    ----------
    rig : Rig or path
        The recordings, or their folder; a rig of one recording can be diagnosed, but not proved.
    seed : int
        Of all draws. The same seed gives the same answer for any number of threads.
    threads : int, optional
        Threads of the engine; by default one for each core.
    progress : callable, optional
        Called with (done, total, text); the text says what is tried.

    Raises
    ------
    IrtError
        If the rig is not as it must be, some recordings are stamped and others not, or nothing was seen.
    """
    began = time.perf_counter()
    arguments.whole("seed", seed)
    arguments.threads(threads)
    arguments.progress(progress)
    rig = as_rig(rig).of_marbles()
    steps = 0

    def report(text: str) -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(min(steps, _STEPS - 1), _STEPS, text)

    # More threads add up in another order, and wait for each other longer than such matrices take.
    with threadpool_limits(1, user_api="blas"):
        search = Search(Case.of(rig, seed=seed, threads=threads), report)
        found = _found(search, report)
    if progress is not None:
        progress(_STEPS, _STEPS, "done")
    return replace(found, seconds=time.perf_counter() - began)


def _found(search: Search, report: Report) -> Diagnosis:
    """Search, locate, compare and prove."""
    answer = _searched(search, report)
    case, best = answer.case, answer.best
    report("how well the marble grips the board")
    possible = grips(case, best)
    if possible[0][0] is not case:
        search.remember(possible[0][1], hold_out(*possible[0]))
    report("where the mismatch is")
    where: tuple[Finding, ...] = ()
    if best.effects or not is_explained(case, best, search.base):
        sources = Leftover(search.case, search.base).sources(search.case.seed)
        where = (
            *variables(answer.terms, sources),
            *locate(search.case, search.base, search.evidence().scale),
            *stages(search.case, search.base, sources),
        )
    report("rivals")
    tied = {} if UNLISTED in best.effects else rivals(search, best, _rivalled(best, answer.spread))
    report("the proof")
    diagnosis = Found(search, possible, tied, answer.spread, answer.several).diagnosis(where)
    leaves = answer.is_of_catalogue and not _is_all(search, best)
    if leaves or answer.spread is not None:
        # Beside what was not found, or differs by chance, a size that may as well be none says nothing.
        kept = best
        for name in [
            one.name for one in diagnosis.effects if one.name in best.effects and may_be_absent(one)
        ]:
            kept = search.without(kept, name)
        if kept is not best:
            diagnosis, best = _told(search, kept, where, answer.spread, answer.several), kept
    if not best.effects or not is_doubtful(diagnosis, leaves=leaves, is_of_catalogue=answer.is_of_catalogue):
        return diagnosis
    if answer.known is not None and answer.known.effects:
        # What was learned does not predict; what it stood in for may.
        known = _told(search, answer.known, where)
        doubtful = is_doubtful(known, leaves=True, is_of_catalogue=True)
        if not doubtful and not any(map(may_be_absent, known.effects)):
            return known
    return _told(search, search.base, where)


def _told(
    search: Search,
    one: Fitted,
    where: Sequence[Finding],
    of_chance: Parameter | None = None,
    found: Several | None = None,
) -> Diagnosis:
    """Say what a hypothesis of the catalogue comes to, as the answer; `of_chance` if its delays differ."""
    if of_chance is not None:
        shown = kicks(search.case, one, search.evidence().price(2, 1))
        of_chance = of_chance if shown is None else spread(search.case, one, shown)
    tied = rivals(search, one, _rivalled(one, of_chance))
    return Found(search, [(search.case, one)], tied, of_chance, found).diagnosis(where)


def _rivalled(one: Fitted, of_chance: Parameter | None) -> list[str]:
    """Return the effects in whose place another may do as well: no other is like delays that differ."""
    return [name for name in one.effects if of_chance is None or name != MEAN]


def _is_all(search: Search, best: Fitted) -> bool:
    """Whether a hypothesis leaves noise, everywhere or between impacts."""
    return is_explained(search.case, best, search.base) or search.is_explained_between(best)


def may_be_absent(one: NamedEffect) -> bool:
    """Whether the interval of an effect's size, or those of all its parameters, hold the neutral values."""
    parameters, size = effect(one.name).required, size_of(one.name)
    asked = parameters if size is None else (parameters[size],)
    told = [(one.parameters[parameter.name], parameter.neutral) for parameter in asked]
    return all(
        value.low is None or value.high is None or value.low <= neutral <= value.high
        for value, neutral in told
    )


def is_doubtful(told: Diagnosis, *, leaves: bool, is_of_catalogue: bool) -> bool:
    """Whether an answer that leaves more than noise is not confirmed by the recordings held out.

    Names that leave something, and what was learned, must predict recordings held out so much better that a
    part of the physics must be right: a likelihood may gain in few rows, and the error not at all. Where
    nothing can be held out, what was learned without a name claims less than a name would.
    """
    if told.verdict != "unlisted" and not (leaves and told.is_held_out):
        return False
    if not told.is_held_out:
        return is_of_catalogue
    return told.final_heldout_mae >= BELIEVED * told.base_heldout_mae


@dataclass(frozen=True, eq=False)
class _Answer:
    """The hypothesis chosen, and the case with what it holds.

    With the spread of delays where they differ [s], the terms of what was learned, what the catalogue has in
    its place, and how the set was found where it was searched with a random push.
    """

    case: Case
    best: Fitted
    spread: Parameter | None = None
    terms: tuple[Term, ...] = ()
    known: Fitted | None = None
    several: Several | None = None

    @property
    def is_of_catalogue(self) -> bool:
        return self.spread is None and UNLISTED not in self.best.effects


def _searched(search: Search, report: Report) -> _Answer:
    """Choose a hypothesis: one effect, several and a random push, delays that differ, something unlisted.

    One effect that leaves noise ends the search. So does what was learned and leaves noise, where no effect
    alone does much and pushes of one family explain the motion: a board that swings after its knobs, and a
    drag by the direction of motion, were taken for delays that differ. Else the most probable set of effects
    is searched, with a random push besides. If it needs no push, nothing is missing. If it does, and one term
    explains the motion or the set leaves most of the mismatch, delays that differ by chance and a learned
    push are asked; a learned push has to be more probable than the set.
    """
    case, best = search.case, search.singles()
    if search.is_done(best):
        return _Answer(case, best)
    library = Library(search)
    if library.is_strange:
        answer = _learned(library, best, report)
        if search.is_done(answer.best):
            return answer
    found = several(search)
    if found.is_whole:
        return _Answer(case, found.fitted, several=found)
    if library.is_repeatable or not found.fitted.effects or is_most_left(case, found.fitted, search.base):
        by_chance = _by_chance(search, library, found.fitted, report)
        if by_chance is not None:
            return by_chance
        learned = _learned(library, found.fitted, report)
        if learned.terms and is_more_probable(learned.case, learned.best, len(learned.terms), found):
            return learned
    return _Answer(case, found.fitted, several=found)


def _by_chance(search: Search, library: Library, best: Fitted, report: Report) -> _Answer | None:
    """Choose delays that differ, or what one term explains and leaves noise where they seem to."""
    jittering = _jittering(search, best, report)
    if jittering is None or not library.is_repeatable:
        return jittering
    learned = _learned(library, best, report)
    return learned if search.is_done(learned.best) else jittering


def _learned(library: Library, best: Fitted, report: Report) -> _Answer:
    """Choose between the catalogue's best hypothesis and what can be learned without a name."""
    report("physics that the catalogue does not have")
    learned = library.beyond(best)
    if learned is None:
        return _Answer(library.search.case, best)
    case, terms, fitted = learned
    return _Answer(case, fitted, terms=terms, known=best)


def _jittering(search: Search, best: Fitted, report: Report) -> _Answer | None:
    """Choose delays that differ, with what else is missing beside their mean.

    They must show beside the best hypothesis, too, if that makes up for their mean: what a clock that drifts
    leaves beside a delay looks like them. Where they do not show beside their mean alone they may beside the
    effect that explains most.
    """
    report("delays that differ from command to command")
    price = search.evidence().price(2, 1)
    made_up = set(MADE_UP) & set(best.effects)
    if made_up and kicks(search.case, best, price, is_rounded=not made_up & ALIKE) is None:
        return None
    for parent in _mains(search, best):
        mean = search.with_effect(MEAN, parent)
        shown = kicks(search.case, mean, price)
        if shown is None:
            continue
        full = search.beside(mean, [name for name in hypotheses() if name not in {*ALIKE, *mean.effects}])
        told = shown if full is mean else kicks(search.case, full, price)
        if told is None or not matters(search.case, full):
            return None
        return _Answer(search.case, full, spread(search.case, full, told))
    return None


def _mains(search: Search, best: Fitted) -> Iterator[Fitted]:
    """Yield the base model, and the effect that explains most alone, if it does not make up for delays."""
    yield search.base
    singles = [one for one in search.ranked(1) if one.effects[0] in best.effects]
    if singles and singles[0].effects[0] not in MADE_UP:
        yield singles[0]
