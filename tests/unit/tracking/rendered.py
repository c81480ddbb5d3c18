"""A board and a marble drawn flat: each pixel by how much of it they cover."""

from __future__ import annotations

from functools import cache

import numpy as np

HEIGHT, WIDTH = 180, 240
CORNERS = np.array([[30.3, 20.7], [208.6, 24.2], [205.1, 160.4], [33.8, 157.9]])
RADIUS = 6.5
# Blue, green, red.
GROUND, BOARD, MARBLE = (25, 25, 25), (125, 175, 210), (220, 50, 30)
FINE = 8


@cache
def board() -> np.ndarray:
    """Return the empty board without noise."""
    down, right = (np.mgrid[: HEIGHT * FINE, : WIDTH * FINE] + 0.5) / FINE - 0.5
    inside = np.ones_like(down, dtype=bool)
    for one, other in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        way = other - one
        inside &= way[0] * (down - one[1]) - way[1] * (right - one[0]) > 0
    cover = inside.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3))[..., None]
    return cover * np.array(BOARD) + (1 - cover) * np.array(GROUND)


def rendered(
    *marbles: tuple[float, float], noise: float = 3.0, seed: int = 0, colour: tuple[int, ...] = MARBLE
) -> np.ndarray:
    """Draw the board and marbles, blue first."""
    picture = board().copy()
    for x, y in marbles:
        left, top = int(x) - 12, int(y) - 12
        down, right = (np.mgrid[: 25 * FINE, : 25 * FINE] + 0.5) / FINE - 0.5
        cover = np.hypot(right + left - x, down + top - y) < RADIUS
        part = cover.reshape(25, FINE, 25, FINE).mean(axis=(1, 3))[..., None]
        there = picture[top : top + 25, left : left + 25]
        there += part * (np.array(colour) - there)
    picture += noise * np.random.default_rng(seed).normal(size=picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def path(count: int, seed: int = 1) -> np.ndarray:
    """Return places (count, 2) [pixels] of a marble that rolls about within the board."""
    random = np.random.default_rng(seed)
    phase = 2 * np.pi * (np.arange(count)[:, None] / 60.0 * random.uniform(0.4, 1.1, 2) + random.random(2))
    return np.array([119.0, 90.0]) + np.array([70.0, 50.0]) * np.sin(phase)
