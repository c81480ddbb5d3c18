"""Detect rows of a recording that are not measurements: held positions, tilt jumps, invalid first rows.

A tracker that loses the marble often repeats its last position, and one that loses a marker reports a tilt
that is wrong by 0.1 to 0.2 rad for some rows. Both look like data. `irt import` turns them into gaps, and
`irt check` reports them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Coefficients of fourth differences, which contain only the noise of a smooth signal.
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
#: Standard deviation of a normal variable over its median absolute value.
_OF_MEDIAN = 1.4826
#: Smallest noise of measured positions [board edges]: 3 um on a board of 0.3 m. Less noise means simulation
#: or filtering.
_NOISELESS = 1e-5
#: Largest probability of an exact repeat at rest at which repeats prove a lost marble; at most 1 % of the
#: rows at rest are then lost by mistake.
_CHANCE = 1e-2
#: Rows before and after a repeat from which the marble's motion is estimated.
_AROUND = 4
#: Largest displacement in one row of a marble that starts from rest [board edges]; at 1 m/s^2 and 30 Hz it is
#: 0.002.
_START_STEP = 0.008
#: Smallest tilt rate [rad/s] and size [rad] of a jump by a hidden marker; no labyrinth tilts as fast.
_JUMP_RATE = 3.0
_JUMP_SIZE = 0.05
#: Longest time that a marker is hidden [s]; a longer change may be a new level.
_JUMP_TIME = 1.5


def deviation(values: Array) -> float:
    """Return the robust standard deviation of values around zero, by their median; NaN is ignored."""
    return _OF_MEDIAN * float(np.nanmedian(np.abs(values)))


def noise_of(*signals: Array) -> float:
    """Return the standard deviation of white noise on smooth (n,) signals; NaN if too few rows are known.

    The estimate is the median of fourth differences of consecutive known rows, which is robust against
    curvature of the signals and outliers.
    """
    longest = [np.asarray(values, dtype=np.float64) for values in signals if len(values) >= len(_FOURTH)]
    rough = np.concatenate([np.zeros(0), *(np.convolve(values, _FOURTH, "valid") for values in longest)])
    rough = rough[np.isfinite(rough)]
    if rough.size < 5:
        return float("nan")
    return deviation(rough) / float(np.sqrt((_FOURTH**2).sum()))


def repeated_rows(values: Array) -> Mask:
    """Return which rows of (n, k) values repeat the row before exactly, (n,); rows with NaN never do."""
    mask = np.zeros(len(values), dtype=bool)
    mask[1:] = (values[1:] == values[:-1]).all(axis=1)
    return mask


def repeats_are_certain(marble: Array) -> bool:
    """Return whether an exact repeat of a position proves that the marble was lost.

    It does if the camera's noise is many times the resolution of the numbers, because two measurements then
    hardly ever agree in all digits. In simulated, filtered or coarsely rounded positions a marble at rest
    repeats its position too, so the motion before and after must decide.
    """
    moving = marble[~repeated_rows(marble) & np.isfinite(marble).all(axis=1)]
    if len(moving) < 20:
        return False
    chance = 1.0
    for values in moving.T:
        noise = noise_of(values)
        if not noise > _NOISELESS:
            return False
        # The probability that two positions agree is the density of their difference at 0 times the
        # resolution.
        chance *= min(1.0, _resolution(values) / (2.0 * np.sqrt(np.pi) * noise))
    return chance < _CHANCE


def held_rows(marble: Array) -> Mask:
    """Return which rows repeat the last position of a lost marble, (n,).

    Parameters
    ----------
    marble : (n, 2) array
        Logged positions [board edges], NaN where lost.

    Notes
    -----
    The first row of a position is a measurement; the rows that repeat it exactly are not. If repeats are not
    a proof (see `repeats_are_certain`), rows count as held only if the marble was moving before them or is
    displaced right after them: a marble at rest slows down first, and starts slowly.
    """
    repeats = repeated_rows(marble)
    if not repeats.any() or repeats_are_certain(marble):
        return repeats
    held = np.zeros_like(repeats)
    resolution = max((_resolution(values[np.isfinite(values)]) for values in marble.T), default=0.0)
    for first, last in mask_spans(repeats):
        place = marble[first]
        before = marble[max(0, first - 1 - _AROUND) : first]
        steps = np.linalg.norm(np.diff(before, axis=0), axis=1)
        # The smallest of the last steps: a marble that comes to rest makes small steps.
        arrived = float(np.nanmin(steps)) if np.isfinite(steps).any() else 0.0
        after = marble[last] if last < len(marble) else place
        left = float(np.linalg.norm(after - place)) if np.isfinite(after).all() else 0.0
        rows = last - first
        if arrived > 3.0 * resolution + _NOISELESS * 100.0 / rows or left > _START_STEP + 3.0 * resolution:
            held[first:last] = True
    return held


def tilt_jumps(tilt: Array, stamps: Array | None = None, *, rate: float = _JUMP_RATE) -> Mask:
    """Return which tilts are wrong because a marker was hidden, (n, 2), by axis.

    Parameters
    ----------
    tilt : (n, 2) array
        Measured tilt [rad], NaN where it was not measured.
    stamps : (n,) array, optional
        Time of each row [s]; by default rows are 1/60 s apart.
    rate : float
        A change faster than this [rad/s] and larger than 0.05 rad is a jump. Servos move labyrinths at up to
        1 rad/s.

    Notes
    -----
    An excursion starts with a jump and ends with one back, within 1.5 s. If the log starts or ends inside an
    excursion, the shorter side of the jump counts as wrong.
    """
    times = np.arange(len(tilt)) / 60.0 if stamps is None else np.asarray(stamps, dtype=np.float64)
    jumps = np.zeros(tilt.shape, dtype=bool)
    for axis, values in enumerate(np.asarray(tilt, dtype=np.float64).T):
        known = np.flatnonzero(np.isfinite(values))
        if known.size >= 3:
            jumps[known, axis] = _excursions(values[known], times[known], rate)
    return jumps


def garbage_rows(marble: Array, tilt: Array | None, *, most: int = 30) -> int:
    """Return the number of rows at the start that were logged before the tracker worked.

    In these rows the marble is lost or exactly at the origin, or the tilt is exactly zero about both axes, as
    published by a node before its first picture. More than ``most`` such rows count as data.
    """
    lost = ~np.isfinite(marble).all(axis=1) | (marble == 0.0).all(axis=1)
    if tilt is not None:
        lost |= (tilt == 0.0).all(axis=1)
    good = np.flatnonzero(~lost)
    return int(good[0]) if good.size and good[0] <= most else 0


def mask_spans(mask: Mask) -> list[tuple[int, int]]:
    """Return (first, end) of each sequence of True, the end exclusive."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _resolution(values: Array) -> float:
    """Return the resolution of rounded values: the smallest nonzero difference."""
    steps = np.diff(np.unique(values))
    # The last digits of a float are arithmetic, not rounding.
    steps = steps[steps > 1e-12]
    return float(steps.min()) if steps.size else 0.0


def _excursions(values: Array, times: Array, rate: float) -> Mask:
    steps = np.diff(values)
    fast = np.flatnonzero((np.abs(steps) > _JUMP_SIZE) & (np.abs(steps) > rate * np.diff(times)))
    wrong = np.zeros(len(values), dtype=bool)
    done = 0
    for number, step in enumerate(fast.tolist()):
        if step < done:
            continue
        back = next((one for one in fast[number + 1 :].tolist() if _returns(values, times, step, one)), None)
        if back is not None:
            wrong[step + 1 : back + 1] = True
            done = back + 1
        elif (
            times[step] - times[0] < min(_JUMP_TIME, times[-1] - times[step]) and not wrong[: step + 1].any()
        ):
            wrong[: step + 1] = True
        elif times[-1] - times[step] < _JUMP_TIME:
            wrong[step + 1 :] = True
            break
    return wrong


def _returns(values: Array, times: Array, step: int, back: int) -> bool:
    """Return whether the jump after row ``back`` ends the excursion that starts after row ``step``."""
    out, home = values[step + 1] - values[step], values[back + 1] - values[back]
    soon = times[back + 1] - times[step] <= _JUMP_TIME
    # Both jumps have a similar size, or the tilt returns to its value: the board may move while its marker is
    # hidden, and a wrong tilt may drift.
    alike = abs(out + home) <= 0.5 * abs(out) or abs(values[back + 1] - values[step]) <= 0.5 * abs(out)
    return bool(soon and np.sign(out) == -np.sign(home) != 0.0 and alike)
