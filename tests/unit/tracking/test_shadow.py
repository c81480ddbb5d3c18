"""A shadow lets the board's texture be seen, a marble hides it: planted discs are distinguished."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from irt.tracking.shadow import Neighbourhood, transmission

SIDE, RADIUS = 80, 8.0


def view(seed: int, grain: float, shadow: tuple[float, float], marble: tuple[float, float]) -> Neighbourhood:
    """Return a shadow in the middle and a marble of the board's colour, at offsets [radii]."""
    random = np.random.default_rng(seed)
    noise = gaussian_filter(random.standard_normal((SIDE, SIDE)), 2.0)
    light = 0.3 * np.exp(grain * noise / noise.std())[..., None] * np.array([0.4, 0.7, 1.0])
    down, right = np.mgrid[:SIDE, :SIDE]
    middle = (SIDE - 1) / 2

    def disc(place: tuple[float, float]) -> np.ndarray:
        away = np.hypot(right - middle - place[0] * RADIUS, down - middle - place[1] * RADIUS)
        return np.clip(RADIUS - away + 0.5, 0.0, 1.0)[..., None]

    seen = light * (1.0 - 0.6 * disc(shadow))
    seen = seen + disc(marble) * (0.3 * np.array([0.4, 0.7, 1.0]) - seen)
    levels = [
        255.0 * (1.055 * one ** (1 / 2.4) - 0.055) + random.normal(size=one.shape) for one in (seen, light)
    ]
    picture, board = (one.astype(np.float32) for one in levels)
    return Neighbourhood(picture, board, middle, middle, RADIUS)


FAR = (50.0, 0.0)


def test_a_shadow_is_one_and_the_marble_beside_it_is_found() -> None:
    through = transmission([view(seed, 0.2, (0.0, 0.0), (1.7, -0.8)) for seed in range(20)])
    assert through.middle == pytest.approx(1.0, abs=0.15)
    assert through.chance_of_shadow > 0.999
    assert through.opaque() == pytest.approx((1.7, -0.8), abs=0.35)


def test_a_marble_is_no_shadow() -> None:
    through = transmission([view(seed, 0.2, (-1.7, 0.8), (0.0, 0.0)) for seed in range(20)])
    assert through.middle == pytest.approx(0.0, abs=0.15)
    assert through.chance_of_shadow < 0.001


def test_a_shadow_alone_has_nothing_opaque_beside_it() -> None:
    through = transmission([view(seed, 0.2, (0.0, 0.0), FAR) for seed in range(20)])
    assert through.chance_of_shadow > 0.999
    assert through.opaque() is None


@pytest.mark.parametrize(("shadow", "marble"), [((0.0, 0.0), FAR), ((1.7, -0.8), (0.0, 0.0))])
def test_a_board_without_texture_says_nothing(
    shadow: tuple[float, float], marble: tuple[float, float]
) -> None:
    """Noise in the board's median was taken for a texture that neither shadow nor marble lets through."""
    through = transmission([view(seed, 0.0, shadow, marble) for seed in range(20)])
    assert through.opaque() is None
    assert through.chance_of_shadow == 0.5


@pytest.mark.parametrize(("levels", "chance"), [((40, 40, 180), 0.0), ((60, 80, 100), 0.5)])
def test_a_bare_board_without_noise_says_nothing_but_by_the_hue(
    levels: tuple[int, ...], chance: float
) -> None:
    board = np.full((SIDE, SIDE, 3), (120, 160, 200), np.float32)
    down, right = np.mgrid[:SIDE, :SIDE]
    picture = board.copy()
    picture[np.hypot(right - 40, down - 40) < RADIUS] = levels
    through = transmission([Neighbourhood(picture, board, 40.0, 40.0, RADIUS)] * 5)
    assert through.chance_of_shadow == pytest.approx(chance, abs=0.05)
    assert through.opaque() is None
