"""A sample of pictures with the board laid in one place.

A tilt moves what is printed on a board by some pixels. Each line and hole then differs from the median of the
pictures as much as a marble does, and in the median all of them are smeared. Where the tilt of each picture
is known the board is laid in one place, and what still differs is not the board's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.geometry import Geometry, Size, moved
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: The shift of a picture is computed at each so many pixels, and is smooth between these.
SPARSE = 16


@dataclass(frozen=True, eq=False)
class Stabilised:
    """A sample with the board in one place.

    Attributes
    ----------
    pictures : list of (h, w, 3) uint8 arrays
        The first picture, and those others in which the board was measured.
    board, level : Plane or Pose
        Where the board is in the first picture as it was taken, and in `pictures`.
    """

    pictures: list[Picture]
    board: Geometry
    level: Geometry

    @classmethod
    def of(
        cls, pictures: Sequence[Picture], boards: Sequence[Geometry | None], level: Geometry, size: Size
    ) -> Stabilised:
        """Lay the board of each picture where `level` has it.

        Parameters
        ----------
        pictures : sequence of (h, w, 3) uint8 arrays
            A sample of a run, the first picture first.
        boards : sequence of Plane, Pose or None
            The board as measured in each of them, None where it could not be.
        level : Plane or Pose
            Where it is laid.
        size : Size
            Of the board.
        """
        first = boards[0] or level
        laid = [_laid(pictures[0], first, level, size)]
        laid += [
            _laid(picture, board, level, size)
            for picture, board in zip(pictures[1:], boards[1:], strict=True)
            if board is not None
        ]
        return cls(laid, first, level)

    def to_stabilised(self, places: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
        """Return where places of the first picture as it was taken are in `pictures[0]` [pixels]."""
        return tuple(moved(place, self.board, self.level) for place in places)

    def to_taken(self, place: tuple[float, float]) -> tuple[float, float]:
        """Return where a place of `pictures[0]` is in the first picture as it was taken [pixels]."""
        return moved(place, self.level, self.board)


def _laid(picture: Picture, board: Geometry, level: Geometry, size: Size) -> Picture:
    """Return a picture with its board where `level` has it."""
    cv2 = opencv()
    height, width = picture.shape[:2]
    down, right = np.mgrid[0 : height + SPARSE : SPARSE, 0 : width + SPARSE : SPARSE]
    pixels = np.column_stack([right.ravel(), down.ravel()]).astype(np.float64)
    # Far from the board its plane may not be in view: there the shift is that of the nearest place near it.
    corners = level.surface.pixels(size.corners)
    margin = 0.1 * np.ptp(corners, axis=0)
    near = np.clip(pixels, corners.min(axis=0) - margin, corners.max(axis=0) + margin)
    shift = board.surface.pixels(level.surface.positions(near)) - near
    sparse = shift.reshape(*down.shape, 2).astype(np.float32)
    to_sparse = np.array([[1.0 / SPARSE, 0.0, 0.0], [0.0, 1.0 / SPARSE, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    full = cv2.warpAffine(sparse, to_sparse, (width, height), flags=flags)
    columns = np.arange(width, dtype=np.float32) + full[..., 0]
    rows = np.arange(height, dtype=np.float32)[:, None] + full[..., 1]
    laid = cv2.remap(picture, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(laid, dtype=np.uint8)
