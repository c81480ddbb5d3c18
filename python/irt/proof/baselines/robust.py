"""A robust loss for paths: trackers have outliers, and paths diverge after impacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Least size of errors beyond which the loss is linear [board edges]; trackers are hardly better.
LEAST_EDGES = 1e-3


def robust_size(errors: Array) -> float:
    """Return a robust standard deviation of errors, NaN left out: 1.4826 times the median size."""
    known = errors[np.isfinite(errors)]
    return max(1.4826 * float(np.median(np.abs(known))), LEAST_EDGES) if known.size else LEAST_EDGES


def loss(errors: Array) -> Array:
    """Return the pseudo-Huber loss: the square of small errors, twice the size of those above 1."""
    return np.asarray(2.0 * (np.hypot(1.0, errors) - 1.0))


def slope(errors: Array) -> Array:
    """Return the derivative of `loss`."""
    return np.asarray(2.0 * errors / np.hypot(1.0, errors))
