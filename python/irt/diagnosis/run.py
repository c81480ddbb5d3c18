"""From recordings to a diagnosis: choose the set of effects, locate, prove, and say it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from threadpoolctl import threadpool_limits

from irt import arguments
from irt.checking.run import required
from irt.diagnosis import config
from irt.diagnosis.answer import Answer
from irt.diagnosis.case import Case
from irt.diagnosis.hypotheses import MAP, hypotheses
from irt.diagnosis.learned import learn
from irt.diagnosis.locate import CLEAR
from irt.diagnosis.needed import Needed
from irt.diagnosis.relevance import Relevance
from irt.diagnosis.result import Diagnosis
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.selection import Selection
from irt.files import PathLike
from irt.fitting.fit import Progress
from irt.rig import Rig, as_rig

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
        If the rig is not as it must be, or its recordings can identify nothing or are certainly wrong
        (`irt.check` says more).
    """
    began = time.perf_counter()
    arguments.whole("seed", seed)
    arguments.threads(threads)
    arguments.progress(progress)
    rig = as_rig(rig).on_bare_board()
    warnings = required(rig, threads=threads)
    # More threads add up in another order, and wait for each other longer than such matrices take.
    with threadpool_limits(1, user_api="blas"):
        found = _diagnosed(Case.of(rig.of_marbles(), seed=seed, threads=threads), _reporter(progress))
    if progress is not None:
        progress(_STEPS, _STEPS, "done")
    return replace(found, warnings=warnings, seconds=time.perf_counter() - began)


def _diagnosed(case: Case, report: Callable[[str], None]) -> Diagnosis:
    """Go the whole way, from recordings to words."""
    scores = Scores(case)
    selection = Selection(scores, hypotheses(case.rig.start), report)
    posterior = selection.run()
    relevance = Relevance(selection, posterior)
    report("which effects matter")
    kept, immaterial = relevance.kept(relevance.freed(posterior.best))
    learned = _learned(relevance, kept, posterior.best)
    if learned is not None:
        kept, more = relevance.kept(relevance.freed(learned))
        immaterial |= more
    return Answer(kept, relevance, immaterial).diagnosis(report)


def _learned(relevance: Relevance, kept: Scored, best: Scored) -> Scored | None:
    """Return what is more probable than the best set, with what can be learned without a name.

    It is asked for where the set needs a push that depends on something, and leaves a share of the error. It
    is learned beside the set, and in its place: effects may only have stood in for it. A map does even where
    it leaves nothing that depends on anything.
    """
    scores, report = relevance.selection.scores, relevance.selection.report
    base = scores.base()
    left = relevance.validation.of(kept).mae / relevance.validation.of(base).mae
    in_place = [relevance.selection.without(best, MAP)] if MAP in best.effects else []
    is_enough = not in_place and (scores.push(best) < config.SURE or left < config.WORTH)
    if is_enough:
        return None
    beside = [base, best] if Needed(best).p_value <= CLEAR else []
    parents = dict.fromkeys([*beside, *in_place])
    found = [one for parent in parents if (one := learn(parent, report)) is not None]
    found = [one for one in found if one.score > best.score + config.SURE]
    return max(found, key=lambda one: one.score, default=None)


def _reporter(progress: Progress | None) -> Callable[[str], None]:
    steps = 0

    def report(text: str) -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(min(steps, _STEPS - 1), _STEPS, text)

    return report
