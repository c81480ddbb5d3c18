"""What recordings could have shown: from which size on an effect would have been named."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectParameter, effect
from irt.diagnosis import config
from irt.diagnosis.hypotheses import JITTER, hypotheses
from irt.diagnosis.result import Power
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.screening import Screening
from irt.fitting.effect_size import size_of

Array = NDArray[np.float64]

#: Sizes tried of each effect, and values of its other parameters.
SIZES, OTHERS = 8, 4
#: Standard deviations that the gain must lie above the threshold: eight times in ten it then does.
_SURE = 0.84


def detectability(scores: Scores, base: Scored) -> list[Power]:
    """Return the smallest size of each effect of the catalogue that these recordings would have shown.

    To first order: what an effect of this size changes of the predictions, beyond what the five parameters
    could do as well, against the score at which it is named.
    """
    screening = Screening(scores, base)
    return [
        one
        for name in hypotheses(scores.case.rig.start)
        if name != JITTER and not effect(name).shrunk
        for one in _of(screening, name, scores.price([name]) + config.SURE, scores.case.seed)
    ]


def _of(screening: Screening, name: str, needed: float, seed: int) -> Iterator[Power]:
    parameters = effect(name).required
    size = size_of(name)
    for index in range(len(parameters)) if size is None else (size,):
        one = parameters[index]
        if not math.isfinite(one.neutral):
            continue
        values, ladder = _ladder(parameters, index, alone=size is None, seed=seed)
        typical = np.median(screening.shown(name, values).reshape(SIZES, -1), axis=1)
        seen = typical - _SURE * np.sqrt(2.0 * typical) >= needed
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
    ladder = one.neutral + (end - one.neutral) * np.logspace(-2.5, 0.0, SIZES)
    others = np.array([[p.drawn(random) for p in parameters] for _ in range(1 if alone else OTHERS)])
    if alone:
        others[:] = [p.neutral for p in parameters]
    values = np.tile(others, (SIZES, 1))
    values[:, index] = np.repeat(ladder, len(others))
    return values, ladder
