"""A ball painted like its board is found by its shading and its shadow."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from irt.tracking.appearance import FINE
from irt.tracking.coverage import Laid
from irt.tracking.shading import ball_and_shadow, ball_by_shading, thrown

RADIUS, HALF, SAMPLES = 8.0, 25, 4
WOOD = np.array([0.16, 0.31, 0.47])
MIDDLE = np.array([-0.7, 0.5])
LAMP = np.array([0.5, -0.4, 0.77]) / np.linalg.norm([0.5, -0.4, 0.77])
FOOT = (0.15, -0.1)


def rendered(
    surface: str, middle: np.ndarray = MIDDLE, half: int = HALF, fine: float = FINE, lamp: np.ndarray = LAMP
) -> tuple[np.ndarray, np.ndarray]:
    """Return light with and without a ball (n, n, 3), to 255, `fine` samples to a pixel."""
    side = (2 * half + 1) * SAMPLES
    grid = ((np.arange(side) + 0.5) / SAMPLES - 0.5 - half) / fine
    right, down = np.meshgrid(grid, grid)
    u, v = (right - middle[0]) / RADIUS, (down - middle[1]) / RADIUS
    away = np.hypot(u, v)
    up = np.sqrt(np.maximum(1.0 - away**2, 0.0))
    # The shadow of a ball: rays towards the lamp that pass its middle, a radius above its foot, closely.
    x, y = u - FOOT[0], v - FOOT[1]
    along = -x * lamp[0] - y * lamp[1] + lamp[2]
    aside = np.sqrt(np.maximum(x**2 + y**2 + 1.0 - along**2, 0.0))
    shadow = np.clip((1.0 - aside) / (0.15 * np.maximum(along, 0.1)) + 0.5, 0.0, 1.0) * (along > 0.0)
    board = (0.95 - 0.6 * shadow - 0.1 / (1.0 + away**2) ** 2)[..., None] * WOOD
    facing = np.maximum(u * lamp[0] + v * lamp[1] + up * lamp[2], 0.0)
    matt = (0.25 * (1.0 + 0.5 * up) + 0.75 * facing)[..., None] * 1.1 * WOOD
    matt[np.hypot(u - 0.25, v + 0.2) < 0.12] = 0.9
    mirror = np.where((np.sin(7.0 * u) * np.sin(6.0 * v) > 0.0)[..., None], 0.6, 0.08) * np.ones(3)
    ball = {"matt": matt, "mirror": mirror}[surface]
    light = cv2.GaussianBlur(
        np.where((away < 1.0)[..., None], ball, board), (0, 0), 0.75 * fine * SAMPLES
    ).reshape(2 * half + 1, SAMPLES, 2 * half + 1, SAMPLES, 3).mean(axis=(1, 3))  # fmt: skip
    random = np.random.default_rng(2)
    noisy = 255.0 * light + random.normal(0.0, 0.5, light.shape)
    return noisy.astype(np.float32), np.full(light.shape, 255.0 * WOOD, np.float32)


@pytest.mark.parametrize("covered", [(0.4, 0.3), (-0.9, 1.1)])
def test_a_matt_ball_is_found_where_it_is(covered: tuple[float, float]) -> None:
    light, board = rendered("matt")
    found = ball_by_shading(light, board, Laid(*(MIDDLE + covered), RADIUS, 0.0), FOOT)
    assert np.hypot(found.x - MIDDLE[0], found.y - MIDDLE[1]) < 0.06 * RADIUS
    assert found.matt


@pytest.mark.parametrize("exposure", [1.0, 0.4])
@pytest.mark.parametrize("surface", ["matt", "mirror"])
def test_what_mirrors_is_not_matt_in_less_light_either(surface: str, exposure: float) -> None:
    light, board = (exposure * one for one in rendered(surface))
    ball = ball_by_shading(light, board, Laid(*MIDDLE, RADIUS, 0.0), FOOT)
    assert ball.matt == (surface == "matt")


LOW = np.array([0.6, -0.5, 0.62]) / np.linalg.norm([0.6, -0.5, 0.62])
#: Beside its foot a low lamp's shadow lies so far from the ball [radii].
SHADOW = FOOT - LOW[:2] / LOW[2]


FINE_ENOUGH = 0.75


def seen(found: str, off: tuple[float, float] = (0.0, 0.0)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a picture with ball or shadow about the middle, the board, and the place of the ball [radii]."""
    ball = np.array(off) - (SHADOW if found == "shadow" else 0.0)
    return *rendered("matt", RADIUS * ball, 22, FINE_ENOUGH, LOW), ball


@pytest.mark.parametrize("off", [(0.0, 0.0), (0.2, -0.25)])
@pytest.mark.parametrize("found", ["shadow", "ball"])
def test_what_is_in_the_middle_is_found(found: str, off: tuple[float, float]) -> None:
    light, board, ball = seen(found, off)
    laid = ball_and_shadow(light, board, RADIUS * FINE_ENOUGH, FOOT)
    assert laid.ball == pytest.approx(tuple(ball), abs=0.25)
    assert (laid.shadow > 0.8) if found == "shadow" else (laid.shadow < 0.2)
    assert laid.apart > 0.5


def levels(light: np.ndarray) -> np.ndarray:
    return (255.0 * (np.maximum(light, 0.0) / 255.0) ** (1.0 / 2.2)).astype(np.float32)


def test_the_end_of_the_board_in_other_places_of_other_views_does_not_matter() -> None:
    """A marble that rolls along a side: its median picture has the board's end where the median board has
    none."""
    light, board, ball = seen("shadow")
    pictures, boards = [], []
    for end in (2, 5, 8, 11, 14):
        picture, ground = levels(light), levels(board)
        picture[:, :end] *= 0.3
        ground[:, : max(end - 4, 0)] *= 0.3
        ground[:, max(end - 4, 0) : end] = picture[:, max(end - 4, 0) : end]
        pictures.append(picture)
        boards.append(ground)
    laid = thrown(np.array(pictures), np.array(boards), RADIUS * FINE_ENOUGH, FOOT)
    assert laid.ball == pytest.approx(tuple(ball), abs=0.2)
    assert laid.shadow > 0.8
