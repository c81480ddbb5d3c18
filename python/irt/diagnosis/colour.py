"""How residuals remember the rows before: noise shortly, what a model lacks for long."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
from numpy.typing import NDArray

from irt.fitting.robust import deviation

Array = NDArray[np.float64]

#: Rows after which nothing is remembered that could be told from chance.
LAGS = 20
#: Residuals count no farther out than this [scales].
_OUTERMOST = 3.0
#: What a sample of noise carries on of the one before, at most: beyond it a drift is not told from noise.
MOST_CARRIED = 0.7
#: Differences of this order measure the tracker's noise (`irt.fitting.problem.tracker_noise`).
_ORDER = 4


def memory(residuals: Sequence[Array], scale: float) -> float:
    """Return how many rows it takes until residuals forget: their integrated autocorrelation time, 1 or more.

    White noise has 1. So many rows of what a wrong model leaves over say as much as one row of noise would.
    """
    products = _products(residuals, scale, LAGS)
    if products[0] <= 0.0:
        return 1.0
    return max(1.0, float((1.0 + 2.0 * np.cumsum(products[1:]) / products[0]).max()))


def carried(residuals: Sequence[Array], scale: float) -> float:
    """Return which share of each residual carries on into the next row: 0 of white noise."""
    products = _products(residuals, scale, 1)
    return float(np.clip(products[1] / products[0], 0.0, MOST_CARRIED)) if products[0] > 0.0 else 0.0


def fresh(residuals: Sequence[Array], share: float) -> tuple[list[Array], float]:
    """Return what is new in each row, a share of the row before taken off, and its standard deviation."""
    new = [residual[1:] - share * residual[:-1] for residual in residuals]
    return new, deviation(np.concatenate([one.ravel() for one in new]))


def seeming(share: float) -> float:
    """Return how much larger noise is than its differences from row to row make it seem.

    Of noise that carries on a share of the row before; 1 for white noise.
    """
    signs = np.array([(-1.0) ** k * comb(_ORDER, k) for k in range(_ORDER + 1)])
    apart = np.abs(np.subtract.outer(np.arange(_ORDER + 1), np.arange(_ORDER + 1)))
    return float(np.linalg.norm(signs) / np.sqrt(signs @ share**apart @ signs))


def _products(residuals: Sequence[Array], scale: float, lags: int) -> Array:
    """Return the sums of products of residuals so many rows apart, (lags + 1,); lost rows count as zero."""
    products = np.zeros(lags + 1)
    for residual in residuals if scale > 0.0 else ():
        kept = np.nan_to_num(np.clip(residual / scale, -_OUTERMOST, _OUTERMOST))
        for lag in range(min(lags + 1, len(kept))):
            products[lag] += float((kept[lag:] * kept[: len(kept) - lag]).sum())
    return products
