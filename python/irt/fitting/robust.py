"""Robust statistics, as in the engine's fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import deviation

__all__ = ["OF_NORMAL", "TAIL", "deviation", "mean_absolute", "student_t"]

Array = NDArray[np.float64]

#: Degrees of freedom of Student's t.
TAIL = 4.0


def mean_absolute(noise: float) -> float:
    """Return the mean absolute value of Gaussian noise of this standard deviation."""
    return float(noise * np.sqrt(2.0 / np.pi))


def student_t(values: Array) -> Array:
    """Return the negative log-likelihood of each value, in units of its scale, up to a constant."""
    return np.asarray(0.5 * (TAIL + 1.0) * np.log1p(values**2 / TAIL))


def _of_normal() -> float:
    values = np.linspace(-8.0, 8.0, 4001)
    density = np.exp(-0.5 * values**2) / np.sqrt(2.0 * np.pi)
    return float(np.trapezoid(student_t(values) * density, values))


#: Mean loss of a normal variable at its own scale.
OF_NORMAL = _of_normal()
