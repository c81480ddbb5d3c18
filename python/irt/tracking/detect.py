"""A marble in a picture: what differs from the empty board, and where that is on the board.

As the paper does, the four corners of the board give the homography from pixels to board coordinates. Pixels
are counted from the middle of the first one, to the right and down.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: A pixel is another than on the empty board by this many times the noise, and this many levels.
DIFFERS, LEAST_LEVELS = 6.0, 25.0
#: A marble's area over that which its radius asks for.
PLAUSIBLE = (0.4, 2.0)


@dataclass(frozen=True)
class Tracker:
    """Reads positions off pictures of one camera.

    Attributes
    ----------
    empty : (h, w, 3) array
        The board without a marble.
    plane : (3, 3) array
        Homography from pixels to board edges.
    radius : float
        Of the marble [pixels].
    """

    empty: Picture
    plane: Array
    radius: float

    def against(self, empty: Picture) -> Tracker:
        """Return it with another picture of the empty board: after the camera or the light moved."""
        return Tracker(empty, self.plane, self.radius)

    @classmethod
    def calibrated(cls, empty: Picture, edges: tuple[float, float], radius: float) -> Tracker:
        """Calibrate on a picture of the empty, level board.

        Parameters
        ----------
        empty : (h, w, 3) uint8 array
            The picture.
        edges : tuple
            Length of the board along x and along y [board edges].
        radius : float
            Of the marble [board edges].

        Raises
        ------
        IrtError
            If the picture shows no board.
        """
        cv2 = _opencv()
        corners = find_corners(empty)
        half_x, half_y = edges[0] / 2.0, edges[1] / 2.0
        board = np.array([[-half_x, half_y], [half_x, half_y], [half_x, -half_y], [-half_x, -half_y]])
        plane = cv2.getPerspectiveTransform(corners.astype(np.float32), board.astype(np.float32))
        across = np.hypot(*(corners[1] - corners[0])) / edges[0]
        return cls(empty, np.asarray(plane, dtype=np.float64), radius * float(across))

    def read(self, pictures: Iterable[Picture]) -> Array:
        """Return the marble's positions (n, 2) [board edges] in n pictures, NaN where there is none."""
        pixels = np.array([find_marble(one, self.empty, self.radius) for one in pictures]).reshape(-1, 2)
        seen = np.column_stack([pixels, np.ones(len(pixels))]) @ self.plane.T
        return np.asarray(seen[:, :2] / seen[:, 2:])


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
        The empty, level board when the camera was calibrated, and before these pictures.
    pictures : iterable of (h, w, 3) uint8 arrays
        Of a run.
    edges, radius : tuple, float
        Of the board along x and y, and of the marble [board edges].

    Raises
    ------
    IrtError
        If the first picture shows no board.
    """
    return Tracker.calibrated(calibration, edges, radius).against(empty).read(pictures)


def find_corners(picture: Picture) -> Array:
    """Return the board's corners (4, 2) [pixels]: a large bright quadrangle, clockwise from the top left.

    Its sides are lines fitted to its outline, so that a corner is where two of them meet.

    Raises
    ------
    IrtError
        If there is no such quadrangle.
    """
    cv2 = _opencv()
    grey = cv2.GaussianBlur(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), (3, 3), 0)
    _, bright = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    outlines, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(outlines, key=cv2.contourArea, default=None)
    if largest is None or cv2.contourArea(largest) < 0.1 * grey.size:
        raise IrtError("no board in the picture: expected a bright one on a dark ground")
    rough = cv2.approxPolyDP(largest, 0.03 * cv2.arcLength(largest, True), True).reshape(-1, 2)
    if len(rough) != 4:
        raise IrtError(f"the board in the picture has {len(rough)} corners: all four have to be in view")
    rough = _clockwise(rough.astype(np.float64))
    sides = [_edge(grey, rough[side], rough[(side + 1) % 4]) for side in range(4)]
    return np.array([_meet(sides[side - 1], sides[side]) for side in range(4)])


def find_marble(picture: Picture, empty: Picture, radius: float) -> tuple[float, float]:
    """Return where the marble is [pixels], to a fraction of one; NaN if nothing of its size is there.

    Parameters
    ----------
    picture, empty : (h, w, 3) uint8 arrays
        With and without it.
    radius : float
        Of the marble [pixels].
    """
    cv2 = _opencv()
    apart = np.abs(picture.astype(np.float64) - empty).sum(axis=2)
    apart = cv2.GaussianBlur(apart, (3, 3), 0)
    middle = float(np.median(apart))
    noise = 1.4826 * float(np.median(np.abs(apart - middle)))
    mask = (apart > middle + max(DIFFERS * noise, LEAST_LEVELS)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    wanted = np.pi * radius**2
    areas = stats[1:, cv2.CC_STAT_AREA]
    fits = [one + 1 for one in range(count - 1) if PLAUSIBLE[0] < areas[one] / wanted < PLAUSIBLE[1]]
    if not fits:
        return float("nan"), float("nan")
    best = max(fits, key=lambda one: float(apart[labels == one].sum()))
    near = cv2.dilate((labels == best).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    # Pixels within count alike, those of the rim by how much of them the marble covers.
    full = float(np.median(apart[labels == best]))
    weight = np.where(near, np.clip((apart - middle) / max(full - middle, 1.0), 0.0, 1.0), 0.0)
    down, right = np.nonzero(weight)
    part = weight[down, right]
    return float(part @ right / part.sum()), float(part @ down / part.sum())


def _edge(grey: Any, start: Array, end: Array) -> tuple[Array, Array]:
    """Return a point and a direction of the side between two rough corners: where brightness is halfway."""
    way = end - start
    normal = np.array([way[1], -way[0]]) / np.hypot(*way)
    offsets = np.arange(-4.0, 4.01, 0.25)
    found = []
    for part in np.linspace(0.08, 0.92, 80):
        points = start + part * way + offsets[:, None] * normal
        levels = _read(grey, points)
        halfway = 0.5 * (levels[:6].mean() + levels[-6:].mean())
        falls = np.nonzero((levels[:-1] - halfway) * (levels[1:] - halfway) <= 0.0)[0]
        if len(falls) and abs(levels[0] - levels[-1]) > LEAST_LEVELS:
            first = falls[np.argmin(np.abs(offsets[falls]))]
            step = levels[first + 1] - levels[first]
            at = offsets[first] + 0.25 * (halfway - levels[first]) / (step or 1.0)
            found.append(start + part * way + at * normal)
    if len(found) < 10:
        raise IrtError("a side of the board is not clear in the picture: give it light, or a darker ground")
    vx, vy, x, y = _opencv().fitLine(np.array(found, np.float32), 2, 0, 0.01, 0.01).ravel()
    return np.array([x, y], dtype=np.float64), np.array([vx, vy], dtype=np.float64)


def _read(grey: Any, points: Array) -> Array:
    """Return brightness at points (n, 2) between pixels."""
    u = np.clip(points[:, 0], 0, grey.shape[1] - 1.001)
    v = np.clip(points[:, 1], 0, grey.shape[0] - 1.001)
    column, row = u.astype(int), v.astype(int)
    u, v = u - column, v - row
    level = grey.astype(np.float64)
    above = level[row, column] * (1 - u) + level[row, column + 1] * u
    below = level[row + 1, column] * (1 - u) + level[row + 1, column + 1] * u
    return np.asarray(above * (1 - v) + below * v)


def _meet(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return where two lines cross."""
    (start, way), (begin, across) = one, other
    parts = np.linalg.solve(np.stack([way, -across], axis=1), begin - start)
    return np.asarray(start + parts[0] * way)


def _clockwise(corners: Array) -> Array:
    """Return corners (4, 2) in order, from that nearest to the picture's top left."""
    about = corners - corners.mean(axis=0)
    corners = corners[np.argsort(np.arctan2(about[:, 1], about[:, 0]))]
    return np.roll(corners, -int(np.argmin(corners.sum(axis=1))), axis=0)


def _opencv() -> Any:
    """Import OpenCV, which loads slowly."""
    import cv2  # noqa: PLC0415

    return cv2
