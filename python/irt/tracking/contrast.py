"""Pictures with more contrast, for a marble that is nearly as bright as its board: white on white.

What all thresholds of the tracker are made for is a marble that differs from its board by tens of levels. A
fainter one is plain to see where it is many pixels large, because noise of pixels is averaged. So pictures
are smoothed, and then stretched about the board's level by as much as their noise has fallen. To all that
follows they are pictures by a camera of another contrast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.tracking.blob_detector import Box
from irt.tracking.light import Light
from irt.tracking.opencv import opencv

Picture = NDArray[np.uint8]

#: Radii over the standard deviation of the smoothing: a disc that is blurred so keeps its level inside, and
#: its rim within a third of its radius.
SMOOTHED = 6.0
#: Share of the box, and to how far from the middle its levels may be stretched: a board that stands askew
#: fills little more than half of its box.
MOST_OF_BOARD, ROOM = 0.45, 64.0
#: The middle of levels.
MIDDLE = 128.0


class Contrast:
    """A camera's other contrast.

    Parameters
    ----------
    without : (h, w, 3) uint8 array
        The board without a marble, blue first.
    box : Box
        Where the marble can be.
    radius : float
        Of the marble [pixels].
    light : Light or None
        What makes pictures even before.

    Attributes
    ----------
    gain : float
        How far levels are stretched.
    """

    def __init__(self, without: Picture, box: Box, radius: float, light: Light | None) -> None:
        self._blur = radius / SMOOTHED
        self._light = light
        board = without[box.slices].reshape(-1, 3).astype(np.float32)
        self._board = np.median(board, axis=0)
        spread = float(np.quantile(np.abs(board - self._board).max(axis=1), MOST_OF_BOARD))
        # White noise falls by 2 sqrt(pi) times the standard deviation of the smoothing.
        self.gain = min(2.0 * float(np.sqrt(np.pi)) * self._blur, ROOM / max(spread, 1.0))

    def evened(self, picture: Picture, box: Box) -> Picture:
        """Return a box of a picture (h, w, 3) with more contrast."""
        around = int(np.ceil(3.0 * self._blur))
        large = box.widened(around, picture)
        part = picture[large.slices] if self._light is None else self._light.evened(picture, large)
        smooth = opencv().GaussianBlur(part.astype(np.float32), (0, 0), self._blur)
        cut = smooth[box.inside(large).slices]
        stretched = np.float32(self.gain) * (cut - self._board) + np.float32(MIDDLE)
        return np.asarray(np.clip(np.rint(stretched), 0, 255), dtype=np.uint8)
