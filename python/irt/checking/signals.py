"""Noise and resolution of each measured column, from its own changes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.checking.result import SignalFacts
from irt.cleaning import deviation, held_rows, mask_spans, repeats_are_certain, tilt_jumps
from irt.recording import MARBLE, TILT, Recording
from irt.rig import Rig

Array = NDArray[np.float64]

#: Orders of the differences. High orders suppress the motion better, low ones need shorter gapless stretches.
_ORDERS = (3, 4, 5, 6)
#: Minimum number of differences for a scale.
_LEAST = 12
#: Tolerance of values on a grid, as a share of its step.
_ON_GRID = 0.02
#: Smallest step as a share of the values; smaller differences are floating-point errors.
_ROUNDING = 1e-9
#: Maximum number of values for the search of a grid.
_MOST_VALUES = 4000


def held_mask(marble: Array) -> NDArray[np.bool_]:
    """Return the rows with the held last position of a lost marble, (n,), except turning points.

    At a few rows per second a marble that reverses between two rows has the same position twice if positions
    are coarse: then the steps before and after have opposite directions. After a held position the marble is
    farther along in its old direction.
    """
    held = held_rows(marble)
    if not held.any() or repeats_are_certain(marble):
        return held
    for first, last in mask_spans(held):
        if last - first == 1 and first >= 2 and last < len(marble):
            before = marble[first - 1] - marble[first - 2]
            after = marble[last] - marble[first]
            held[first] = not float(before @ after) <= 0.0
    return held


def clean(recording: Recording) -> tuple[Array, Array | None]:
    """Return marble and tilt, (n, 2) each, NaN in invalid rows."""
    marble = recording.marble.copy()
    if recording.has_marble:
        marble[held_mask(marble)] = np.nan
    if recording.tilt is None:
        return marble, None
    tilt = recording.tilt.copy()
    tilt[tilt_jumps(tilt, recording.stamps)] = np.nan
    return marble, tilt


def signal_facts(rig: Rig, cleaned: Sequence[tuple[Array, Array | None]]) -> tuple[SignalFacts, ...]:
    """Return noise and resolution of every measured column."""
    found = []
    for axis, column in enumerate(MARBLE):
        values = [marble[:, axis] for marble, _ in cleaned]
        if any(np.isfinite(one).any() for one in values):
            found.append(_facts(column, "edge", values))
    if rig.has_tilt:
        for axis, column in enumerate(TILT):
            found.append(_facts(column, "rad", [tilt[:, axis] for _, tilt in cleaned if tilt is not None]))
    return tuple(found)


def _facts(column: str, unit: str, values: Sequence[Array]) -> SignalFacts:
    step = resolution(values)
    noise = noise_of_runs(values)
    if noise is not None and step is not None:
        # Rounding adds noise, and hides smaller noise.
        noise = max(noise, step / math.sqrt(12.0))
    moves = any(np.nanmax(one) > np.nanmin(one) for one in values if np.isfinite(one).any())
    return SignalFacts(column, unit, noise, step, moves)


def noise_of_runs(values: Iterable[Array]) -> float | None:
    """Return the standard deviation of white noise on a smooth signal, from all its runs.

    Differences of several orders are scaled to the noise of one value, and the order with the smallest result
    is used. The scale is the median absolute one, robust against a few jumps. Differences within constant
    stretches (an idle axis, a marble at rest within one step of rounding) are ignored.

    Parameters
    ----------
    values : iterable of (n,) arrays
        One for each run, NaN without a measurement.

    Returns
    -------
    float or None
        None if nothing moves or there are too few successive values.
    """
    runs = list(values)
    found = []
    for order in _ORDERS:
        weights = np.array([(-1.0) ** k * math.comb(order, k) for k in range(order + 1)])
        rough = []
        for one in runs:
            if len(one) <= order:
                continue
            stretches = np.lib.stride_tricks.sliding_window_view(one, order + 1)
            moves = np.ptp(stretches, axis=1) > 0.0  # NaN compares as not moving
            rough.append(stretches[moves] @ weights)
        all_of_them = np.concatenate(rough) if rough else np.zeros(0)
        if len(all_of_them) >= _LEAST:
            found.append(deviation(all_of_them) / float(np.linalg.norm(weights)))
    return min(found) if found else None


def resolution(values: Iterable[Array]) -> float | None:
    """Return the step of the grid of all values; None if there is none, or for one value only."""
    known = np.unique(np.concatenate([one[np.isfinite(one)] for one in values]))
    if len(known) < 3:
        return None
    if len(known) > _MOST_VALUES:
        known = known[:: len(known) // _MOST_VALUES + 1]
    steps = np.diff(known)
    least = _ROUNDING * float(np.abs(known).max())
    steps = steps[steps > least]
    if len(steps) == 0:
        return None
    step = float(steps.min())
    # The mean over many multiples refines the step of two values.
    multiples = np.rint(steps / step)
    step = float(steps.sum() / multiples.sum())
    off = (known - known[0]) / step
    return step if np.abs(off - np.rint(off)).max() < _ON_GRID * max(1.0, least / step) else None
