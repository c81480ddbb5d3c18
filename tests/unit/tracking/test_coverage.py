"""A planted disc is found by what it covers, beside a shadow as large that touches it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from irt.tracking.coverage import WRONG, Coverage

SIDE, RADIUS, NOISE, FINE = 61, 8.0, 2.0, 2
BOARD = np.array([90.0, 130.0, 165.0])
#: The marble's middle, and the shadow's, from that of the views [pixels].
MARBLE, SHADOW = np.array([-1.5, 2.0]), np.array([2.0, -1.0])
COLOURS = {"painted": np.array([60.0, 50.0, 190.0]), "as the board": 0.8 * BOARD, "steel": 0.5 * BOARD.mean()}


def views(colour: np.ndarray, grain: float, uneven: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return pictures and boards (v, n, n, 3), `FINE` cells to a pixel.

    `uneven` is by what share the lamp's light differs from place to place (standard deviation). In the
    marble's shadow there is none of it.
    """
    half = SIDE // 2
    down, right = np.mgrid[-half : half + 1, -half : half + 1] / FINE

    def disc(middle: np.ndarray) -> np.ndarray:
        return np.clip(RADIUS - np.hypot(right - middle[0], down - middle[1]) + 0.5, 0.0, 1.0)[..., None]

    pictures, boards = [], []
    for seed in range(30):
        random = np.random.default_rng(seed)
        texture = gaussian_filter(random.standard_normal((SIDE, SIDE)), 3.0)
        board = BOARD * np.exp(grain * texture / texture.std())[..., None]
        light = np.exp(uneven * random.standard_normal())
        shaded = board * (light * (1.0 - disc(SHADOW)) + 0.5 * disc(SHADOW))
        seen = shaded + disc(MARBLE) * (light * colour - shaded)
        pictures.append(seen + random.normal(0, NOISE, seen.shape))
        boards.append(light * board + random.normal(0, 0.3, seen.shape))
    return np.array(pictures, np.float32), np.array(boards, np.float32)


@pytest.mark.parametrize("colour", COLOURS.values(), ids=COLOURS)
def test_a_marble_is_found_beside_its_shadow(colour: np.ndarray) -> None:
    found = Coverage.of(*views(colour, 0.1), NOISE, FINE).laid(RADIUS)
    assert np.hypot(found.x - MARBLE[0], found.y - MARBLE[1]) < 0.1 * RADIUS


def test_hue_alone_is_enough() -> None:
    found = Coverage.of(*views(COLOURS["painted"], 0.0), NOISE, FINE).laid(RADIUS)
    assert np.hypot(found.x - MARBLE[0], found.y - MARBLE[1]) < 0.1 * RADIUS


def test_a_known_radius_is_kept_where_rims_are_not_the_marbles() -> None:
    coverage = Coverage.of(*views(COLOURS["steel"], 0.1), NOISE, FINE)
    assert coverage.sized(0.7 * RADIUS, RADIUS).radius == RADIUS


@pytest.mark.parametrize("wrong", [1.0 / 1.5, 1.5])
def test_sizes_of_another_marble_are_not_believed(wrong: float) -> None:
    coverage = Coverage.of(*views(COLOURS["painted"], 0.1), NOISE, FINE)
    assert abs(np.log(wrong)) > WRONG
    assert coverage.sized(RADIUS, wrong * RADIUS).radius == RADIUS


def test_the_horizon_in_a_mirroring_marble_is_no_smaller_marble() -> None:
    """Towards its rim steel on a bare board shows the board, a little darker; the horizon is a rim inside."""
    half = SIDE // 2
    down, right = np.mgrid[-half : half + 1, -half : half + 1] / FINE
    away = np.hypot(right - MARBLE[0], down - MARBLE[1])
    seen = np.where(np.hypot(right - SHADOW[0], down - SHADOW[1]) < RADIUS, 0.7, 1.0)
    seen = np.where(away < RADIUS, 0.8, seen)
    seen = np.where(away < 0.7 * RADIUS, 0.4, seen)[..., None] * BOARD
    random = np.random.default_rng(1)
    pictures, boards = (
        (one + random.normal(0, scatter, (30, SIDE, SIDE, 3))).astype(np.float32)
        for one, scatter in ((seen, NOISE), (BOARD, 0.3))
    )
    coverage = Coverage.of(pictures, boards, NOISE, FINE)
    assert coverage.sized(0.7 * RADIUS, RADIUS).radius == RADIUS


def test_light_that_differs_over_a_bare_board_is_no_texture() -> None:
    """What has an even light, the shadow, counted as covered, and the ball, whose light differs, as clear."""
    pale = np.array([105.0, 130.0, 140.0])
    found = Coverage.of(*views(pale, 0.004, 0.15), NOISE, FINE).laid(RADIUS)
    assert np.hypot(found.x - MARBLE[0], found.y - MARBLE[1]) < 0.15 * RADIUS
