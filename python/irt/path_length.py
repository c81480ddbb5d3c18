"""Where and how far a marble has rolled, from where a camera saw it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import noise_of

Array = NDArray[np.float64]

#: A local parabola's value in the middle of five points (Savitzky and Golay, 1964).
_PARABOLA = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
#: Standard deviations that a position has to lie off its neighbours to be none of the marble's.
_WILD = 6.0
#: What a marble must have moved to have rolled on, in standard deviations of a position.
_MOVED = 4.0


def rolled(marble: Array) -> tuple[Array, Array]:
    """Return where and how far a marble has rolled, (n, 2) and (n,) [board edges], from (n, 2) positions.

    The path is smoothed, without slips, and straight where the tracker lost the marble. Noise makes every
    path longer, and without end where the marble rests. So a place counts once it lies farther from the last
    that counted than noise takes it.
    """
    seen = bridged(marble)
    # A path of a few rows shows no noise.
    noise = float(np.nan_to_num(noise_of(*seen.T)))
    path = _smoothed(_tamed(seen, noise))
    way = np.zeros(len(path))
    done, last = 0.0, path[0]
    for row, place in enumerate(path):
        step = float(np.hypot(*(place - last)))
        if step > _MOVED * noise:
            done, last = done + step, place
        way[row] = done
    return path, way


def bridged(marble: Array) -> Array:
    """Return (n, 2) positions, straight where the tracker lost the marble; zeros if it never saw it."""
    seen = np.flatnonzero(np.isfinite(marble).all(axis=1))
    if len(seen) == 0:
        return np.zeros(marble.shape)
    rows = np.arange(len(marble))
    return np.stack([np.interp(rows, seen, marble[seen, axis]) for axis in (0, 1)], axis=1)


def _tamed(path: Array, noise: float) -> Array:
    """Return a path with positions far off both neighbours put between these."""
    tamed = path.copy()
    middle = 0.5 * (path[:-2] + path[2:])
    wild = np.linalg.norm(path[1:-1] - middle, axis=1) > _WILD * noise + np.linalg.norm(
        path[2:] - path[:-2], axis=1
    )
    tamed[1:-1][wild] = middle[wild]
    return tamed


def _smoothed(path: Array) -> Array:
    """Return a path under a local parabola; its ends are left as they are."""
    if len(path) < len(_PARABOLA):
        return path
    smooth = path.copy()
    for axis in (0, 1):
        smooth[2:-2, axis] = np.convolve(path[:, axis], _PARABOLA, "valid")
    return smooth
