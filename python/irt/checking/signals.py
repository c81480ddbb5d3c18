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

#: Orders of the differences tried. High orders leave less of the motion, low ones survive more gaps.
_ORDERS = (3, 4, 5, 6)
#: Fewer differences than this give no scale.
_LEAST = 12
#: Values off a grid by less than this share of its step lie on it.
_ON_GRID = 0.02
#: Last digits of a float are arithmetic, not rounding: steps below this share of the values are none.
_ROUNDING = 1e-9
#: More values than this say nothing more about a grid.
_MOST_VALUES = 4000


def held_mask(marble: Array) -> NDArray[np.bool_]:
    """Return which rows hold the last place of a lost marble, (n,), but for turning points.

    At a few rows a second a marble that turns back between two rows is seen in one place twice, if places
    are coarse: the steps before and after then point in opposite directions. After a held place the marble
    is farther on in its old direction.
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
    """Return marble and tilt, (n, 2) each, NaN in rows that are no measurement."""
    marble = recording.marble.copy()
    if recording.has_marble:
        marble[held_mask(marble)] = np.nan
    if recording.tilt is None:
        return marble, None
    tilt = recording.tilt.copy()
    tilt[tilt_jumps(tilt, recording.stamps)] = np.nan
    return marble, tilt


def signal_facts(rig: Rig, cleaned: Sequence[tuple[Array, Array | None]]) -> tuple[SignalFacts, ...]:
    """Return noise and resolution of every column that was measured."""
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
        # Rounding is noise of its own, and hides what is smaller.
        noise = max(noise, step / math.sqrt(12.0))
    return SignalFacts(column, unit, noise, step)


def noise_of_runs(values: Iterable[Array]) -> float | None:
    """Return the standard deviation of white noise on a smooth signal, from all its runs.

    Differences of several orders are scaled to the noise of one value, and the order that leaves least of
    the motion counts. Their scale is the median absolute one: a few jumps do not count. Differences within
    a stretch that does not move at all (an idle axis, a marble at rest within one step of rounding) say
    nothing.

    Parameters
    ----------
    values : iterable of (n,) arrays
        One for each run, NaN where not measured.

    Returns
    -------
    float or None
        None where nothing moves, or too few values follow one another.
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
    """Return the step of the grid on which all values lie; None where there is none, or one value only."""
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
    # The mean of many multiples sharpens the step that two values give.
    multiples = np.rint(steps / step)
    step = float(steps.sum() / multiples.sum())
    off = (known - known[0]) / step
    return step if np.abs(off - np.rint(off)).max() < _ON_GRID * max(1.0, least / step) else None
