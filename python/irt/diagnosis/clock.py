"""What recordings without stamps do not know: how long a row lasts.

All of the motion can run slower under weaker pushes: the path is the same. What seems to tell the time all
the same is how the marble slips after an impact, and how an engine cuts an impact into updates; neither is
known of the board well enough to read a clock by. So along this symmetry nothing counts as known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnosis.case import Case, Fitted
from irt.fitting.information import FLAT, Information
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Powers of the time scale with which the five parameters change along the symmetry.
_POWERS = dict(zip(PARAMETERS, (-2.0, -2.0, -2.0, 1.0, 0.0), strict=True))
#: Half width along the symmetry, in ranges: nothing is known.
_UNKNOWN = 10.0


def without_clock(case: Case, fitted: Fitted, told: Information) -> Information:
    """Return what recordings tell of a hypothesis, the time scale not read off impacts.

    Where stamps or a damping bring in a time, all stays as it is.
    """
    if case.time_scale is not None or case.rig.marble.damping_per_s > 0.0:
        return told
    along = np.array([_power(name, fitted) for name in fitted.names]) * fitted.values / told.widths
    along = np.where(told.free, along, 0.0)
    along /= np.linalg.norm(along)
    known = np.where(np.isfinite(told.half_width), np.minimum(told.half_width, _UNKNOWN), _UNKNOWN)
    spread = (told.directions * known[:, None] ** 2).T @ told.directions + _UNKNOWN**2 * np.outer(
        along, along
    )
    free = np.flatnonzero(told.free)
    variance, vectors = np.linalg.eigh(spread[np.ix_(free, free)])
    directions = np.zeros((len(free), len(told.values)))
    directions[:, free] = vectors.T[::-1]
    half_width = np.sqrt(np.maximum(variance[::-1], 0.0))
    offset = np.where(half_width < FLAT, directions @ (told.offset @ told.directions), 0.0)
    return replace(told, directions=directions, half_width=half_width, offset=offset)


def _power(name: str, fitted: Fitted) -> float:
    """Return the power of the time scale with which a parameter changes along the symmetry."""
    if name in PARAMETERS:
        return _POWERS[name]
    of_effect, parameter = name.split(".")
    if parameter in {"drag_strength", "side_strength"}:
        power = fitted.value_of(of_effect)[parameter.replace("strength", "power")]
        return power - 2.0
    return float(next(one.time_power for one in effect(of_effect).parameters if one.name == parameter))
