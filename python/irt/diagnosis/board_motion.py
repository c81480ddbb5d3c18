"""How far modes and lags of a board are from the angles that its knobs command, and what a drive keeps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.basis import shaped

Array = NDArray[np.float64]


def of_modes(tilts: Array, before: Array, rates: Array, dampings: Array, row_s: float) -> Array:
    """Return the deviations (n, k, 2) of k modes from (n, 2) angles, in the middles of the rows.

    The modes start at rest at the angles `before`; each angle holds for a row.
    """
    found = np.zeros((len(tilts), len(rates), 2))
    state = np.zeros((len(rates), 2, 2))
    state[:, 0] = before
    step, middle = _step(rates, dampings, row_s), _step(rates, dampings, 0.5 * row_s)
    for row, tilt in enumerate(tilts):
        state[:, 0] -= tilt
        found[row] = (middle @ state)[:, 0]
        state = step @ state
        state[:, 0] += tilt
    return found


def of_lags(tilts: Array, before: Array, lags: Array, row_s: float) -> Array:
    """Return the deviations (n, k, 2) of k first-order lags from (n, 2) angles, in the middles of the rows.

    The lags start at rest at the angles `before`; each angle holds for a row.
    """
    found = np.zeros((len(tilts), len(lags), 2))
    angles = np.tile(before, (len(lags), 1))
    left = np.exp(-row_s / lags)[:, None]
    for row, tilt in enumerate(tilts):
        found[row] = np.sqrt(left) * (angles - tilt)
        angles = tilt + left * (angles - tilt)
    return found


def kept(share: Array | float, slowness: Array | float, rates: Array) -> Array:
    """Return the share of its angle that a drive keeps at these rates, as in the engine."""
    return np.asarray(1.0 - share * (1.0 - shaped("bell", slowness * rates)))


def _step(rates: Array, dampings: Array, seconds: float) -> Array:
    """Return the transition matrices (k, 2, 2) of free oscillations over a time [s]."""
    ringing, fade = rates * np.sqrt(1.0 - dampings**2), rates * dampings
    cos, sin = np.cos(ringing * seconds), np.sin(ringing * seconds) / ringing
    matrix = np.array([[cos + fade * sin, sin], [-sin * rates**2, cos - fade * sin]])
    return np.asarray(np.exp(-fade * seconds)[:, None, None] * matrix.transpose(2, 0, 1))
