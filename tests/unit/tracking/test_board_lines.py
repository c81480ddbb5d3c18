"""A board whose sides no one level separates is found by its sides as lines, and its shadow is not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from irt.errors import IrtError
from irt.tracking.board_lines import corners_by_lines
from irt.tracking.corners import find_corners_at_levels
from irt.tracking.geometry import Lens, Size
from irt.tracking.outline import board_outline
from tracking.view import View

SIZE = Size(1.0, 231 / 276, 6.85 / 276)
VIEW = View.above(330.0, lean=(0.15, -0.2), turn=0.1)
LENS = Lens(VIEW.matrix, VIEW.distortion, (VIEW.width, VIEW.height), 0.1)
CORNERS = VIEW.project(0.276 * np.column_stack([SIZE.corners, np.zeros(4)]))


def cover(corners: np.ndarray) -> np.ndarray:
    """Return by how much a quadrangle covers each pixel (h, w, 1)."""
    fine = 8
    mask = np.zeros((VIEW.height * fine, VIEW.width * fine), np.uint8)
    cv2.fillConvexPoly(mask, np.rint(fine * (corners + 0.5) - 0.5).astype(int), 1)
    shares = mask.reshape(VIEW.height, fine, VIEW.width, fine).mean(axis=(1, 3))
    return shares[..., None]


def taken(light: np.ndarray) -> np.ndarray:
    """Return a picture of levels (h, w, 1), with the blur and the noise of a median."""
    blurred = cv2.GaussianBlur(np.repeat(light, 3, axis=2), (0, 0), 0.8)
    noise = np.random.default_rng(2).normal(0.0, 0.5, blurred.shape)
    return np.clip(np.rint(blurred + noise), 0, 255).astype(np.uint8)


def test_a_board_on_a_table_that_is_darker_on_one_side_and_brighter_on_the_other() -> None:
    table = np.broadcast_to(np.linspace(0.0, 220.0, VIEW.width)[None, :, None], (VIEW.height, VIEW.width, 1))
    picture = taken(table + cover(CORNERS) * (110.0 - table))
    with pytest.raises(IrtError):
        find_corners_at_levels(picture, LENS, SIZE)
    found, words, _ = board_outline([picture] * 2, LENS, SIZE)
    assert "lines" in words
    assert np.linalg.norm(found - CORNERS, axis=1).max() < 1.5


def test_lines_of_the_shadow_are_no_sides() -> None:
    """Two sides of a black board under glare and two of its shadow were taken for the board."""
    down, right = np.mgrid[: VIEW.height, : VIEW.width]
    near = np.exp(-(((right - CORNERS[3, 0]) / 120.0) ** 2) - ((down - CORNERS[3, 1]) / 120.0) ** 2)
    board = 40.0 + 60.0 * near[..., None]
    light = np.full((VIEW.height, VIEW.width, 1), 100.0)
    aside = np.array([-22.0, -26.0])
    light = light + cover(CORNERS + aside) * (40.0 - light)
    light = light + cover(CORNERS) * (board - light)
    try:
        found = corners_by_lines(taken(light), LENS, SIZE)
    except IrtError:
        return
    assert np.linalg.norm(found - CORNERS, axis=1).max() < 3.0


def test_without_a_lens_no_shape_is_known() -> None:
    table = np.full((VIEW.height, VIEW.width, 1), 60.0)
    with pytest.raises(IrtError, match="no four lines"):
        corners_by_lines(taken(table + cover(CORNERS) * 100.0), None, SIZE)
