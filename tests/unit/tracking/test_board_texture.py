"""What is on a board gives its tilt, planted in ray-traced pictures."""

from __future__ import annotations

import numpy as np
import pytest

from irt.tracking.board_texture import BoardTexture
from irt.tracking.geometry import Lens, Pose, Size
from tracking.board import Paint
from tracking.scene import Look, Scene
from tracking.view import View, turned

pytestmark = pytest.mark.slow

SIZE = Size(1.0, 231 / 276, 6.85 / 276)
VIEW = View.above(330.0, lean=(0.1, -0.12), lens=(-0.05, 0.0))
COUNT = 16
FIRST = np.array([0.01, -0.008])


@pytest.fixture(scope="module")
def shown() -> tuple[np.ndarray, list[np.ndarray]]:
    """Return tilts (n, 2) [rad] and pictures of them."""
    phase = 2 * np.pi * np.arange(COUNT) / COUNT
    tilts = FIRST + 0.025 * np.column_stack([np.sin(phase), np.sin(2 * phase)])
    places = 0.2 * np.column_stack([np.cos(phase), np.sin(phase)])
    scene = Scene(VIEW, Paint(lines=3, holes=6), Look("blue"), places, tilts, seed=3)
    return tilts, [picture for picture, _ in scene.frames()]


@pytest.fixture(scope="module")
def level() -> Pose:
    """Return the board's pose in the first picture."""
    lens = Lens(VIEW.matrix, VIEW.distortion, (VIEW.width, VIEW.height), 0.1)
    corners = np.column_stack([SIZE.corners * 0.276, np.zeros(4)]) @ turned(FIRST).T
    return Pose.of(lens, VIEW.project(corners), SIZE.corners, SIZE.radius)


@pytest.fixture(scope="module")
def texture(shown, level) -> BoardTexture:
    return BoardTexture(shown[1], level, SIZE)


def test_tilt_of_each_picture_is_measured_from_the_first(shown, texture: BoardTexture) -> None:
    assert texture.shows
    for tilt, picture in zip(*shown, strict=True):
        found = texture.follow(picture)
        assert isinstance(found, Pose)
        normal = VIEW.rotation @ turned(tilt)[:, 2]
        assert np.arccos(np.clip(found.rotation[:, 2] @ normal, -1.0, 1.0)) < 0.004


def test_light_that_halves_on_a_part_of_the_board_is_no_tilt(shown, level, texture: BoardTexture) -> None:
    picture = shown[1][0].copy()
    before, dim = texture.follow(picture), picture.copy()
    dim[:, : VIEW.width // 2] //= 2
    after = texture.follow(dim)
    assert isinstance(before, Pose)
    assert isinstance(after, Pose)
    assert np.abs(after.tilt_from(level) - before.tilt_from(level)).max() < 0.002


def test_a_covered_board_says_nothing(shown, texture: BoardTexture) -> None:
    missed = texture.missed
    covered = np.random.default_rng(0).integers(0, 255, shown[1][0].shape).astype(np.uint8)
    assert texture.follow(covered) is None
    assert texture.missed == missed + 1


def test_noise_is_no_texture(level) -> None:
    random = np.random.default_rng(1)
    plain = [
        np.clip(150 + 4 * random.standard_normal((480, 640, 3)), 0, 255).astype(np.uint8) for _ in range(8)
    ]
    assert not BoardTexture(plain, level, SIZE).shows
