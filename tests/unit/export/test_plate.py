"""Boxes cover a plate but for its holes, and nothing of the holes."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.export.plate import SIDES, boxes, gaps
from irt.maze import Maze

HALF = np.array([13.8, 11.4])
RADIUS = 0.75
#: The polygon of a hole is as much wider at its corners, and narrower at its sides.
UNROUND = 1.0 / math.cos(math.pi / SIDES) - 1.0


def is_covered(found, x, y):
    """Return whether any box holds each of the points."""
    covered = np.zeros(len(x), dtype=bool)
    for box in found:
        along = (x - box.x) * math.cos(box.turn) + (y - box.y) * math.sin(box.turn)
        across = (y - box.y) * math.cos(box.turn) - (x - box.x) * math.sin(box.turn)
        covered |= (np.abs(along) <= box.half_x + 1e-9) & (np.abs(across) <= box.half_y + 1e-9)
    return covered


def check(holes, seed=0):
    random = np.random.default_rng(seed)
    x, y = random.uniform(-HALF, HALF, (1000, 2)).T
    # Most of what can go wrong does so around holes.
    angle, away = random.uniform(0.0, 2.0 * math.pi, 200), RADIUS * random.uniform(0.0, 2.0, 200)
    for hole in holes:
        x = np.concatenate([x, hole[0] + away * np.cos(angle)])
        y = np.concatenate([y, hole[1] + away * np.sin(angle)])
    on_plate = (np.abs(x) <= HALF[0]) & (np.abs(y) <= HALF[1])
    x, y = x[on_plate], y[on_plate]
    nearest = np.full(len(x), np.inf)
    for hole in holes:
        nearest = np.minimum(nearest, np.hypot(x - hole[0], y - hole[1]) / RADIUS)
    covered = is_covered(boxes(HALF, holes, RADIUS), x, y)
    assert covered[nearest > 1.0 + UNROUND].all()
    assert not covered[nearest < 1.0 - UNROUND].any()


def test_a_plate_without_holes_is_one_box():
    assert boxes(HALF, (), RADIUS) == [(0.0, 0.0, *HALF, 0.0)]


def test_the_layouts_are_covered():
    for name in ("cyberrunner-easy", "cyberrunner-hard"):
        holes = [(100.0 * x, 100.0 * y) for x, y in Maze.of_layout(name).holes]
        check(holes)
        assert gaps(holes, RADIUS) == []


@settings(deadline=None, max_examples=50)
@given(
    st.lists(
        st.tuples(
            st.floats(RADIUS - HALF[0], HALF[0] - RADIUS), st.floats(RADIUS - HALF[1], HALF[1] - RADIUS)
        ),
        max_size=6,
    )
)
def test_any_holes_that_are_apart_are_left_open_and_all_else_is_covered(holes):
    if all(math.dist(one, other) > 2.45 * RADIUS for one, other in itertools.combinations(holes, 2)):
        assert gaps(holes, RADIUS) == []
        check(holes)
