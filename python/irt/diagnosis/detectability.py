"""Detectability: the smallest size of each effect that the recordings would have revealed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectInfo, EffectParameter, effect
from irt.diagnosis import config
from irt.diagnosis.hypotheses import JITTER, hypotheses
from irt.diagnosis.result import Power
from irt.diagnosis.score import Scored, Scores
from irt.diagnosis.screening import Screening
from irt.fitting.effect_size import size_of, sizes_of
from irt.fitting.problem import in_unit_of

Array = NDArray[np.float64]

#: Sizes of each effect, and draws of its other parameters.
SIZES, OTHERS = 8, 4
#: Margin of the gain above the threshold in standard deviations, for a detection probability of 80 %.
_SURE = 0.84


def detectability(scores: Scores, base: Scored) -> list[Power]:
    """Return the smallest detectable size of each effect of the catalogue that a set lacks.

    To first order, the change of the predictions by an effect, beyond changes that the set's parameters could
    explain, is compared with the score at which an effect is named.
    """
    screening, rig = Screening(scores, base), scores.dataset.rig
    return [
        one
        for name in hypotheses(rig.start)
        if name not in {JITTER, *base.effects} and not effect(name).shrunk
        for one in _of(
            screening, in_unit_of(rig, effect(name)), scores.price([name]) + config.SURE, scores.dataset.seed
        )
    ]


def _of(screening: Screening, info: EffectInfo, needed: float, seed: int) -> Iterator[Power]:
    parameters, name = info.required, info.name
    sizes, alone = {one.name for one in sizes_of(name)}, size_of(name) is None
    for index, one in enumerate(parameters):
        if one.name not in sizes or not math.isfinite(one.neutral):
            continue
        values, ladder = _ladder(parameters, index, alone=alone, seed=seed)
        typical = np.median(screening.shown(name, values).reshape(SIZES, -1), axis=1)
        seen = typical - _SURE * np.sqrt(2.0 * typical) >= needed
        # The smallest size from which on all larger ones are detected too.
        hidden = np.flatnonzero(~seen)
        first = 0 if len(hidden) == 0 else int(hidden[-1]) + 1
        least = float(abs(ladder[first] - one.neutral)) if first < SIZES else None
        yield Power(name, one.name, one.unit, least, float(abs(ladder[-1] - one.neutral)))


def _ladder(
    parameters: tuple[EffectParameter, ...], index: int, *, alone: bool, seed: int
) -> tuple[Array, Array]:
    """Return values (SIZES * OTHERS, p) with a ladder of sizes of one parameter, and the ladder.

    The other parameters are neutral if `alone`, else drawn.
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
