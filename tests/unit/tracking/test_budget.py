"""The error budget: planted errors move places by as much as it says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from irt.tracking.budget import RADIUS, error_budget
from irt.tracking.geometry import Lens, Plane, Pose, Size
from tracking.view import View

SIZE = Size(1.0, 231 / 276, 6.85 / 276)
VIEW = View.above(330.0, lean=(0.2, -0.15))
EDGE_MM = 276.0
TILT_NOISE = np.array([0.002, 0.001])


@pytest.fixture
def pose() -> Pose:
    lens = Lens(VIEW.matrix, VIEW.distortion, (640, 480), 0.2)
    seen = VIEW.project(np.column_stack([SIZE.corners * 0.276, np.zeros(4)]))
    return Pose.of(lens, seen, SIZE.corners, SIZE.radius)


def scene(geometry, apart: float = 0.5, error: float = 0.0) -> SimpleNamespace:
    appearance = SimpleNamespace(apart=apart, radius=8.0, error=error)
    learned = SimpleNamespace(appearance=appearance)
    return SimpleNamespace(size=SIZE, geometry=geometry, learned=learned, tilt_noise=TILT_NOISE)


def grid() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-0.45, 0.45, 10), np.linspace(-0.37, 0.37, 10))
    return np.column_stack([x.ravel(), y.ravel()])


def test_a_wrong_radius_moves_places_by_what_is_said(pose: Pose) -> None:
    found = error_budget(scene(pose), 0.1, 0.0, EDGE_MM, 330.0)
    wrong = Pose(pose.lens, pose.rotation, pose.origin, (1.0 + RADIUS) * SIZE.radius)
    moved = wrong.positions(pose.pixels(grid())) - grid()
    assert found.height == pytest.approx(EDGE_MM * np.sqrt((moved**2).sum(axis=1).mean()), rel=0.2)


def test_a_wrong_tilt_moves_places_by_what_is_said(pose: Pose) -> None:
    found = error_budget(scene(pose), 0.1, 0.0, EDGE_MM, 330.0)
    squares = []
    for axis, noise in enumerate(TILT_NOISE):
        vector = noise * np.eye(3)[axis]
        cross = np.array([[0, -vector[2], vector[1]], [vector[2], 0, -vector[0]], [-vector[1], vector[0], 0]])
        turned = Pose(pose.lens, pose.rotation @ (np.eye(3) + cross), pose.origin, SIZE.radius)
        squares.append(((turned.positions(pose.pixels(grid())) - grid()) ** 2).sum(axis=1).mean())
    assert found.tilt == pytest.approx(EDGE_MM * np.sqrt(np.sum(squares)), rel=0.3)


def test_parts_add_up_and_unknown_ones_are_named(pose: Pose) -> None:
    still = scene(pose, apart=1.5)
    still.tilt_noise = None
    found = error_budget(still, 0.1, 0.001, EDGE_MM, 330.0)
    assert found.marble == pytest.approx(1.5 * EDGE_MM / 330.0)
    assert found.unknown == ("tilt",)
    assert next(iter(found.parts)) == "marble"
    assert found.total == pytest.approx(np.sqrt(sum(one**2 for one in found.parts.values())))
    assert replace(found, noise=1.0).total > found.total


def test_rims_are_believed_until_what_is_covered_disagrees(pose: Pose) -> None:
    near, nearer = (error_budget(scene(pose, apart), 0.1, 0.0, EDGE_MM, 330.0).marble for apart in (0.9, 0.1))
    assert near == nearer
    assert error_budget(scene(pose, 1.3), 0.1, 0.0, EDGE_MM, 330.0).marble > 2.0 * near


def test_without_a_lens_height_is_a_guess_and_lens_and_tilt_are_unknown() -> None:
    plane = Plane.of(VIEW.project(np.column_stack([SIZE.corners * 0.276, np.zeros(4)])), SIZE)
    found = error_budget(scene(plane), 0.1, 0.0, EDGE_MM, 330.0)
    assert found.unknown == ("lens", "tilt")
    assert found.height == pytest.approx(EDGE_MM * 0.01 * np.sqrt((grid() ** 2).sum(axis=1).mean()), rel=0.3)


def test_a_marble_that_only_its_shape_shows_is_less_certain(pose: Pose) -> None:
    found = error_budget(scene(pose, apart=0.5, error=0.8), 0.1, 0.0, EDGE_MM, 330.0)
    assert found.marble == pytest.approx(EDGE_MM * 0.8 / 330.0)
