"""States from noisy positions by local polynomials, as is common before regression methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.path_length import bridged
from irt.proof.baselines.entry import Task
from irt.recording import Recording

Array = NDArray[np.float64]

#: Rows of a local polynomial, and its degree.
WINDOW, DEGREE = 9, 3


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A recording of n rows, smoothed.

    Attributes
    ----------
    knobs : (n, 2) array
        Commands [rad].
    states : (n, 4) array
        Positions [edges] and velocities [edges/s].
    acceleration : (n, 2) array
        [edges/s^2].
    row_s : float
        Duration of a row [s].
    """

    knobs: Array
    states: Array
    acceleration: Array
    row_s: float


def smoothed(task: Task) -> list[Smoothed]:
    """Return the recordings of a rig, smoothed (Savitzky and Golay); too short ones are left out."""
    return [smooth(one, task.row_s(one)) for one in task.rig.recordings if len(one.knobs) >= WINDOW]


def smooth(recording: Recording, row_s: float) -> Smoothed:
    """Return a recording of at least `WINDOW` rows, smoothed."""
    from scipy.signal import savgol_filter  # noqa: PLC0415

    marble = bridged(recording.marble)
    place, velocity, acceleration = (
        savgol_filter(marble, WINDOW, DEGREE, deriv=order, delta=row_s, axis=0) for order in range(3)
    )
    return Smoothed(recording.knobs, np.concatenate([place, velocity], axis=1), acceleration, row_s)
