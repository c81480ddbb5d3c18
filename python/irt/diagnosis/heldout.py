"""The proof: each recording predicted by a fit to the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.case import Case, Fitted

Array = NDArray[np.float64]

#: Steps of a refit without one recording: it begins where all recordings led.
ITERATIONS = 8
#: A recording whose likelihood changes less than this says nothing [nats]: the marble rests, or is elsewhere.
SILENT = 1.0


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A hypothesis, judged by recordings that its fit has not seen: by none, where there is one alone.

    Attributes
    ----------
    fits : tuple of Fitted
        For each fold, the fit to all others.
    judged : tuple of Fitted
        What that leaves over of the fold; start states alone are estimated.
    """

    fits: tuple[Fitted, ...]
    judged: tuple[Fitted, ...]

    def losses(self, scale: float) -> Array:
        """Return the Student-t negative log-likelihood of each fold, (folds,)."""
        return np.array([one.loss(scale) for one in self.judged])


def hold_out(case: Case, fitted: Fitted) -> HeldOut:
    """Refit a hypothesis without each fold in turn, and judge it by that."""
    fits, judged = [], []
    folds = np.unique(case.folds)
    for fold in folds if len(folds) > 1 else ():
        rest = case.only([other for other in folds if other != fold])
        fit = rest.refine(fitted.effects, fitted.values[None], iterations=ITERATIONS)[0]
        fits.append(fit)
        judged.append(case.only([fold]).judge(fitted.effects, fit.values[None])[0])
    return HeldOut(tuple(fits), tuple(judged))


def is_supported(one: HeldOut, over: HeldOut, scale: float) -> bool:
    """Whether recordings that were not seen agree that one hypothesis is better.

    It must be better on all of them together, on most of those that see a clear difference, and still without
    the one that gains most: an effect that a single recording asks for may be that recording's mishap. Where
    nothing could be held out, nothing speaks against it.
    """
    gains = over.losses(scale) - one.losses(scale)
    if not len(gains):
        return True
    votes = gains[np.abs(gains) > SILENT]
    most = not len(votes) or (votes > 0.0).mean() > 0.5
    return bool(gains.sum() > 0.0 and most and (len(gains) < 3 or gains.sum() > gains.max()))
