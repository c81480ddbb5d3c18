"""Whether an effect shows between impacts, where no engine's contact solver has a say.

How a marble leaves a rim differs a little from engine to engine and from wall to wall. From there on it goes
elsewhere, and something in the catalogue will follow it: so what an effect explains after impacts alone is no
reason to name it. Between impacts physics is known to the digits of the tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.evidence import Evidence, is_noise
from irt.diagnosis.hypotheses import acts_on_impacts_alone, is_law_of_impacts
from irt.diagnosis.stretches import FREE, SHORTEST, runs
from irt.path_length import bridged
from irt.segments import Segment

Array = NDArray[np.float64]

#: How far from its place a shifted or bent picture may show the rim [board edges].
SHIFTED = 0.1
#: Share of rows that lie farther out than where the marble is taken to turn back: outliers do.
OUTERMOST = 0.005
#: Share of the range from which on a law of impacts is told from how an engine solves contacts: rapier's
#: walls without restitution are fitted as 0.05 to 0.11 of it.
LEAST_OF_IMPACTS = 0.15


def between_impacts(case: Case, fitted: Fitted) -> Case:
    """Return the case with those stretches alone in which the marble cannot have met the rim.

    The rim is where a hypothesis has it, or near there where the marble turns back: a picture may be shifted
    or bent.
    """
    seen = np.concatenate([segment.observed for segment in case.segments])
    reach = case.model(fitted).reach
    lowest, highest = np.nanquantile(seen, [OUTERMOST, 1.0 - OUTERMOST], axis=0)
    low = np.where(lowest < SHIFTED - reach, np.maximum(-reach, lowest), -reach) + FREE
    high = np.where(highest > reach - SHIFTED, np.minimum(reach, highest), reach) - FREE
    pieces: list[Segment] = []
    folds: list[int] = []
    for segment, fold in zip(case.segments, case.folds, strict=True):
        for first, stop in runs(_is_free(segment.observed, low, high)):
            if stop - first >= SHORTEST:
                pieces.append(segment.cut(first, stop))
                folds.append(int(fold))
    return replace(case, segments=tuple(pieces), folds=np.array(folds, dtype=np.int64))


def shows(between: Case, one: Fitted, over: Fitted) -> bool:
    """Whether stretches between impacts ask for the effects that a hypothesis has more than another.

    What acts in impacts alone can show nowhere else. Where a rim is engines agree on; but what throws a
    marble back must be beyond what they differ by.
    """
    added = [name for name in one.effects if name not in over.effects]
    if all(acts_on_impacts_alone(name) for name in added):
        return all(not is_law_of_impacts(name) or size_of_law(one, name) > LEAST_OF_IMPACTS for name in added)
    if not between.segments:
        return False
    # Each from where the other led, too: the gain must not be one of a better start.
    less = refitted(between, over, [over, one])
    more = refitted(between, one, [one, less])
    return Evidence.of(between, [more, less]).margin(more, less) > 0.0


def refitted(case: Case, one: Fitted, begun: Sequence[Fitted]) -> Fitted:
    """Refit a hypothesis from where some have led; what they do not have it has of its own."""
    fits = case.refine(one.effects, np.array([one.begun_at(other) for other in begun]))
    return min(fits, key=lambda fit: fit.loss(case.noise))


def is_explained_between(between: Case, one: Fitted) -> bool:
    """Whether nothing but noise is left between impacts: then no effect is missing that acts there."""
    if not between.segments:
        return False
    return is_noise(between, refitted(between, one, [one]))


def size_of_law(one: Fitted, name: str) -> float:
    """Return how far the values of an effect are from neutral, the farthest, as a share of their ranges."""
    values = one.value_of(name)
    return max(
        abs(values[parameter.name] - parameter.neutral) / (parameter.high - parameter.low)
        for parameter in effect(name).required
    )


def _is_free(observed: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Whether the marble was well inside from the row before to the row after, (n,)."""
    if not np.isfinite(observed).any():
        return np.zeros(len(observed), dtype=bool)
    path = bridged(observed)
    steps = np.abs(np.diff(path, axis=0))
    still = np.zeros((1, 2))
    step = np.maximum(np.concatenate([still, steps]), np.concatenate([steps, still]))
    return np.asarray(((path - step > low) & (path + step < high)).all(axis=1))
