"""A planted disc is found by its rims beside a shadow, and under a mirrored ring."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from irt.tracking.appearance import FINE
from irt.tracking.coverage import Laid
from irt.tracking.rims import POWER, Disc, discs_by_rims

RADIUS, HALF, SAMPLES = 8.0, 25, 4
WOOD = np.array([0.16, 0.31, 0.47])
#: The marble's middle, and that of its shadow, from the middle of the picture [pixels].
MARBLE, SHADOW = np.array([0.6, -0.4]), np.array([6.0, 2.0])
COVERS = Laid(MARBLE[0] + 0.6, MARBLE[1] + 0.3, RADIUS, 0.0)


def steel(part: np.ndarray) -> np.ndarray:
    """Return colours (..., 3) at parts (...) of the radius: a grey room, and the board towards the rim."""
    share = np.clip((part - 0.7) / 0.25, 0.0, 1.0)[..., None]
    return (1 - share) * np.array([0.16, 0.15, 0.15]) + share * 0.7 * WOOD


def paint(part: np.ndarray) -> np.ndarray:
    """Return colours (..., 3) of a blue marble, darker at its rim."""
    return np.array([0.45, 0.10, 0.06]) * (1.0 - 0.4 * part[..., None] ** 2)


def pictures(colour) -> tuple[np.ndarray, np.ndarray]:
    """Return levels of a marble with its shadow, and of the board (n, n, 3), `FINE` samples to a pixel."""
    side = (2 * HALF + 1) * SAMPLES
    grid = ((np.arange(side) + 0.5) / SAMPLES - 0.5 - HALF) / FINE
    right, down = np.meshgrid(grid, grid)
    light = np.ones((side, side, 1)) * WOOD
    light[np.hypot(right - SHADOW[0], down - SHADOW[1]) < RADIUS] *= 0.35
    part = np.hypot(right - MARBLE[0], down - MARBLE[1]) / RADIUS
    light[part < 1.0] = colour(part)[part < 1.0]
    blurred = cv2.GaussianBlur(light, (0, 0), 0.8 * FINE * SAMPLES)
    small = blurred.reshape(2 * HALF + 1, SAMPLES, 2 * HALF + 1, SAMPLES, 3).mean(axis=(1, 3))
    board = np.ones_like(small) * WOOD
    shown, bare = ((255.0 * one ** (1 / POWER)).astype(np.float32) for one in (small, board))
    return shown, bare


def disc(levels: np.ndarray, board: np.ndarray) -> Disc:
    return min(discs_by_rims(levels, board, COVERS, 1.0), key=lambda one: one[0])[1]


def off(levels: np.ndarray, board: np.ndarray) -> float:
    found = disc(levels, board)
    assert found.radius == pytest.approx(RADIUS, rel=0.05)
    return float(np.hypot(found.x - MARBLE[0], found.y - MARBLE[1]))


@pytest.mark.parametrize(("colour", "most"), [(paint, 0.15), (steel, 0.65)], ids=["painted", "steel"])
def test_the_disc_is_the_marbles_and_not_its_shadows(colour, most: float) -> None:
    assert off(*pictures(colour)) < most


def test_what_has_the_boards_hue_says_so() -> None:
    found = disc(*pictures(lambda part: 0.6 * WOOD + 0.0 * part[..., None]))
    assert found.hue < 2.0
    assert disc(*pictures(paint)).hue > 40.0
