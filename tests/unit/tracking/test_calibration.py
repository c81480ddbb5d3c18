"""A lens planted in rendered views of a pattern is recovered, and kept in a file."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from irt.errors import IrtError
from irt.tracking.calibration import Pattern, calibrate, charuco_board, load_lens, save_lens
from irt.tracking.geometry import Lens

MATRIX = np.array([[520.0, 0.0, 322.0], [0.0, 515.0, 236.0], [0.0, 0.0, 1.0]])
BEND = np.array([-0.18, 0.04, 0.0, 0.0, 0.0])
SQUARE = 40


def chessboard() -> tuple[np.ndarray, tuple[float, float]]:
    down, right = np.mgrid[: 7 * SQUARE, : 10 * SQUARE]
    board = np.where((down // SQUARE + right // SQUARE) % 2 == 0, 20, 230).astype(np.uint8)
    return cv2.copyMakeBorder(board, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=230), (10.0, 7.0)


def charuco() -> tuple[np.ndarray, tuple[float, float]]:
    board = charuco_board(Pattern(7, 5, True)).generateImage((7 * SQUARE, 5 * SQUARE), marginSize=0)
    return cv2.copyMakeBorder(board, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255), (7.0, 5.0)


def views(sheet: np.ndarray, squares: tuple[float, float], count: int) -> list[np.ndarray]:
    """Return pictures of a flat sheet held at different slants before the lens."""
    random = np.random.default_rng(3)
    down, right = np.mgrid[:480, :640].astype(np.float64)
    rays = cv2.undistortPoints(
        np.stack([right.ravel(), down.ravel()], axis=1)[:, None], MATRIX, BEND
    ).reshape(-1, 2)
    pictures = []
    for _ in range(count):
        turns = random.uniform(-0.45, 0.45, 3) * [1, 1, 0.4]
        rotation, _ = cv2.Rodrigues(turns)
        middle = np.array([*random.uniform(-1.5, 1.5, 2), random.uniform(10.0, 13.0)])
        rays3 = np.column_stack([rays, np.ones(len(rays))])
        far = (rotation[:, 2] @ middle) / (rays3 @ rotation[:, 2])
        place = (rays3 * far[:, None] - middle) @ rotation[:, :2] + np.array(squares) / 2
        spots = (place * SQUARE + 40 - 0.5).astype(np.float32).reshape(480, 640, 2)
        picture = cv2.remap(
            cv2.GaussianBlur(sheet, (3, 3), 0.8), spots, None, cv2.INTER_LINEAR, borderValue=120
        )
        noisy = picture + random.normal(0, 2.0, picture.shape)
        pictures.append(cv2.cvtColor(np.clip(noisy, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR))
    return pictures


def silent(*_: object) -> None:
    pass


@pytest.mark.parametrize(
    ("sheet", "pattern"), [(chessboard, Pattern()), (charuco, Pattern(7, 5, True))], ids=["chess", "charuco"]
)
def test_lens_is_recovered(sheet, pattern, tmp_path) -> None:
    lens, count = calibrate(views(*sheet(), 12), pattern, silent)
    assert count >= 8
    assert lens.error_px < 0.5
    np.testing.assert_allclose(lens.matrix[[0, 1], [0, 1]], MATRIX[[0, 1], [0, 1]], rtol=0.015)
    grid = np.array([[60.0, 50.0], [320.0, 240.0], [600.0, 430.0]])
    truth = Lens(MATRIX, BEND, (640, 480), 0.0)
    np.testing.assert_allclose(lens.straight(grid), truth.straight(grid), atol=0.012)
    save_lens(tmp_path / "camera.toml", lens, count)
    again = load_lens(tmp_path / "camera.toml")
    np.testing.assert_array_equal(again.matrix, lens.matrix)
    assert again.size == (640, 480)


def test_too_few_views_are_said() -> None:
    blank = [np.full((480, 640, 3), 90, np.uint8)] * 6
    with pytest.raises(IrtError, match="0 of 6 pictures show a chessboard of 9 x 6"):
        calibrate(blank, Pattern(), silent)


def test_a_broken_file_is_said(tmp_path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text("[camera]\nwidth = 640\nheight = 480\nmatrix = [1, 2]\n")
    with pytest.raises(IrtError, match="matrix: expected 4 numbers"):
        load_lens(path)
