"""The symmetry of recordings without stamps: the same paths in slower or faster time.

Without stamps the duration of a row is unknown. With f times the time scale, accelerations over f^2, rates
over f and delays times f, all positions in all rows are the same. Only ranges, substeps and a damping that is
given distinguish them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnosis.dataset import Dataset, Fitted
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Powers of the time scale with which the five parameters change along the symmetry.
_POWERS = dict(zip(PARAMETERS, (-2.0, -2.0, -2.0, 1.0, 0.0), strict=True))
#: The same of the noise sizes, as taken by `Problem.filter`. A tilt is measured beside stamps alone.
_OF_NOISE = np.array([0.0, 0.0, 1.0, -3.0, -2.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, -1.0])
_TIME_SCALE = PARAMETERS.index("time_scale")
#: Factor by which a fit may at most leave a range, as in the engine (`fit/axis.rs`).
REACH = 3.0


def time_is_known(dataset: Dataset) -> bool:
    """Whether stamps or a damping determine the time scale."""
    return dataset.time_scale is not None or dataset.rig.marble.damping_per_s > 0.0


def power(name: str, values: Mapping[str, float]) -> float:
    """Return the power of the time scale with which a parameter changes along the symmetry.

    Parameters
    ----------
    name : str
        One of the five, or ``effect.parameter``.
    values : mapping
        Values of the set by name.
    """
    if name in PARAMETERS:
        return _POWERS[name]
    of_effect, parameter = name.split(".")
    if parameter in {"drag_strength", "side_strength"}:
        return values[f"{of_effect}.{parameter.replace('strength', 'power')}"] - 2.0
    return float(next(one.time_power for one in effect(of_effect).parameters if one.name == parameter))


def powers(names: Sequence[str], fitted: Fitted) -> Array:
    """Return the powers of the time scale with which parameters of a set change along the symmetry, (n,)."""
    return np.array([power(name, fitted.by_name) for name in names])


def at_one_time_scale(names: Sequence[str], values: Array, fitted: Fitted) -> Array:
    """Return (k, n) values, moved along the symmetry to a set's own time scale."""
    if time_is_known(fitted.dataset) or not len(values):
        return values
    ratio = fitted.by_name["time_scale"] / values[:, list(names).index("time_scale")]
    return np.asarray(values * ratio[:, None] ** powers(names, fitted))


def off_bounds(dataset: Dataset, names: Sequence[str], values: Array, noise: Array) -> tuple[Array, Array]:
    """Return starts of fits, of which those at the upper bound of gears or friction are moved off it.

    At a bound a fit cannot move along the symmetry, because each parameter alone would have to get worse
    first. Such a start is moved along it into the ranges; the time scale stays inside its own range.

    Parameters
    ----------
    dataset : Dataset
        The dataset; with a known time scale nothing is moved.
    names : sequence of str
        Names of the n parameters, with the five first.
    values, noise : (k, n) and (k, 14) arrays
        Values, and noise sizes as taken by `Problem.filter`.
    """
    if time_is_known(dataset):
        return values, noise
    ranges = np.abs([dataset.rig.ranges[name] for name in PARAMETERS])
    ends, low = ranges.max(axis=1), ranges.min(axis=1)
    beyond = np.abs(values[:, :_TIME_SCALE]) / np.maximum(ends[:_TIME_SCALE], 1e-300)
    bounds = np.minimum(REACH, ends / np.maximum(low, 1e-300))[:_TIME_SCALE]
    bound = (beyond > 0.999 * bounds).any(axis=1)
    if not bound.any():
        return values, noise
    most = np.maximum(ends[_TIME_SCALE] / np.maximum(values[:, _TIME_SCALE], 1e-300), 1.0)
    needed = np.sqrt(np.maximum(beyond.max(axis=1), 1.0))
    factor = np.where(bound, np.minimum(needed, most), 1.0)[:, None]
    sets = [dict(zip(names, one, strict=True)) for one in values.tolist()]
    changed = np.array([[power(name, one) for name in names] for one in sets])
    return values * factor**changed, noise * factor**_OF_NOISE
