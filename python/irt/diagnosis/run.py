"""Run a diagnosis: select the set of effects, locate the mismatch, validate, and report."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from irt import arguments
from irt.checking.run import required
from irt.diagnosis import config
from irt.diagnosis.answer import Answer
from irt.diagnosis.dataset import Dataset
from irt.diagnosis.hypotheses import INERTIA, JITTER, MAP, hypotheses
from irt.diagnosis.learned import Corrections
from irt.diagnosis.relevance import Relevance
from irt.diagnosis.result import UNLISTED, Diagnosis
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.selection import Selection
from irt.files import PathLike
from irt.fitting.fit import Progress
from irt.fitting.robust import mean_absolute
from irt.rig import Rig, as_rig

#: Most steps of a diagnosis, for the progress bar.
_STEPS = 120


@arguments.entry
def diagnose(
    rig: Rig | PathLike, *, seed: int = 0, threads: int | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Fit, locate the mismatch, identify the missing physics, model it, and validate it on held-out runs.

    Parameters
    ----------
    rig : Rig or path
        The rig or its folder. With a single recording there is no validation.
    seed : int
        Random seed. The same seed gives the same result for any number of threads.
    threads : int, optional
        Threads of the engine; by default one per core.
    progress : callable, optional
        Called with (done, total, text); the text names the current step.

    Raises
    ------
    IrtError
        If the rig is invalid, or if its recordings can identify nothing or contain a certain error (see
        `irt.check`).
    """
    began = time.perf_counter()
    arguments.whole("seed", seed)
    arguments.threads(threads)
    arguments.progress(progress)
    rig = as_rig(rig).on_bare_board()
    warnings = required(rig, threads=threads)
    # More BLAS threads change the order of summation, and are slower on matrices of this size.
    with threadpool_limits(1, user_api="blas"):
        found = _diagnosed(Dataset.of(rig, seed=seed, threads=threads), _reporter(progress))
    if progress is not None:
        progress(_STEPS, _STEPS, "done")
    return replace(found, warnings=warnings, seconds=time.perf_counter() - began)


def _diagnosed(dataset: Dataset, report: Callable[[str], None]) -> Diagnosis:
    """Run all stages of a diagnosis."""
    scores = Scores(dataset)
    selection = Selection(scores, hypotheses(dataset.rig.start, tilt=dataset.has_tilt), report)
    corrections = Corrections(scores, report)
    posterior = selection.run(corrections.beat)
    relevance, best = Relevance(selection, posterior), posterior.best
    report("relevance of effects")
    learned, immaterial = None, frozenset[str]()
    if len(best.effects) > 1 and corrections.beat(best, is_last=True):
        learned = _more_probable(_corrected(selection, corrections, best), best)
    if learned is None:
        kept, immaterial = relevance.kept(relevance.freed(best))
        learned = _learned(relevance, corrections, kept, best)
    if learned is not None:
        learned = Selection(Scores.of(learned), (), report).with_inertia(learned)
        relevance = Relevance(selection, posterior.beside(learned))
        kept, more = relevance.kept(relevance.freed(learned))
        immaterial |= more
    baseline, held = selection.baseline, relevance.validation
    if relevance.named(kept):
        if UNLISTED not in kept.effects and held.of(kept).misses_motion:
            # Where most of the motion is unexplained, effects only imitate its cause.
            kept = baseline
    elif INERTIA not in kept.effects and held.of(baseline).mae <= held.of(kept).mae:
        # The likeliest five parameters may predict worse than least squares do.
        kept = baseline
    return Answer(kept, relevance, immaterial).diagnosis(report)


def _learned(relevance: Relevance, corrections: Corrections, kept: Scored, best: Scored) -> Scored | None:
    """Return a set with a learned correction that is more probable than the best set, or None.

    A correction is learned if the best set needs a random push, correlated noise or delays that jitter, and
    if a share of the error remains. It is learned in addition to the set and in place of it, because effects
    may only have approximated it. A slope map is always challenged by a correction, because it can
    approximate one. If the set needs no random push, but predicts held-out recordings clearly worse than the
    tracker sees them, only forces at the rim are learned: random rebounds and departures stand for them.
    """
    selection, noise = relevance.selection, kept.dataset.noise
    scores = selection.scores
    error, before = (relevance.validation.of(one).mae for one in (kept, selection.baseline))
    is_random = JITTER in best.effects or not scores.is_whole(best)
    is_small = error < config.WORTH * before
    if MAP in best.effects or (is_random and not is_small):
        found = _corrected(selection, corrections, best)
    elif is_small or error < (1.0 + config.EXCEEDS) * mean_absolute(noise):
        return None
    else:
        found = [corrections.at_rim(one) for one in dict.fromkeys([scores.base(), best])]
    return _more_probable(found, best)


def _corrected(selection: Selection, corrections: Corrections, best: Scored) -> list[Scored | None]:
    """Return corrections in place of all effects, and beside those of a set and those that are no map."""
    in_place = [selection.without(best, MAP)] if MAP in best.effects else []
    parents = [one for one in dict.fromkeys([best, *in_place]) if one.effects]
    return [corrections.alone(), *(corrections.of(one) for one in parents)]


def _more_probable(found: Sequence[Scored | None], best: Scored) -> Scored | None:
    """Return the most probable of some sets, if it is more probable than the best set."""
    better = [one for one in found if one is not None and one.score > best.score + config.SURE]
    return max(better, key=lambda one: one.score, default=None)


def _reporter(progress: Progress | None) -> Callable[[str], None]:
    steps = 0

    def report(text: str) -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(min(steps, _STEPS - 1), _STEPS, text)

    return report
