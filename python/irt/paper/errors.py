"""Parameter errors of proposals, also in the combinations that a path identifies, and their statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.rig import PARAMETERS
from irt.tuning.drive import Drive

Array = NDArray[np.float64]

#: Normal quantile of a two-sided 95 % interval.
NORMAL_95 = 1.96
#: Share of the distance to the rim from which a marble counts as at the rim.
AT_RIM = 0.995
_TIME, _SCALE = PARAMETERS.index("time_scale"), PARAMETERS.index("observation_scale")


def parameter_error(drive: Drive, parameters: Array, truth: Array) -> Array:
    """Return the mean absolute errors (...) of (..., 5) parameters in shares of their ranges (Fig. 4)."""
    error: Array = np.abs(drive.scaled(parameters) - drive.scaled(truth)).mean(axis=-1)
    return error


def combinations(parameters: Array) -> Array:
    """Return the identifiable combinations (..., 4): time_scale^2 times gears and friction, and scale."""
    steps = np.rint(parameters[..., _TIME, None])
    return np.concatenate([steps**2 * parameters[..., :3], parameters[..., [_SCALE]]], axis=-1)


def combination_error(drive: Drive, parameters: Array, truth: Array) -> Array:
    """Return the mean absolute error (...) of the four combinations in shares of their ranges."""
    low, high = (combinations(np.array([drive.ranges[name][k] for name in PARAMETERS])) for k in (0, 1))
    error: Array = (np.abs(combinations(parameters) - combinations(truth)) / (high - low)).mean(axis=-1)
    return error


def share_of_the_way(drive: Drive, observed: Array) -> Array:
    """Return the largest distance of k marbles, 1 at the rim at scale 1, from noiseless (k, n, 2)."""
    share: Array = (np.abs(observed).max(axis=1) / drive.room).max(axis=1)
    return share


def meets_rim(drive: Drive, parameters: Array, observed: Array) -> NDArray[np.bool_]:
    """Return which of k marbles of (k, 5) parameters met the rim, which identifies the observation scale."""
    return np.asarray(share_of_the_way(drive, observed) > AT_RIM * parameters[:, _SCALE])


@dataclass(frozen=True)
class Summary:
    """Errors over many trials, in the unit of the errors.

    Attributes
    ----------
    mean, low, high : float
        Mean and its 95 % interval.
    median, p05, p95 : float
        Median, 5th and 95th percentile.
    worst : float
        Maximum.
    """

    mean: float
    low: float
    high: float
    median: float
    p05: float
    p95: float
    worst: float

    @classmethod
    def of(cls, errors: Array) -> Summary:
        """Summarise errors (n,); the interval of the mean is that of a normal distribution."""
        mean = float(errors.mean())
        half = NORMAL_95 * float(errors.std(ddof=1)) / np.sqrt(len(errors)) if len(errors) > 1 else np.inf
        p05, median, p95 = (float(value) for value in np.percentile(errors, [5, 50, 95]))
        return cls(mean, mean - half, mean + half, median, p05, p95, float(errors.max()))


def median_interval(values: Array) -> tuple[float, float]:
    """Return the 95 % interval of the median of (n,) values by order statistics."""
    ordered = np.sort(values)
    half = 0.5 * NORMAL_95 * np.sqrt(len(ordered))
    low = int(max(0, np.floor(0.5 * len(ordered) - half)))
    high = int(min(len(ordered) - 1, np.ceil(0.5 * len(ordered) + half)))
    return float(ordered[low]), float(ordered[high])
