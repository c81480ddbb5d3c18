"""Rows of a recording that are no measurement: held places, jumps of the tilt, garbage at the start.

A tracker that loses the marble often repeats its last place, and one that loses a marker reports a tilt that
is wrong by 0.1 to 0.2 rad for some rows. Both look like data. `irt import` turns them into gaps and
`irt check` reports them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Fourth differences of a smooth signal are noise, this many times its standard deviation.
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
#: Standard deviation of a normal variable over its median absolute value.
_OF_MEDIAN = 1.4826
#: Noise below which places are simulated or filtered [board edges]: 3 um on a board of 0.3 m.
_NOISELESS = 1e-5
#: Chance of an exact repeat at rest above which repeats are no proof of a lost marble. Below, at most one
#: resting row in a hundred is given up.
_CHANCE = 1e-2
#: Rows before and after a repeat by which the marble's motion around it is judged.
_AROUND = 4
#: A marble that leaves its place by more than this [board edges] in one row did not start from rest there:
#: at 1 m/s^2 and 30 Hz it moves by 0.002 of an edge.
_START_STEP = 0.008
#: A tilt rate that no labyrinth reaches [rad/s], and the least jump [rad] that a hidden marker makes.
_JUMP_RATE = 3.0
_JUMP_SIZE = 0.05
#: Longest time that a marker is hidden [s]; a level that changes for longer may be a new level.
_JUMP_TIME = 1.5


def deviation(values: Array) -> float:
    """Return the standard deviation of values around zero by their median; NaN counts for nothing."""
    return _OF_MEDIAN * float(np.nanmedian(np.abs(values)))


def noise_of(*signals: Array) -> float:
    """Return the standard deviation of white noise on smooth (n,) signals; NaN if too few rows are known.

    Estimated from fourth differences of rows that are known in succession, by their median: curvature of the
    signals and a few wild values do not count.
    """
    longest = [np.asarray(values, dtype=np.float64) for values in signals if len(values) >= len(_FOURTH)]
    rough = np.concatenate([np.zeros(0), *(np.convolve(values, _FOURTH, "valid") for values in longest)])
    rough = rough[np.isfinite(rough)]
    if rough.size < 5:
        return float("nan")
    return deviation(rough) / float(np.sqrt((_FOURTH**2).sum()))


def repeated_rows(values: Array) -> Mask:
    """Return which rows of (n, k) repeat the row before exactly, (n,); rows with NaN never do."""
    mask = np.zeros(len(values), dtype=bool)
    mask[1:] = (values[1:] == values[:-1]).all(axis=1)
    return mask


def repeats_are_certain(marble: Array) -> bool:
    """Return whether an exact repeat of a place proves that the marble was lost.

    It does where the camera's noise is many times the resolution of the numbers: two places then agree to
    the last digit only by copying. In simulated, filtered or coarsely rounded places a marble at rest
    repeats its place as well, and only what it did before and after can tell.
    """
    moving = marble[~repeated_rows(marble) & np.isfinite(marble).all(axis=1)]
    if len(moving) < 20:
        return False
    chance = 1.0
    for values in moving.T:
        noise = noise_of(values)
        if not noise > _NOISELESS:
            return False
        # The chance that two places agree is the height of their difference's density times the resolution.
        chance *= min(1.0, _resolution(values) / (2.0 * np.sqrt(np.pi) * noise))
    return chance < _CHANCE


def held_rows(marble: Array) -> Mask:
    """Return which rows hold the last place of a lost marble, (n,).

    Parameters
    ----------
    marble : (n, 2) array
        Places as logged [board edges], NaN where lost.

    Notes
    -----
    The first row of a place is a measurement; the rows that repeat it exactly are not. Where repeats are no
    proof (see `repeats_are_certain`), rows count as held only if the marble was moving before them or is
    elsewhere right after them: a marble at rest slows down first, and starts slowly.
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
        # The last step counts: a marble that slows down to rest arrives with small ones.
        arrived = float(np.nanmin(steps)) if np.isfinite(steps).any() else 0.0
        after = marble[last] if last < len(marble) else place
        left = float(np.linalg.norm(after - place)) if np.isfinite(after).all() else 0.0
        rows = last - first
        if arrived > 3.0 * resolution + _NOISELESS * 100.0 / rows or left > _START_STEP + 3.0 * resolution:
            held[first:last] = True
    return held


def tilt_jumps(tilt: Array, stamps: Array | None = None, *, rate: float = _JUMP_RATE) -> Mask:
    """Return where the tilt is wrong because a marker was hidden, (n, 2), by axis.

    Parameters
    ----------
    tilt : (n, 2) array
        Measured tilt [rad], NaN where it was not measured.
    stamps : (n,) array, optional
        Time of each row [s]; by default rows are 1/60 s apart.
    rate : float
        A change faster than this [rad/s], and larger than 0.05 rad, is no motion of a board. Servos move
        labyrinths at up to 1 rad/s.

    Notes
    -----
    An excursion begins with such a change and ends with one back, within 1.5 s. Where the log begins or ends
    inside an excursion, the shorter side of the change counts as wrong.
    """
    times = np.arange(len(tilt)) / 60.0 if stamps is None else np.asarray(stamps, dtype=np.float64)
    jumps = np.zeros(tilt.shape, dtype=bool)
    for axis, values in enumerate(np.asarray(tilt, dtype=np.float64).T):
        known = np.flatnonzero(np.isfinite(values))
        if known.size >= 3:
            jumps[known, axis] = _excursions(values[known], times[known], rate)
    return jumps


def garbage_rows(marble: Array, tilt: Array | None, *, most: int = 30) -> int:
    """Return how many rows at the start were logged before the tracker worked.

    These are rows in which the marble is lost or exactly at the origin, or the tilt is exactly zero in both
    axes: what a node publishes before its first picture. More than ``most`` rows are no start, but the data.
    """
    lost = ~np.isfinite(marble).all(axis=1) | (marble == 0.0).all(axis=1)
    if tilt is not None:
        lost |= (tilt == 0.0).all(axis=1)
    good = np.flatnonzero(~lost)
    return int(good[0]) if good.size and good[0] <= most else 0


def mask_spans(mask: Mask) -> list[tuple[int, int]]:
    """Return (first, end) of each run of True, the end exclusive."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _resolution(values: Array) -> float:
    """Return the step to which values are rounded: the least difference of two that differ."""
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
    """Return whether the jump after row ``back`` ends what the jump after row ``step`` began."""
    out, home = values[step + 1] - values[step], values[back + 1] - values[back]
    soon = times[back + 1] - times[step] <= _JUMP_TIME
    # Both jumps are of one size, or the tilt is back where it was: the board moves on while its marker is
    # hidden, and a wrong tilt may drift.
    alike = abs(out + home) <= 0.5 * abs(out) or abs(values[back + 1] - values[step]) <= 0.5 * abs(out)
    return bool(soon and out * home < 0.0 and alike)
