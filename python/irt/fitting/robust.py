"""Scales and weights that a few wild rows cannot move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from irt.residual import Segment

Array = NDArray[np.float64]

#: Standard deviation of a normal variable over its median absolute deviation.
MAD_TO_SD = 1.4826
#: No camera sees better than this [board edges]; keeps scales positive on simulated data without noise.
FINEST = 1e-6
#: Degrees of freedom of the Student-t likelihood: rows beyond about three scales lose their say.
TAIL = 4.0


def loss(residual: Array, scale: Array) -> Array:
    """Return the Student-t negative log-likelihood up to a constant: quadratic near zero, log far out."""
    return 0.5 * (TAIL + 1) * np.log1p((residual / scale) ** 2 / TAIL)


def weight(residual: Array, scale: Array) -> Array:
    """Return the weights in the normal equations: the derivative of `loss` over the residual."""
    return (TAIL + 1) / (TAIL * scale**2 + residual**2)


def influence(residual: Array, scale: float) -> tuple[Array, Array]:
    """Return psi, how much residuals pull, and its slope; near zero both are those of least squares."""
    ratio = (residual / scale) ** 2 / TAIL
    return residual / (1.0 + ratio), (1.0 - ratio) / (1.0 + ratio) ** 2


def scale(residual: Array, known: NDArray[np.bool_]) -> Array:
    """Return the robust standard deviation (k,) of residuals (k, ...), where known."""
    flat = np.abs(residual.reshape(len(residual), -1)[:, known.ravel()])
    return np.maximum(MAD_TO_SD * np.median(flat, axis=1), FINEST)


def tracker_noise(segments: Sequence[Segment]) -> float:
    """Estimate the standard deviation of the tracker [board edges] from the recordings alone.

    The motion is smooth from row to row, so that of fourth differences mostly noise is left: its standard
    deviation is sqrt(70) times the tracker's.
    """
    fourth = [np.diff(segment.observed, n=4, axis=0) for segment in segments if len(segment.observed) > 4]
    values = np.concatenate([difference[np.isfinite(difference)] for difference in fourth] or [np.zeros(0)])
    return (
        max(MAD_TO_SD * float(np.median(np.abs(values))) / np.sqrt(70.0), FINEST) if len(values) else FINEST
    )
