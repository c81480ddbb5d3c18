"""Where in a picture a disc of the marble's size and colours may be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from irt.tracking.opencv import opencv

Likeness = NDArray[np.uint8]

#: Least likeness within less likeness around (from 0 to 1) for a look at the rim.
LEAST = 0.18
#: Marbles larger than this are looked for in pictures of half the size [pixels].
COARSE_FROM = 5.0


@dataclass(frozen=True)
class Box:
    """A part of a picture: from a corner to another, the last row and column not included."""

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def about(cls, x: float, y: float, reach: float, within: Box) -> Box:
        """Return a square about a place, cut where it leaves another box."""
        return cls(
            max(int(x - reach), within.left),
            max(int(y - reach), within.top),
            min(int(x + reach) + 2, within.right),
            min(int(y + reach) + 2, within.bottom),
        )

    def widened(self, around: int, picture: NDArray[np.uint8]) -> Box:
        """Return the box with so many pixels more on each side, cut where it leaves a picture."""
        height, width = picture.shape[:2]
        return Box(
            max(self.left - around, 0),
            max(self.top - around, 0),
            min(self.right + around, width),
            min(self.bottom + around, height),
        )

    def inside(self, other: Box) -> Box:
        """Return the box as seen from the corner of another one."""
        left, top = other.left, other.top
        return Box(self.left - left, self.top - top, self.right - left, self.bottom - top)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def empty(self) -> bool:
        """Whether nothing is in it."""
        return self.right - self.left < 4 or self.bottom - self.top < 4


@lru_cache(maxsize=64)
def _kernel(tenths: int) -> NDArray[np.float32]:
    """Return a disc of weight 1 less a ring around it of weight 1, for a radius in tenths of a pixel."""
    radius = tenths / 10.0
    reach = int(np.ceil(1.9 * radius))
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    away = np.hypot(down, right)
    disc = np.clip(0.92 * radius - away + 0.5, 0.0, 1.0)
    ring = np.clip(away - 1.2 * radius + 0.5, 0.0, 1.0) * np.clip(1.8 * radius - away + 0.5, 0.0, 1.0)
    return np.asarray(disc / disc.sum() - 0.8 * ring / ring.sum(), dtype=np.float32)


def seek(likeness: Likeness, radius: float, most: int) -> list[tuple[float, float, float]]:
    """Return score, x and y of the places that look most like a disc, the best first.

    Parameters
    ----------
    likeness : (h, w) uint8 array
        From 0 to 255.
    radius : float
        Of the disc [pixels].
    most : int
        How many to return.
    """
    cv2 = opencv()
    if not likeness.any():
        return []
    score = cv2.filter2D(likeness, cv2.CV_32F, _kernel(round(10 * radius)), borderType=cv2.BORDER_CONSTANT)
    size = 2 * max(int(0.8 * radius), 1) + 1
    top = cv2.dilate(score, np.ones((size, size), np.uint8))
    rows, columns = np.nonzero((score >= top) & (score > 255.0 * LEAST))
    heights = score[rows, columns]
    order = np.argsort(-heights)[:most]
    return [(float(heights[i]) / 255.0, float(columns[i]), float(rows[i])) for i in order]
