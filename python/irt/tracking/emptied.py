"""The board without a marble and its shadow, from pictures that all show them somewhere.

The median of a sample is the board where the marble passes. Where it stays for long, or its shadow does, the
median shows these. What they change is the same in all pictures beside the marble: there a picture says
nothing of the board.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.tracking.candidates import within
from irt.tracking.coverage import Coverage
from irt.tracking.edge_fit import Rim
from irt.tracking.opencv import opencv
from irt.tracking.shadow import CELLS, Neighbourhood, cut_out

Picture = NDArray[np.uint8]
Mask = NDArray[np.uint8]

#: Radii about a disc that are its own in any case: its rim is blurred, and what it mirrors moves.
OWN = 1.6
#: A place that a marble and its shadow change in more than this share of the pictures is looked at: where
#: they change fewer, the median is the board's.
OFTEN = 0.2
#: Light that is the board's, from 0 to 1, as of `Coverage.lit`.
LIT = 0.5


def changed(around: Sequence[Neighbourhood], noise: float) -> Mask:
    """Return where discs and their shadows change the board (n, n), 1 or 0, `CELLS` to a radius."""
    cv2 = opencv()
    apart = (Coverage.of(*cut_out(around), noise, CELLS).lit < LIT).astype(np.uint8)
    # A cell alone is noise; the end of a shadow is soft.
    near = np.ones((3, 3), np.uint8)
    _, parts = cv2.connectedComponents(cv2.morphologyEx(apart, cv2.MORPH_OPEN, near))
    # A ball stands in its shadow: what does not touch the disc is something else's.
    half = len(parts) // 2
    own = np.unique(parts[half - CELLS : half + CELLS + 1, half - CELLS : half + CELLS + 1])
    mine = np.isin(parts, own[own > 0]).astype(np.uint8)
    return np.asarray(cv2.dilate(mine, near), dtype=np.uint8)


def reaches_beyond(mask: Mask) -> bool:
    """Return whether more than a disc's own place is changed, as of `changed`: it has a shadow beside it."""
    half = len(mask) // 2
    down, right = np.ogrid[-half : half + 1, -half : half + 1]
    return bool(mask[np.hypot(right, down) > OWN * CELLS].any())


def emptied(
    pictures: Sequence[Picture], without: Picture, discs: Sequence[tuple[int, Rim]], mask: Mask | None = None
) -> Picture:
    """Return the median board with the marble taken out of it where it, or its shadow, is often.

    Parameters
    ----------
    pictures : sequence of (h, w, 3) uint8 arrays
        A sample of the run.
    without : (h, w, 3) uint8 array
        Their median.
    discs : sequence of (index, Rim)
        The marble in pictures of the sample.
    mask : (n, n) uint8 array, optional
        What `changed` returns of these discs.
    """
    held = np.zeros((len(pictures), *without.shape[:2]), dtype=np.bool_)
    for index, rim in discs:
        held[(index, *within(without, rim, OWN))] = True
        if mask is not None:
            held[index] |= _placed(mask, rim, without.shape[:2])
    often = held.mean(axis=0) > OFTEN
    if not often.any():
        return without
    stack = np.stack([picture[often] for picture in pictures]).astype(np.float32)
    stack[held[:, often]] = np.nan
    seen = ~np.isnan(stack[:, :, 0]).all(axis=0)
    result = without.copy()
    rows, columns = np.nonzero(often)
    result[rows[seen], columns[seen]] = np.rint(np.nanmedian(stack[:, seen], axis=0)).astype(np.uint8)
    return result


def _placed(mask: Mask, rim: Rim, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Return a mask about a disc as a picture of a shape has it."""
    cells = CELLS / rim.radius
    half = len(mask) // 2
    to_cells = np.array([[cells, 0.0, half - cells * rim.x], [0.0, cells, half - cells * rim.y]])
    cv2 = opencv()
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(mask, to_cells, shape[::-1], flags=flags) > 0)
