"""Path and path length of a marble from observed positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import noise_of

Array = NDArray[np.float64]

#: Weights of a local parabola over five points (Savitzky and Golay, 1964).
_PARABOLA = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
#: Smallest deviation of an outlier from its neighbours, in standard deviations of a position.
_WILD = 6.0
#: Smallest displacement that counts as rolling, in standard deviations of a position.
_MOVED = 4.0


def rolled(marble: Array) -> tuple[Array, Array]:
    """Return path (n, 2) and path length (n,) of a marble [board edges] from observed positions (n, 2).

    The path is smoothed, free of outliers, and straight where the tracker lost the marble. Noise would
    lengthen the path, even of a marble at rest. Therefore the length only grows once the marble is farther
    from the last counted position than noise explains.
    """
    seen = bridged(marble)
    # The noise of a path of few rows is unknown.
    noise = float(np.nan_to_num(noise_of(*seen.T)))
    path = _smoothed(_without_outliers(seen, noise))
    length = np.zeros(len(path))
    done, last = 0.0, path[0]
    for row, place in enumerate(path):
        step = float(np.hypot(*(place - last)))
        if step > _MOVED * noise:
            done, last = done + step, place
        length[row] = done
    return path, length


def bridged(marble: Array) -> Array:
    """Return (n, 2) positions, interpolated linearly where the marble was lost; zeros if there are none."""
    seen = np.flatnonzero(np.isfinite(marble).all(axis=1))
    if len(seen) == 0:
        return np.zeros(marble.shape)
    rows = np.arange(len(marble))
    return np.stack([np.interp(rows, seen, marble[seen, axis]) for axis in (0, 1)], axis=1)


def _without_outliers(path: Array, noise: float) -> Array:
    """Return a path with outliers replaced by the mean of their neighbours."""
    cleaned = path.copy()
    middle = 0.5 * (path[:-2] + path[2:])
    wild = np.linalg.norm(path[1:-1] - middle, axis=1) > _WILD * noise + np.linalg.norm(
        path[2:] - path[:-2], axis=1
    )
    cleaned[1:-1][wild] = middle[wild]
    return cleaned


def _smoothed(path: Array) -> Array:
    """Return a path smoothed by a local parabola; its ends are unchanged."""
    if len(path) < len(_PARABOLA):
        return path
    smooth = path.copy()
    for axis in (0, 1):
        smooth[2:-2, axis] = np.convolve(path[:, axis], _PARABOLA, "valid")
    return smooth
