"""The detector, on pictures drawn here: corners, sub-pixel places, and what is no marble."""

from __future__ import annotations

import numpy as np
import pytest

from irt.errors import IrtError
from irt.tracking import Tracker, find_corners, find_marble, positions

HEIGHT, WIDTH = 180, 240
CORNERS = np.array([[30.3, 20.7], [208.6, 24.2], [205.1, 160.4], [33.8, 157.9]])
RADIUS = 5.0
EMPTY_GROUND, BOARD, MARBLE = (25, 25, 25), (210, 175, 125), (30, 50, 220)


def drawn(marble: tuple[float, float] | None, noise: float = 3.0, seed: int = 0) -> np.ndarray:
    """Draw the board and a marble, each pixel by how much of it they cover."""
    fine = 8
    down, right = (np.mgrid[: HEIGHT * fine, : WIDTH * fine] + 0.5) / fine - 0.5
    inside = np.ones_like(down, dtype=bool)
    for one, other in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        way = other - one
        inside &= way[0] * (down - one[1]) - way[1] * (right - one[0]) > 0
    picture = np.where(inside[..., None], BOARD, EMPTY_GROUND).astype(float)
    if marble is not None:
        picture[np.hypot(right - marble[0], down - marble[1]) < RADIUS] = MARBLE
    picture = picture.reshape(HEIGHT, fine, WIDTH, fine, 3).mean(axis=(1, 3))
    picture += noise * np.random.default_rng(seed).normal(size=picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def empty() -> np.ndarray:
    return drawn(None)


def test_corners_are_found_to_a_tenth_of_a_pixel(empty: np.ndarray) -> None:
    np.testing.assert_allclose(find_corners(empty), CORNERS, atol=0.1)


@pytest.mark.parametrize("place", [(120.0, 90.0), (80.37, 60.81), (170.6, 130.25), (37.5, 100.4)])
def test_marble_is_found_to_a_tenth_of_a_pixel(empty: np.ndarray, place: tuple[float, float]) -> None:
    np.testing.assert_allclose(find_marble(drawn(place, seed=1), empty, RADIUS), place, atol=0.1)


def test_nothing_is_found_where_there_is_no_marble(empty: np.ndarray) -> None:
    assert np.isnan(find_marble(drawn(None, seed=2), empty, RADIUS)).all()
    hand = drawn(None, seed=3)
    hand[60:140, 60:120] = 90
    assert np.isnan(find_marble(hand, empty, RADIUS)).all()


def test_positions_are_in_board_edges(empty: np.ndarray) -> None:
    """The middle of the board is where its diagonals cross, whatever the perspective; y is up."""
    (a, b, c, d) = CORNERS
    part = np.linalg.solve(np.stack([c - a, b - d], axis=1), b - a)[0]
    middle = a + part * (c - a)
    near_top = tuple(middle + 0.5 * (0.5 * (a + b) - middle))
    pictures = [drawn(tuple(middle), seed=4), drawn(near_top, seed=5), drawn(None, seed=6)]
    seen = positions(empty, empty, pictures, (1.0, 0.8), RADIUS / 178)
    assert seen.shape == (3, 2)
    np.testing.assert_allclose(seen[0], 0.0, atol=1e-3)
    assert 0.15 < seen[1, 1] < 0.25
    assert np.isnan(seen[2]).all()


def test_light_that_changed_is_met_by_another_empty_picture(empty: np.ndarray) -> None:
    tracker = Tracker.calibrated(empty, (1.0, 0.8), RADIUS / 178)
    dim = np.rint(0.6 * empty).astype(np.uint8)
    picture = np.rint(0.6 * drawn((120.0, 90.0), seed=7)).astype(np.uint8)
    before, after = (one.read([picture])[0] for one in (tracker, tracker.against(dim)))
    assert not np.isnan(after).any()
    assert np.isnan(before).any() or np.abs(before - after).max() < 0.05


def test_no_board_is_said() -> None:
    with pytest.raises(IrtError, match=r"no board in the picture|corners: all four|not clear"):
        find_corners(np.full((HEIGHT, WIDTH, 3), 30, dtype=np.uint8))
