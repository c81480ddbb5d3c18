"""What is painted on the board: wood, paths, holes, things like a marble, and markers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Texture = NDArray[np.float32]

#: Texels to a metre.
FINE = 4000.0
WOODS = {"light": (0.62, 0.44, 0.26), "dark": (0.40, 0.25, 0.13), "white": (0.72, 0.72, 0.70)}
HOLE_M = 0.0075


@dataclass(frozen=True)
class Paint:
    """What to paint.

    Attributes
    ----------
    wood : str
        One of `WOODS`.
    grain, lines, holes : float, int, int
        Depth of the wood's grain; how many paths, and how many holes.
    likeness : tuple or None
        Linear colour of a disc painted as large as the marble, or none.
    markers : float
        Side of an ArUco marker in each corner [m], or 0.
    """

    wood: str = "light"
    grain: float = 0.1
    lines: int = 4
    holes: int = 6
    likeness: tuple[float, float, float] | None = None
    markers: float = 0.0


def painted(paint: Paint, edges_m: tuple[float, float], radius_m: float, seed: int) -> Texture:
    """Return linear red, green, blue of the board (h, w, 3), its first row along the edge of greatest y."""
    random = np.random.default_rng(seed)
    width, height = (round(FINE * edge) for edge in edges_m)
    noise = random.standard_normal((height, width)).astype(np.float32)
    along = np.asarray(cv2.GaussianBlur(noise, (0, 0), 40, sigmaY=2))
    along = along / along.std()
    board = np.array(WOODS[paint.wood], np.float32) * (1.0 + paint.grain * along[:, :, None])
    for _ in range(paint.lines):
        points = random.uniform([0.1, 0.1], [0.9, 0.9], (5, 2)) * [width, height]
        cv2.polylines(board, [points.astype(np.int32)], False, (0.03, 0.03, 0.03), round(0.002 * FINE), 16)
    places = random.uniform([0.15, 0.15], [0.85, 0.85], (paint.holes, 2)) * [width, height]
    for place in places:
        cv2.circle(board, tuple(map(int, place)), round(HOLE_M * FINE), (0.012, 0.010, 0.008), -1, 16)
    if paint.likeness is not None:
        place = random.uniform([0.3, 0.3], [0.7, 0.7]) * [width, height]
        cv2.circle(board, tuple(map(int, place)), round(radius_m * FINE), paint.likeness, -1, 16)
    if paint.markers:
        _stamp(board, round(paint.markers * FINE))
    return np.asarray(cv2.GaussianBlur(board, (0, 0), 1.0), dtype=np.float32)


def _stamp(board: Texture, side: int) -> None:
    """Put markers 0 to 3 into the corners, clockwise from the top left, on white."""
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    height, width = board.shape[:2]
    quiet = side // 5
    corners = [(0, 0), (width, 0), (width, height), (0, height)]
    for number, (right, down) in enumerate(corners):
        left, top = (
            (quiet if right == 0 else width - side - quiet),
            (quiet if down == 0 else height - side - quiet),
        )
        board[max(top - quiet, 0) : top + side + quiet, max(left - quiet, 0) : left + side + quiet] = 0.8
        marker = cv2.aruco.generateImageMarker(words, number, side)
        board[top : top + side, left : left + side] = np.where(marker[:, :, None] > 0, 0.8, 0.01)
