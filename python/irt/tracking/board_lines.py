"""A board found by its four sides as lines, where no one level of light separates all of it from the table.

Glare on a varnished board is as bright as the table over a part of a side, and the outline runs into it. Each
side is still a straight step along most of its length. Segments of such steps are joined to lines; two pairs
of lines make a quadrangle. The outermost one of the board's shape whose sides are seen over most of their
length is the board, or its rim.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.corners import LEAST_SHARE, clockwise, meet, misshapen, ordered
from irt.tracking.geometry import Lens, Size
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Standard deviation of the smoothing before segments are looked for [pixels].
SMOOTHED = 1.0
#: Segments shorter than this share of a picture's height say nothing of a line's direction.
SHORTEST = 0.04
#: Segments are of one line if their ends are within so much of it [pixels]: half a lens's blur, and a pixel.
ALONG = 2.0
#: Lines that are looked at, those with the most of segments, and pairs of these cross at least at this angle
#: [rad]: a board seen aslant by 45 degrees.
MOST, CROSSING = 16, np.deg2rad(45.0)
#: Share of its length over which each side is seen, and all four together: glare covers a part of one.
LEAST_SEEN, SEEN = 0.3, 0.6
#: A side is seen at both of its ends, within this share of its length. A line of the board's shadow in the
#: place of a side ends elsewhere than the sides that it crosses.
ENDS = 0.1
#: Places of a side that are looked at.
CELLS = 64
#: By what share of its sides such a quadrangle may miss the board's shape: its lines are known to a pixel.
ROUGHLY = 0.006


@dataclass(frozen=True, eq=False)
class _Line:
    """A line (point, direction) in straightened pixels, and the stretches (n, 2) along it that are seen."""

    point: Array
    way: Array
    stretches: Array

    def seen(self, start: Array, end: Array) -> float:
        """Return the share between two of its points that is seen, 0 if either end is not."""
        first, last = sorted(((start - self.point) @ self.way, (end - self.point) @ self.way))
        cells = np.linspace(first, last, CELLS)
        near = (cells[:, None] >= self.stretches[:, 0]) & (cells[:, None] <= self.stretches[:, 1])
        inside = near.any(axis=1)
        part = round(ENDS * CELLS)
        return float(inside.mean()) if inside[:part].any() and inside[-part:].any() else 0.0

    @property
    def length(self) -> float:
        """How much of it is seen [pixels]."""
        return float((self.stretches[:, 1] - self.stretches[:, 0]).sum())


def corners_by_lines(picture: Picture, lens: Lens | None, size: Size | None) -> Array:
    """Return the board's corners (4, 2) [pixels], in the order of `Size.corners`, to about a pixel.

    Parameters
    ----------
    picture : (h, w, 3) uint8 array
        Blue first, with little noise, such as the median of a sample.
    lens : Lens or None
        Of the camera: without it a shape says nothing.
    size : Size or None
        Of the board.

    Raises
    ------
    IrtError
        If no quadrangle of the board's shape is seen on all sides.
    """
    best: tuple[float, Array] | None = None
    if lens is not None and size is not None:
        lines = _lines(_segments(picture), lens)
        for pair, other in _pairs(lines):
            found = _quadrangle(pair, other, lens, size, picture.shape[:2])
            # What lies within another outline may be printed on the board.
            if found is not None and (best is None or found[0] > best[0]):
                best = found
    if best is None:
        raise IrtError("no four lines in the picture that are the sides of a board")
    return best[1]


def _segments(picture: Picture) -> Array:
    """Return the ends (n, 2, 2) of straight steps in each colour of a picture [pixels]."""
    cv2 = opencv()
    smooth = cv2.GaussianBlur(picture, (0, 0), SMOOTHED)
    detector: Any = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    found = [detector.detect(plane)[0] for plane in cv2.split(smooth)]
    ends = np.concatenate(
        [one.reshape(-1, 2, 2) for one in found if one is not None] or [np.empty((0, 2, 2))]
    )
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    order = np.argsort(-lengths)
    return np.asarray(ends[order][lengths[order] > SHORTEST * picture.shape[0]], dtype=np.float64)


def _lines(segments: Array, lens: Lens) -> list[_Line]:
    """Return the lines with the most of segments, the most first; in pixels of a lens that bends nothing."""
    focal = float(lens.matrix[0, 0])
    ends = lens.straight(segments.reshape(-1, 2)).reshape(-1, 2, 2) * focal
    left = np.ones(len(ends), dtype=np.bool_)
    lines = []
    for index in range(len(ends)):
        if not left[index]:
            continue
        point, way = ends[index, 0], ends[index, 1] - ends[index, 0]
        way = way / np.linalg.norm(way)
        for _ in range(2):
            own = np.abs((ends - point) @ np.array([way[1], -way[0]])).max(axis=1) < ALONG
            points = ends[own].reshape(-1, 2)
            point = points.mean(axis=0)
            way = np.linalg.svd(points - point)[2][0]
        if own.any():
            left &= ~own
            lines.append(_Line(point, way, np.sort((ends[own] - point) @ way, axis=1)))
    return sorted(lines, key=lambda one: -one.length)[:MOST]


def _pairs(lines: list[_Line]) -> Any:
    """Yield two pairs of lines, those of one pair side by side, that cross those of the other."""
    pairs = list(combinations(lines, 2))
    for index, pair in enumerate(pairs):
        for other in pairs[index + 1 :]:
            across = [abs(float(one.way @ two.way)) for one in pair for two in other]
            if max(across) < np.cos(CROSSING) and not set(map(id, pair)) & set(map(id, other)):
                yield pair, other


def _quadrangle(
    pair: tuple[_Line, _Line], other: tuple[_Line, _Line], lens: Lens, size: Size, shape: tuple[int, int]
) -> tuple[float, Array] | None:
    """Return the area and the corners (4, 2) of a quadrangle [pixels], None if it is no board."""
    sides = (pair[0], other[0], pair[1], other[1])
    flat = np.array(
        [meet((sides[k - 1].point, sides[k - 1].way), (sides[k].point, sides[k].way)) for k in range(4)]
    )
    corners = lens.bent(flat / float(lens.matrix[0, 0]))
    height, width = shape
    if (corners < 0.0).any() or (corners[:, 0] >= width).any() or (corners[:, 1] >= height).any():
        return None
    ahead = np.roll(corners, -1, axis=0)
    area = 0.5 * abs(float((corners[:, 0] * ahead[:, 1] - ahead[:, 0] * corners[:, 1]).sum()))
    if area < LEAST_SHARE * width * height:
        return None
    shares = [sides[k].seen(flat[k], flat[(k + 1) % 4]) for k in range(4)]
    if min(shares) < LEAST_SEEN or float(np.mean(shares)) < SEEN:
        return None
    board = ordered(clockwise(corners), size)
    if misshapen(board, lens, size) > ROUGHLY:
        return None
    return area, board
