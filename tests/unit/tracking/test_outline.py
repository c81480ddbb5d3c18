"""The outline that is taken for the board is of its shape, and is measured on a large picture, too."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from irt.errors import IrtError
from irt.tracking.board_edges import BoardEdges
from irt.tracking.geometry import Lens, Size
from irt.tracking.run import Question, _corners, prepare
from tracking.view import View, turned

EDGES = np.array([0.276, 0.231])
SIZE = Size(1.0, 231 / 276, 6.85 / 276)
WHITE, WOOD, TABLE = (225, 225, 225), (90, 150, 200), (40, 40, 40)
RIM_M = 0.010


def outline(view: View, tilt: np.ndarray, beyond: float = 0.0) -> np.ndarray:
    """Return the corners (4, 2) [pixels] of the board, or of what reaches so far beyond it [m]."""
    flat = np.column_stack([SIZE.corners * EDGES[0] * (EDGES + 2 * beyond) / EDGES, np.zeros(4)])
    return view.project(flat @ turned(tilt).T)


def drawn(
    view: View, tilt: np.ndarray, board: tuple[int, ...], rim: tuple[int, ...] | None = None
) -> np.ndarray:
    """Draw a board, with a rim about it."""
    picture = np.full((view.height, view.width, 3), TABLE, np.uint8)
    for corners, colour in ((outline(view, tilt, RIM_M), rim), (outline(view, tilt), board)):
        if colour is not None:
            cv2.fillConvexPoly(picture, np.rint(16 * corners).astype(int), colour, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(picture, (0, 0), 0.7)


def lens_of(view: View) -> Lens:
    return Lens(view.matrix, view.distortion, (view.width, view.height), 0.1)


VIEW = View.above(330.0, lean=(0.1, -0.1))
LEVEL = np.zeros(2)


def test_a_rim_in_the_place_of_the_board_is_refused() -> None:
    pictures = [drawn(VIEW, LEVEL, WOOD, rim=WOOD)] * 2
    source = SimpleNamespace(name="run", sample=lambda _: pictures)
    with pytest.raises(IrtError, match="may be its rim, or its edge: --corners"):
        prepare(source, Question(SIZE, lens_of(VIEW)), lambda *_: None)


def test_of_two_outlines_the_one_of_the_boards_shape_is_taken() -> None:
    """By brightness a white rim is found; by colour, the wood within it."""
    pictures = [drawn(VIEW, LEVEL, WOOD, rim=WHITE)] * 2
    found, words, _ = _corners(pictures, Question(SIZE, lens_of(VIEW)))
    assert "colour" in words
    assert np.linalg.norm(found - outline(VIEW, LEVEL), axis=1).max() < 1.0


def test_sides_of_a_large_board_move_far_and_are_followed() -> None:
    view = View.above(1000.0, focal=1900.0, lean=(0.05, 0.1), size=(1440, 1080))
    phase = 2 * np.pi * np.arange(12) / 12
    tilts = 0.06 * np.column_stack([np.sin(phase), np.cos(phase)])
    pictures = [drawn(view, tilt, WHITE) for tilt in tilts]
    edges = BoardEdges(pictures, outline(view, tilts[0]), lens_of(view))
    assert edges.clear
    # The tilt moves corners by 12 pixels.
    assert np.linalg.norm(edges.corners - outline(view, LEVEL), axis=1).max() < 2.0
