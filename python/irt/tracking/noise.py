"""How much a colour scatters from picture to picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

#: Least noise [levels]: that of rounding, and of what the light does.
QUIETEST = 1.0
#: Pictures that show it, and every so many pixels of these.
SOME, SPARSE = 8, 3


def noise_of(pictures: Sequence[Picture], usual: Picture) -> float:
    """Return the standard deviation of a colour about the usual picture (h, w, 3) [levels]."""
    few = [one[::SPARSE, ::SPARSE].astype(np.int16) for one in pictures[:: max(len(pictures) // SOME, 1)]]
    apart = np.abs(np.stack(few) - usual[::SPARSE, ::SPARSE].astype(np.int16))
    # Levels are whole: the mean below a quantile says more than a median of three or four.
    return max(QUIETEST, 1.25 * float(np.minimum(apart, np.quantile(apart, 0.9)).mean()) * 1.1)
