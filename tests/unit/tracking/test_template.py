"""A marble's middle is found beside its shadow, and under what it mirrors."""

from __future__ import annotations

import numpy as np
import pytest

from irt.tracking.template import View, learn_appearance

SIDE, RADIUS, NOISE, FINE = 49, 6.5, 3.0, 6
BOARD = np.array([90.0, 130.0, 165.0])
SHADOW = np.array([4.0, 3.0])


def steel(part: np.ndarray) -> np.ndarray:
    """Return colours (..., 3) at parts (...) of the radius: sky in the middle, the board at the rim."""
    share = np.clip((part - 0.55) / 0.2, 0.0, 1.0)[..., None]
    return (1 - share) * np.array([190.0, 175.0, 165.0]) + share * 0.4 * BOARD


def paint(part: np.ndarray) -> np.ndarray:
    """Return colours (..., 3) of a blue marble, darker at its rim."""
    return np.array([200.0, 70.0, 40.0]) * (1.0 - 0.35 * part[..., None] ** 2)


def view(place: np.ndarray, colour, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return picture and board (SIDE, SIDE, 3) of a marble at a place, with a shadow that it touches."""
    random = np.random.default_rng(seed)
    grid = (np.arange(SIDE * FINE) + 0.5) / FINE - 0.5
    right, down = np.meshgrid(grid, grid)
    light = 1.0 + 0.1 * np.sin(right / random.uniform(4, 9) + random.uniform(0, 6))
    board = light[..., None] * BOARD
    away = np.hypot(right - place[0], down - place[1]) / RADIUS
    shadow = np.hypot(right - place[0] - SHADOW[0], down - place[1] - SHADOW[1]) / RADIUS
    dim = 1.0 - 0.5 * np.clip((1.15 - shadow) / 0.3, 0.0, 1.0)
    picture = np.where((away < 1.0)[..., None], colour(away), dim[..., None] * board)
    both = [
        one.reshape(SIDE, FINE, SIDE, FINE, 3).mean(axis=(1, 3)) + random.normal(0, NOISE, (SIDE, SIDE, 3))
        for one in (picture, board)
    ]
    return both[0].astype(np.float32), both[1].astype(np.float32)


@pytest.fixture(scope="module", params=[steel, paint], ids=["steel", "paint"])
def learned(request: pytest.FixtureRequest):
    """Return an appearance learned from rough places, all towards the shadow, and the marble's colours."""
    random = np.random.default_rng(5)
    views = []
    for seed in range(24):
        place = 24.0 + random.uniform(-3, 3, 2)
        rough = place + 0.2 * SHADOW + random.normal(0, 0.3, 2)
        picture, board = view(place, request.param, seed)
        views.append(View(picture, board, float(rough[0]), float(rough[1]), 1.0))
    return learn_appearance(views, 1.1 * RADIUS, RADIUS, NOISE), request.param


def missed(appearance, colour, *, hidden: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much matches miss new marbles (n, 2) [pixels], and their confidences (n,)."""
    random = np.random.default_rng(6)
    errors, sure = [], []
    for seed in range(100, 116):
        place = 24.0 + random.uniform(-3, 3, 2)
        picture, board = view(place, colour, seed)
        if hidden:
            picture[:, : int(place[0] - 1)] = 250.0
        start = place + random.uniform(-1, 1, 2) * (1.0 if hidden else 2.0)
        found = appearance.match(picture, board, (float(start[0]), float(start[1])), 1.0)
        errors.append([found.x - place[0], found.y - place[1]])
        sure.append(found.confidence)
    return np.array(errors), np.array(sure)


def test_middle_is_the_marbles_and_not_its_shadows(learned) -> None:
    appearance, colour = learned
    errors, sure = missed(appearance, colour)
    assert np.linalg.norm(errors.mean(axis=0)) < 0.3
    assert errors.std(axis=0).max() < 0.08
    assert sure.min() > 0.8
    assert appearance.radius == pytest.approx(RADIUS, rel=0.05)


def test_what_lies_before_a_marble_takes_confidence_and_hardly_moves_it(learned) -> None:
    appearance, colour = learned
    whole, _ = missed(appearance, colour)
    errors, sure = missed(appearance, colour, hidden=True)
    assert np.abs(errors - whole.mean(axis=0)).max() < 0.6
    assert sure.min() > 0.3
    assert sure.max() < 0.75


def test_a_board_without_a_marble_has_none(learned) -> None:
    appearance, colour = learned
    _, board = view(np.array([24.0, 24.0]), colour, 300)
    noise = np.random.default_rng(9).normal(0, NOISE, board.shape).astype(np.float32)
    assert appearance.match(board + noise, board, (24.0, 24.0), 1.0).confidence < 0.2


def test_a_marble_of_another_size_is_not_it(learned) -> None:
    appearance, colour = learned
    picture, board = view(np.array([24.3, 23.6]), colour, 400)
    right = appearance.match(picture, board, (24.0, 24.0), 1.0)
    wrong = appearance.match(picture, board, (24.0, 24.0), 1.4)
    assert wrong.confidence < 0.7 * right.confidence


def test_the_error_of_what_mirrors_its_board_is_larger(learned) -> None:
    appearance, colour = learned
    assert appearance.error == pytest.approx(0.1 * RADIUS if colour is steel else 0.0)
