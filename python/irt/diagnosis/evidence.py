"""How hypotheses compare: likelihood against the width of the search, in nats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irt.catalogue import hypothetical
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.colour import carried, fresh, memory, seeming
from irt.diagnosis.screen import Screen
from irt.fitting.robust import OF_NORMAL, deviation

#: An effect must explain this share of what noise alone would make, or it is too small to be told from the
#: engine's own imperfections.
LEAST_SHARE = 0.01
#: By so many nats an effect must be likelier than it costs. Right ones of three noises and more were worth 90
#: and more in rigs of another engine, and what was named in a rig without any, 3.
SURE = 10.0
#: What may be left over of the base model's mismatch beyond noise, and beyond the likelihood of noise.
LEFT_SHARE, LEFT_NOISE = 0.01, 0.1
#: Residuals without memory, of about the tracker's size, are noise.
FORGETFUL, NOISE_LIKE = 1.5, 1.1
#: No recording has so much more of it than all together, among those with enough coordinates to tell.
UNEVEN, ENOUGH = 1.3, 60
#: Scatter, in units of the tracker's, beyond which a model lacks something, whatever is known of it.
LOST = 2.0
#: Effects are believed if they leave no more than this share of the base model's mismatch.
TRUSTED = 0.1
#: Most of a mismatch is more than this share.
MOST = 0.5
#: In windows of so many rows the typical misfit is below that, and few windows go astray: a marble that stops
#: a moment too late or meets a corner otherwise goes elsewhere from there, and no physics is missing.
WINDOW_ROWS, TYPICAL, ASTRAY, FEW = 60, 1.3, 3.0, 0.25
#: What a value outside the range that the catalogue finds plausible costs [nats].
IMPLAUSIBLE = 10.0


@dataclass(frozen=True)
class Evidence:
    """The yardstick by which the hypotheses of a case are compared.

    Attributes
    ----------
    scale : float
        Standard deviation at which residuals count [board edges]: what the best hypothesis leaves over, but
        no less than the tracker's noise.
    rows : float
        Residuals that count, freed of their memory.
    memory : float
        Autocorrelation time of what the best hypothesis leaves over.
    """

    scale: float
    rows: float
    memory: float

    @classmethod
    def of(cls, case: Case, fits: Sequence[Fitted]) -> Evidence:
        """Return the yardstick for some hypotheses."""
        best = min(fits, key=lambda one: one.loss(case.noise))
        scale = max(case.noise, best.noise)
        forgotten = memory(best.residuals, scale)
        count = sum(int(np.isfinite(residual).sum()) for residual in best.residuals)
        return cls(scale, count / forgotten, forgotten)

    def gain(self, one: Fitted, over: Fitted) -> float:
        """Return by how many nats one hypothesis is likelier than another."""
        return (over.loss(self.scale) - one.loss(self.scale)) / self.memory

    def penalty(self, one: Fitted) -> float:
        """Return what the effects of a hypothesis cost [nats].

        Half a logarithm of the data for each parameter (BIC), that of the catalogue for each choice, and more
        for values outside the catalogue's ranges.
        """
        return self.price(one.free, len(one.effects)) + IMPLAUSIBLE * one.outside

    def price(self, parameters: int, choices: int) -> float:
        """Return what so many parameters, and choices from the catalogue, cost [nats]."""
        data, catalogue = math.log(max(self.rows, math.e)), math.log(len(hypothetical()))
        return 0.5 * parameters * data + choices * catalogue

    def margin(self, one: Fitted, over: Fitted) -> float:
        """Return by how many nats one hypothesis beats another, its additional effects paid for."""
        return self.gain(one, over) - (self.penalty(one) - self.penalty(over))

    def is_better(self, one: Fitted, over: Fitted) -> bool:
        """Whether the additional effects of a hypothesis are worth naming."""
        least = LEAST_SHARE * self.rows * max(1, len(one.effects) - len(over.effects))
        return self.margin(one, over) > SURE and self.gain(one, over) > least

    def needed(self, parameters: int) -> float:
        """Return by how many nats one effect of so many parameters has to be likelier, to be named."""
        return max(self.price(parameters, 1) + SURE, LEAST_SHARE * self.rows)


def is_explained(case: Case, one: Fitted, base: Fitted) -> bool:
    """Whether what is left over is about noise, or next to nothing of the base model's mismatch."""
    if is_noise(case, one):
        return True
    if excess(case, one) < max(LEFT_SHARE * excess(case, base), LEFT_NOISE * _noise_loss(one)):
        return True
    misfits = Screen(case, one, WINDOW_ROWS).misfits()
    return bool(np.median(misfits) < TYPICAL and (misfits > ASTRAY).mean() < FEW)


def is_noise(case: Case, one: Fitted) -> bool:
    """Whether what is left over forgets as noise does, and is no larger than the tracker's.

    A tracker that smooths its picture remembers the row before, and only that: freed of it, its noise has no
    memory. What a model lacks carries on for many rows. Such noise also changes less from row to row, so that
    the recordings alone let the tracker seem better than it is.
    """
    share = carried(one.residuals, one.noise)
    new, size = fresh(one.residuals, share)
    if one.noise > NOISE_LIKE * seeming(share) * case.noise:
        return False
    if size == 0.0:
        return True
    if memory(new, size) > FORGETFUL:
        return False
    # What shows in a few recordings alone is little among all rows.
    folds = [np.concatenate([new[i] for i in np.flatnonzero(case.folds == fold)]) for fold in set(case.folds)]
    sizes = [deviation(fold) / size for fold in folds if np.isfinite(fold).sum() >= ENOUGH]
    return max(sizes, default=1.0) < UNEVEN


def is_trusted(case: Case, one: Fitted, base: Fitted) -> bool:
    """Whether a hypothesis leaves little of the base model's mismatch, whatever its windows look like."""
    return is_noise(case, one) or (
        excess(case, one) <= max(TRUSTED * excess(case, base), LEFT_NOISE * _noise_loss(one))
    )


def is_most_left(case: Case, one: Fitted, base: Fitted) -> bool:
    """Whether a hypothesis leaves most of the base model's mismatch."""
    return excess(case, one) > MOST * excess(case, base)


def is_lost(case: Case, one: Fitted, base: Fitted) -> bool:
    """Whether a hypothesis that does not explain the recordings misses what matters, not some small rest.

    How small is told by what it leaves of the base model's scatter: logarithms of likelihoods count a last
    twentieth, which impacts leave, for a fifth.
    """
    return one.noise > max(LOST * case.noise, TRUSTED * base.noise)


def excess(case: Case, one: Fitted) -> float:
    """Return the loss beyond that of noise."""
    return one.loss(case.noise) - _noise_loss(one)


def _noise_loss(one: Fitted) -> float:
    return OF_NORMAL * sum(int(np.isfinite(residual).sum()) for residual in one.residuals)
