"""Baseline: the single effect with the smallest training error, without held-out runs or calibration.

Each effect is fitted together with the five parameters by irt's own least squares, from the base fit and
several sizes of the effect on both sides. The effect with the smallest training error is always named, even
for a negligible gain.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectParameter, effect, hypothetical
from irt.diagnosis.dataset import Dataset, Fitted
from irt.proof.baselines.entry import Entry, Task, predicted

Array = NDArray[np.float64]

TITLE = "best single effect by training error"
#: Start sizes of an effect, as shares of the distance to the ends of its ranges.
SIZES = (0.02, 0.15, 0.5)


def enter(task: Task) -> Entry:
    """Fit every effect of the catalogue, and name the one with the smallest training error."""
    dataset = Dataset.of(task.rig, threads=1)
    base = dataset.fit()
    fits = [dataset.fit((one.name,), points=starts(one.name, base), rounds=1) for one in hypothetical()]
    best = min(fits, key=training_error)
    return Entry(detected=True, named=best.effects, predictions=predicted(best.model, task.tests))


def starts(name: str, base: Fitted) -> Array:
    """Return the start points of an effect's fit, (k, 5 + p): the base fit, and sizes of the effect."""
    parameters = effect(name).required
    shares = [sign * size for size in SIZES for sign in (1.0, -1.0)]
    sized = (itertools.product(*(_values(one, share) for one in parameters)) for share in shares)
    sizes = np.unique(list(itertools.chain(*sized)), axis=0)
    return np.concatenate([np.tile(base.values, (len(sizes), 1)), sizes], axis=1)


def training_error(fitted: Fitted) -> float:
    """Return the mean absolute residual [board edges] of a fit."""
    return float(np.nanmean(np.abs(np.concatenate([one.ravel() for one in fitted.residuals]))))


def _values(one: EffectParameter, share: float) -> Sequence[float]:
    """Return the start values of a parameter for a size of the effect; a choice has all its values."""
    return one.choices if one.is_choice else (_part(one, share),)


def _part(one: EffectParameter, share: float) -> float:
    """Return a value at a share of the distance from neutral to an end; negative towards the other end."""
    if not one.low <= one.neutral <= one.high:
        return 0.5 * (one.low + one.high) + 0.5 * share * (one.high - one.low)
    if one.neutral in (one.low, one.high):
        end = one.high if one.neutral == one.low else one.low
        return one.neutral + abs(share) * (end - one.neutral)
    return one.neutral + abs(share) * ((one.high if share > 0.0 else one.low) - one.neutral)
