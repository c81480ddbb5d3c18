"""What recordings could have shown: from which size on an effect would have been named."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectParameter, effect, hypothetical
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.evidence import Evidence
from irt.diagnosis.hypotheses import acts_on_impacts_alone, is_law_of_impacts
from irt.diagnosis.impacts import LEAST_OF_IMPACTS, between_impacts
from irt.diagnosis.result import Power
from irt.diagnosis.screen import Screen
from irt.fitting.effect_size import size_of

Array = NDArray[np.float64]

#: Sizes tried of each effect, and values of its other parameters.
SIZES, OTHERS = 16, 8
#: Standard deviations that the gain must lie above the threshold: eight times in ten it then does.
_SURE = 0.84


def power(case: Case, base: Fitted, evidence: Evidence) -> list[Power]:
    """Return the smallest size of each effect of the catalogue that these recordings would have shown.

    To first order: what an effect of this size changes, beyond what the base model could do as well, against
    the threshold of naming it. As for naming, what counts is between impacts, but for effects that act in
    impacts alone.
    """
    between = between_impacts(case, base)
    lengths = [len(one.knobs) for one in between.segments]
    whole = Screen(case, base, max(len(one.knobs) for one in case.segments))
    # Half of the stretches are longer, and cut.
    apart = Screen(between, base, int(np.median(lengths))) if lengths else None
    return [
        told
        for info in hypothetical()
        for told in _of(case, whole if acts_on_impacts_alone(info.name) else apart, info.name, evidence)
    ]


def _of(case: Case, screen: Screen | None, name: str, evidence: Evidence) -> Iterator[Power]:
    parameters = effect(name).required
    size = size_of(name)
    for index in range(len(parameters)) if size is None else (size,):
        one = parameters[index]
        if not math.isfinite(one.neutral):
            continue
        values, ladder = _ladder(parameters, index, alone=size is None, seed=case.seed)
        gains = np.zeros((SIZES, OTHERS))
        if screen is not None:
            gains = screen.gains(name, values).reshape(SIZES, OTHERS)
        typical = np.median(gains, axis=1)
        needed = evidence.needed(sum(not one.is_choice for one in parameters))
        seen = typical - _SURE * np.sqrt(2.0 * typical) >= needed
        if is_law_of_impacts(name):
            seen &= np.abs(ladder - one.neutral) > LEAST_OF_IMPACTS * (one.high - one.low)
        # From where on all larger ones are seen too.
        hidden = np.flatnonzero(~seen)
        first = 0 if len(hidden) == 0 else int(hidden[-1]) + 1
        least = float(abs(ladder[first] - one.neutral)) if first < SIZES else None
        yield Power(name, one.name, one.unit, least, float(abs(ladder[-1] - one.neutral)))


def _ladder(
    parameters: tuple[EffectParameter, ...], index: int, *, alone: bool, seed: int
) -> tuple[Array, Array]:
    """Return values (SIZES * OTHERS, p) with a ladder of sizes of one parameter, and the ladder.

    The others are neutral where it acts alone, else drawn.
    """
    random = np.random.default_rng(seed)
    one = parameters[index]
    end = one.high if abs(one.high - one.neutral) >= abs(one.low - one.neutral) else one.low
    ladder = one.neutral + (end - one.neutral) * np.logspace(-3.0, 0.0, SIZES)
    others = np.array([[p.drawn(random) for p in parameters] for _ in range(OTHERS)])
    if alone:
        others[:] = [p.neutral for p in parameters]
    values = np.tile(others, (SIZES, 1))
    values[:, index] = np.repeat(ladder, OTHERS)
    return values, ladder
