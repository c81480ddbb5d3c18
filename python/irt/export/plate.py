"""The plate of a board with holes, as overlapping boxes: with those engines collide a sphere exactly.

The plate beyond a square about each hole is cut into rectangles. About the hole itself stand boxes whose
faces are tangents of it: a box behind a tangent is outside of the hole however wide it is, so that
neighbouring boxes overlap, and their faces make a regular polygon. All lengths are in one unit, that of the
caller.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Point = tuple[float, float]

#: Sides of the polygon that stands for a hole: its radius is that of the hole to within 0.4 %.
SIDES = 24
#: How far a side is from the centre, in radii, where the mean over the polygon is the hole's radius.
_SIDE = 3.0 / (2.0 + 1.0 / math.cos(math.pi / SIDES))
#: How far the boxes about a hole reach, in radii: a little beyond the corners of the square about it.
_FAR = 1.001 * math.sqrt(2.0)


class Box(NamedTuple):
    """A box seen from above: its centre, half its sizes, and its turn about the vertical [rad]."""

    x: float
    y: float
    half_x: float
    half_y: float
    turn: float


def boxes(half: Array, holes: Sequence[Point], radius: float) -> list[Box]:
    """Return boxes that cover a plate but for its holes.

    Parameters
    ----------
    half : (2,) array
        Half the edges of the plate.
    holes : sequence of (x, y)
        Centres of holes, which do not overlap.
    radius : float
        Of each hole.
    """
    covered = list(_rectangles(half, np.reshape(holes, (-1, 2)), radius))
    for number, hole in enumerate(holes):
        others = [math.dist(hole, other) for index, other in enumerate(holes) if index != number]
        covered.extend(_edge(hole, radius, min(others, default=math.inf)))
    return covered


def gaps(holes: Sequence[Point], radius: float) -> list[tuple[int, int]]:
    """Return the numbers, from one, of holes so close that between them some of the plate is missing."""
    least = radius * (1.0 + _FAR / math.cos(math.pi / SIDES))
    pairs = itertools.combinations(enumerate(holes, start=1), 2)
    return [(first, second) for (first, a), (second, b) in pairs if math.dist(a, b) < least]


def _rectangles(half: Array, holes: Array, radius: float) -> Iterator[Box]:
    """Yield the plate outside of the squares about holes: slabs along x, as high as they are alike."""
    low, high = holes - radius, holes + radius
    cuts = np.unique(np.clip(np.concatenate([[-half[1], half[1]], low[:, 1], high[:, 1]]), -half[1], half[1]))
    open_since: dict[Point, float] = {}
    for bottom, top in itertools.pairwise(cuts):
        beside = (low[:, 1] < top) & (high[:, 1] > bottom)
        spans = set(_between(-half[0], half[0], np.stack([low[beside, 0], high[beside, 0]], axis=1)))
        for span in [one for one in open_since if one not in spans]:
            yield _rectangle(span, (open_since.pop(span), float(bottom)))
        for span in spans:
            open_since.setdefault(span, float(bottom))
    for span, bottom in open_since.items():
        yield _rectangle(span, (bottom, float(half[1])))


def _between(begin: float, end: float, taken: Array) -> Iterator[Point]:
    """Yield the intervals of one from begin to end that others (n, 2) leave."""
    for low, high in taken[np.argsort(taken[:, 0])].tolist():
        if low > begin:
            yield begin, low
        begin = max(begin, high)
    if end > begin:
        yield begin, end


def _rectangle(across: Point, up: Point) -> Box:
    (x0, x1), (y0, y1) = across, up
    return Box((x0 + x1) / 2.0, (y0 + y1) / 2.0, (x1 - x0) / 2.0, (y1 - y0) / 2.0, 0.0)


def _edge(hole: Point, radius: float, nearest: float) -> Iterator[Box]:
    """Yield the boxes about a hole, which reach into no other; the nearest one is so far away."""
    near = _SIDE * radius
    far = min(_FAR * radius, (nearest - radius) * math.cos(math.pi / SIDES))
    depth, wide = far - near, far * math.tan(math.pi / SIDES)
    for side in range(SIDES):
        turn = 2.0 * math.pi * side / SIDES
        middle = near + depth / 2.0
        yield Box(
            hole[0] + middle * math.cos(turn), hole[1] + middle * math.sin(turn), depth / 2.0, wide, turn
        )
