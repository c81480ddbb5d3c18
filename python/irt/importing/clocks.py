"""Offset between two clocks that stamped the same events."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import deviation

Array = NDArray[np.float64]

#: Share of the events of a stretch, those with the smallest delays, that determine the clocks' offset.
_QUICK = 0.1
#: Minimum number of events in a stretch.
_STRETCH = 40


def clock_offset(sent: Array, received: Array) -> tuple[float, float]:
    """Return the offset to add to the first clock's stamps to get the second's, and its standard error [s].

    Each event is stamped by one clock when it happens, and by the other slightly later. Queues can only
    delay, so the quickest events of each stretch determine the offset. The error is that of the mean over
    stretches and includes drift.
    """
    delays = np.asarray(received - sent, dtype=np.float64)
    parts = np.array_split(delays, max(1, min(50, len(delays) // _STRETCH)))
    quick = np.array([np.quantile(part, _QUICK) for part in parts])
    error = float(quick.std(ddof=1) / np.sqrt(len(quick))) if len(quick) > 1 else float(np.ptp(delays))
    return float(np.median(quick)), error


def steady_offset(first: Array, second: Array) -> tuple[float, float]:
    """Return the median difference of two clocks that were read at the same times, and its error [s]."""
    difference = np.asarray(second - first, dtype=np.float64)
    centre = float(np.median(difference))
    spread = deviation(difference - centre)
    return centre, 1.2533 * spread / float(np.sqrt(len(difference)))
