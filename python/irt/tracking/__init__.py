"""From pictures to positions: the board's corners, the marble, and the plane between them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from irt.tracking.blob_detector import Box
from irt.tracking.corners import find_corners
from irt.tracking.geometry import Plane, Size
from irt.tracking.learning import learn, scale_of
from irt.tracking.separation import NoMarbleError
from irt.tracking.tracker import Tracker

__all__ = ["positions"]

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Pictures of a run that the marble's looks are learned from.
SAMPLE = 40


def positions(
    calibration: Picture,
    empty: Picture,
    pictures: Iterable[Picture],
    edges: tuple[float, float],
    radius: float,
) -> Array:
    """Return a marble's positions (n, 2) [board edges] in n pictures, NaN where there is none.

    Parameters
    ----------
    calibration, empty : (h, w, 3) uint8 arrays
        The empty, level board when the camera was calibrated, and before these pictures; red first. The
        board of the calibration lies as high as the marble's middle.
    pictures : iterable of (h, w, 3) uint8 arrays
        Of a run.
    edges, radius : tuple, float
        Of the board along x and y, and of the marble [board edges].

    Raises
    ------
    IrtError
        If the calibration shows no board.
    """
    size = Size(*edges, radius)
    plane = Plane.of(find_corners(calibration[:, :, ::-1].copy()), size)
    run = [picture[:, :, ::-1].copy() for picture in pictures]
    height, width = empty.shape[:2]
    box = Box(0, 0, width, height)
    sample = [run[one] for one in np.linspace(0, len(run) - 1, min(SAMPLE, len(run))).astype(int)]
    try:
        learned = learn(sample, plane, box, empty=empty[:, :, ::-1].copy())
    except NoMarbleError:
        return np.full((len(run), 2), np.nan)
    tracker = Tracker(learned, scale_of(plane, learned.finder.middle))
    if learned.first is not None:
        tracker.expect(*learned.first)
    pixels = np.full((len(run), 2), np.nan)
    for row, picture in enumerate(run):
        seen = tracker.see(picture)
        pixels[row] = seen.x, seen.y
        if seen.confirms is not None:
            pixels[row - 1] = seen.confirms.x, seen.confirms.y
    return plane.positions(pixels)
