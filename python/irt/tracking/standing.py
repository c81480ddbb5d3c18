"""Whether the board is where it was all through a run, and the camera gives new pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Stretches = tuple[tuple[int, int], ...]

#: A hand that sets the marble back covers the board's sides for less than this [s].
COVERED_S = 1.0


def absences(looks: Sequence[tuple[int, bool]], stamps: Array) -> Stretches:
    """Return the stretches (first, count) of pictures in which the board is not where it was.

    Parameters
    ----------
    looks : sequence of (picture, there)
        Pictures that were looked at, in order, and whether the board is in its place in them.
    stamps : (n,) array
        Of all pictures [s].
    """
    missing = np.zeros(len(stamps), dtype=np.bool_)
    since = 0
    for picture, there in looks:
        if there:
            since = picture + 1
        # Between the last look that found the board and the next, nobody knows where it is.
        missing[since : picture + 1] = not there
    if looks and not looks[-1][1]:
        missing[since:] = True
    return tuple(
        (first, count)
        for first, count in stretches(missing)
        if stamps[first + count - 1] - stamps[first] >= COVERED_S
    )


def stretches(flags: NDArray[np.bool_]) -> Stretches:
    """Return first index and length of the stretches that are set, the first one first."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return tuple((int(first), int(end - first)) for first, end in zip(edges[::2], edges[1::2], strict=True))
