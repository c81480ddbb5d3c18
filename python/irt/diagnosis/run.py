"""From recordings to a diagnosis: choose the set of effects, locate, prove, and say it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from threadpoolctl import threadpool_limits

from irt import arguments
from irt.diagnosis import config
from irt.diagnosis.answer import Answer
from irt.diagnosis.case import Case
from irt.diagnosis.hypotheses import hypotheses
from irt.diagnosis.learned import learn
from irt.diagnosis.relevance import Relevance
from irt.diagnosis.result import Diagnosis
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.selection import Posterior, Selection
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
        If the rig is not as it must be, some recordings are stamped and others not, or nothing was seen.
    """
    began = time.perf_counter()
    arguments.whole("seed", seed)
    arguments.threads(threads)
    arguments.progress(progress)
    rig = as_rig(rig).of_marbles()
    # More threads add up in another order, and wait for each other longer than such matrices take.
    with threadpool_limits(1, user_api="blas"):
        found = _diagnosed(Case.of(rig, seed=seed, threads=threads), _reporter(progress))
    if progress is not None:
        progress(_STEPS, _STEPS, "done")
    return replace(found, seconds=time.perf_counter() - began)


def _diagnosed(case: Case, report: Callable[[str], None]) -> Diagnosis:
    """Go the whole way, from recordings to words."""
    scores = Scores(case)
    selection = Selection(scores, hypotheses(), report)
    posterior = selection.run()
    chosen = _with_learned(scores, posterior, report)
    relevance = Relevance(selection)
    report("which effects matter")
    kept = relevance.kept(chosen)
    return Answer(kept, posterior, relevance).diagnosis(report)


def _with_learned(scores: Scores, posterior: Posterior, report: Callable[[str], None]) -> Scored:
    """Return the most probable set; if it needs a random push, with what can be learned without a name.

    That is learned beside the set, and in its place: effects may only have stood in for it.
    """
    best = posterior.best
    if scores.push(best) < config.SURE:
        return best
    parents = [best] if not best.effects else [best, scores.base()]
    found = [one for parent in parents if (one := learn(parent, report)) is not None]
    return max((best, *found), key=lambda one: one.score)


def _reporter(progress: Progress | None) -> Callable[[str], None]:
    steps = 0

    def report(text: str) -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(min(steps, _STEPS - 1), _STEPS, text)

    return report
