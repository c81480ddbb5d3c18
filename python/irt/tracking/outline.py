"""Which outline in the pictures of a run is the board's: ways to find its corners, and its sides."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.board_edges import BoardEdges
from irt.tracking.corners import (
    MISSHAPEN,
    NEARER,
    TwoBoardsError,
    find_corners,
    find_corners_at_levels,
    least_step,
    mean_side,
    misshapen,
    misshapen_before_any,
    ordered,
)
from irt.tracking.geometry import Lens, Size
from irt.tracking.markers import corners_by_markers
from irt.tracking.source import Picture

Array = NDArray[np.float64]

#: One in so many pictures of the sample shows the board in its place, if it leaves early.
EARLY = 4
#: Outlines of the first picture and of the median whose corners are farther apart than this share of a side
#: are not of one board: a tilt moves corners less.
APART = 0.02


def board_outline(pictures: list[Picture], lens: Lens | None, size: Size) -> tuple[Array, str, bool]:
    """Return the board's corners, how they were found, and whether in the mean of the pictures.

    Raises
    ------
    IrtError
        If no way finds any.
    TwoBoardsError
        If there are two boards.
    """
    first, middle = pictures[0], np.median(np.stack(pictures), axis=0).astype(np.uint8)
    least = least_step(pictures)
    by_light = partial(find_corners, lens=lens, size=size, least=least)
    by_colour = partial(by_light, by_colour=True)
    at_levels = partial(find_corners_at_levels, lens=lens, size=size, least=least)
    ways = (
        (by_light, first, "found in the first picture"),
        (by_light, middle, "found in the median of the pictures"),
        (by_colour, first, "found in the first picture by their colour"),
        (by_colour, middle, "found in the median of the pictures by their colour"),
        (at_levels, middle, "found in the median of the pictures at several levels"),
    )
    reasons, outlines = [], []
    for find, picture, words in ways:
        try:
            found = ordered(find(picture), size)
        except TwoBoardsError:
            raise
        except IrtError as error:
            reasons.append(error)
        else:
            if lens is None and picture is first:
                return _steadier(found, words, partial(find, middle), size, middle)
            outlines.append((misshapen(found, lens, size), (found, words, picture is middle)))
            if outlines[0][0] < MISSHAPEN:
                break
        marked = corners_by_markers(first) if len(reasons) + len(outlines) == 1 else None
        if marked is not None:
            return marked, "the outer corners of markers 0 to 3", False
    if not outlines:
        raise IrtError(f"{reasons[0]}; --corners X,Y X,Y X,Y X,Y says where they are")
    # The outline of a rim is nearly of the board's shape: another is the board's if it is much nearer.
    best = min(outlines, key=lambda one: one[0])
    return best[1] if best[0] < NEARER * outlines[0][0] else outlines[0][1]


def _steadier(
    found: Array, words: str, find_in_middle: Callable[[], Array], size: Size, middle: Picture
) -> tuple[Array, str, bool]:
    """Return the outline of the first picture, or that of the median if a hand is over the board at first.

    Without a lens no outline is refused for its shape. Of two that are apart, the board's is the one that is
    much nearer to its shape.
    """
    with suppress(IrtError):
        other = ordered(find_in_middle(), size)
        height, width = middle.shape[:2]
        missed, others = (misshapen_before_any(one, size, (width, height)) for one in (found, other))
        apart = float(np.linalg.norm(other - found, axis=1).max())
        if apart > APART * mean_side(found) and others < NEARER * missed:
            return other, words.replace("first picture", "median of the pictures"), True
    return found, words, False


def board_sides(pictures: list[Picture], corners: Array, lens: Lens | None) -> BoardEdges:
    """Return the board's sides, of the first pictures where the board leaves its place early."""
    edges = BoardEdges(pictures, corners, lens)
    if edges.clear:
        return edges
    early = BoardEdges(pictures[: max(len(pictures) // EARLY, 2)], corners, lens)
    return early if early.clear else edges
