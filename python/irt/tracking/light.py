"""Pictures as they would be in the usual light, where shadows of people and arms pass over the board.

Light is the ratio of a picture to the board without the marble, as the median over windows so large that a
marble and its shadow fill less than half of them. A median keeps straight edges: those of a passing shadow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.tracking.blob_detector import Box
from irt.tracking.opencv import opencv
from irt.tracking.shadow import BLACK

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Values = NDArray[np.float32]

#: Cells to a radius.
CELLS = 2
#: Side of the windows [cells]: in 5.5 x 5.5 radii, a ball and its shadow as long again are a fifth.
WINDOW = 11
#: What is read around a place whose light is asked for, in radii: the window's half, and a margin.
AROUND = 4.5
#: Light that differs from the usual one by more than this is not steady: 14 levels of 255 are what a
#: candidate for a marble differs by at least (`irt.tracking.learning`).
STEADY = 14.0 / 255.0
#: Light over the usual one is counted in steps of this, in 8 bits: to 4 times the usual one.
COUNTS = 64.0


class Light:
    """What light the board usually has.

    Parameters
    ----------
    without : (h, w, 3) uint8 array
        The board without a marble.
    radius : float
        Of the marble [pixels].
    """

    def __init__(self, without: Picture, radius: float) -> None:
        self._step = max(radius / CELLS, 1.0)
        self._grey = without.mean(axis=2, dtype=np.float32) + np.float32(BLACK)

    def share(self, picture: Picture, box: Box) -> Values:
        """Return the light in a box of a picture over the usual one (h, w)."""
        cv2 = opencv()
        height, width = box.bottom - box.top, box.right - box.left
        small = max(round(width / self._step), 1), max(round(height / self._step), 1)
        # Sums of cells: a ratio of noisy pixels would be biased.
        seen, usual = (
            cv2.resize(one, small, interpolation=cv2.INTER_AREA)
            for one in (
                cv2.transform(picture[box.slices], np.full((1, 3), 1.0 / 3.0, np.float32)),
                self._grey[box.slices],
            )
        )
        ratio = np.clip((seen + np.float32(BLACK)) / usual * np.float32(COUNTS), 1.0, 255.0)
        middle = cv2.medianBlur(np.rint(ratio).astype(np.uint8), WINDOW)
        large = cv2.resize(middle, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(large.astype(np.float32) / np.float32(COUNTS), dtype=np.float32)

    def evened(self, picture: Picture, box: Box) -> Picture:
        """Return a box of a picture (h, w, 3) as it would be in the usual light."""
        around = round(AROUND * CELLS * self._step)
        large = box.widened(around, picture)
        share = self.share(picture, large)[box.inside(large).slices][..., None]
        black = np.float32(BLACK)
        return np.asarray(
            np.clip(np.rint((picture[box.slices] + black) / share - black), 0, 255), dtype=np.uint8
        )


def is_steady(pictures: Sequence[Picture], light: Light, box: Box) -> bool:
    """Return whether the light stays: whether no shadow passes, and neither lamps nor exposure change it."""
    apart = [np.quantile(np.abs(np.log(light.share(picture, box)[::4, ::4])), 0.9) for picture in pictures]
    return bool(np.quantile(apart, 0.9) < STEADY)
