"""The board beneath a marble, moved to where the board's tilt has it in a picture.

A tilt of a few hundredths moves what is painted on the board, and its edges, by some pixels. What is seen
around the marble shows by how much there (Lucas and Kanade, 1981), from where it was in the picture before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.tracking.blob_detector import Box
from irt.tracking.edge_fit import Values
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: What is seen between these multiples of a marble's radius is the board.
NEAR, FAR = 1.35, 2.6
#: Largest shift [pixels], and in radii of the marble where that is more: a tilt moves a board near a camera
#: farther.
MOST, MOST_RADII = 6.0, 0.7
#: Rounds of looking for where the tilt has the board in one of the sample.
ROUNDS = 4
#: Weights of the colours that make grey.
GREY = np.full((1, 3), 1.0 / 3.0, np.float32)
#: How far the board may have moved since the last look (standard deviation) [pixels].
FREE = 0.5


class Underlay:
    """An empty board to be looked at under a marble.

    Parameters
    ----------
    without : (h, w, 3) uint8 array
        The board without a marble.
    """

    def __init__(self, without: Picture) -> None:
        cv2 = opencv()
        self._colours = without.astype(np.float32)
        grey = cv2.GaussianBlur(self._colours.mean(axis=2), (3, 3), 0)
        across = cv2.Scharr(grey, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)
        down = cv2.Scharr(grey, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)
        self._flow = np.dstack([grey, across, down])
        self.shift = np.zeros(2)

    def beneath(
        self, picture: Values, box: Box, disc: tuple[float, float, float], noise: float, rounds: int = 1
    ) -> Values:
        """Return the board's colours (h, w, 3) in a box of a picture.

        Parameters
        ----------
        picture : (h, w, 3) float32 array
            The picture's colours in the box.
        box : Box
            Where that is.
        disc : tuple
            The marble's middle and radius [pixels of the picture].
        noise : float
            Of a colour [levels].
        rounds : int
            One where pictures follow each other, more where they do not.
        """
        cv2 = opencv()
        grey = cv2.GaussianBlur(opencv().transform(picture, GREY), (3, 3), 0)
        x, y, radius = disc
        most = max(MOST, MOST_RADII * radius)
        down, right = np.ogrid[box.top : box.bottom, box.left : box.right]
        away = (right - x) ** 2 + (down - y) ** 2
        ring = (away > (NEAR * radius) ** 2) & (away < (FAR * radius) ** 2)
        shift = self.shift
        for _ in range(rounds):
            flow = self._cut(self._flow, box, shift)
            left = (grey - flow[:, :, 0])[ring]
            # Light that changed is no shift; and what lies over the board has no say.
            left = left - np.median(left) if len(left) else left
            slopes = flow[:, :, 1:][ring]
            trust = 1.0 / (1.0 + (left / (6.0 * noise)) ** 2)
            weighed = slopes * trust[:, None]
            normal = slopes.T @ weighed + np.eye(2) * (noise / FREE) ** 2
            shift = np.clip(shift - np.linalg.solve(normal, weighed.T @ left), -most, most)
        self.shift = shift
        return self._cut(self._colours, box, shift)

    def _cut(self, whole: Values, box: Box, shift: Array) -> Values:
        """Return a box of a picture that is moved by a shift."""
        size = box.right - box.left, box.bottom - box.top
        middle = (
            box.left + (size[0] - 1) / 2.0 - float(shift[0]),
            box.top + (size[1] - 1) / 2.0 - float(shift[1]),
        )
        return np.asarray(opencv().getRectSubPix(whole, size, middle), dtype=np.float32)
