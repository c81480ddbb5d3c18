"""The board's sides give its corners and its tilt, planted in ray-traced pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from irt.tracking.board_edges import BoardEdges
from irt.tracking.corners import find_corners, ordered
from irt.tracking.geometry import Lens, Plane, Pose, Size
from tracking.board import Paint
from tracking.scene import Look, Scene
from tracking.view import View, turned

pytestmark = pytest.mark.slow

SIZE = Size(1.0, 231 / 276, 6.85 / 276)
VIEW = View.above(330.0, lean=(0.1, -0.12), lens=(-0.05, 0.0))
COUNT = 24


@pytest.fixture(scope="module")
def shown() -> tuple[np.ndarray, list[np.ndarray]]:
    """Return tilts about zero (n, 2) [rad] and pictures of them."""
    phase = 2 * np.pi * np.arange(COUNT) / COUNT
    tilts = 0.025 * np.column_stack([np.sin(phase), np.cos(2 * phase)])
    places = 0.2 * np.column_stack([np.cos(phase), np.sin(phase)])
    scene = Scene(VIEW, Paint(lines=2, holes=3), Look("blue"), places, tilts, seed=3)
    return tilts, [picture for picture, _ in scene.frames()]


@pytest.fixture(scope="module")
def lens() -> Lens:
    return Lens(VIEW.matrix, VIEW.distortion, (VIEW.width, VIEW.height), 0.1)


@pytest.fixture(scope="module")
def edges(shown, lens) -> BoardEdges:
    _, pictures = shown
    return BoardEdges(pictures, ordered(find_corners(pictures[0], lens), SIZE), lens)


def test_corners_of_the_mean_board_are_within_what_is_stated(edges: BoardEdges) -> None:
    level = VIEW.project(np.column_stack([SIZE.corners * 0.276, np.zeros(4)]))
    apart = np.linalg.norm(edges.corners - level, axis=1)
    assert edges.error_px < 0.3
    assert apart.max() < 0.3


def test_tilt_of_each_picture_is_measured(shown, edges: BoardEdges, lens) -> None:
    tilts, pictures = shown
    assert edges.watch(Pose.of(lens, edges.corners, SIZE.corners, SIZE.radius), SIZE)
    for tilt, picture in list(zip(tilts, pictures, strict=True))[::3]:
        found = edges.follow(picture)
        assert isinstance(found, Pose)
        normal = VIEW.rotation @ turned(tilt)[:, 2]
        assert np.arccos(np.clip(found.rotation[:, 2] @ normal, -1.0, 1.0)) < 0.004


def test_tilt_is_within_its_stated_noise(shown, edges: BoardEdges, lens) -> None:
    tilts, pictures = shown
    level = Pose.of(lens, edges.corners, SIZE.corners, SIZE.radius)
    assert edges.watch(level, SIZE)
    measured = np.array([edges.follow(picture).tilt_from(level) for picture in pictures])
    missed = measured - tilts
    # Its zero is the mean of the run.
    missed -= missed.mean(axis=0)
    noise = edges.tilt_noise()
    assert noise is not None
    ratio = missed.std(axis=0) / noise
    assert ratio.min() > 0.3
    assert ratio.max() < 2.0
    assert (noise < 0.002).all()


def test_covered_sides_say_nothing(shown, edges: BoardEdges, lens) -> None:
    _, pictures = shown
    assert edges.watch(Pose.of(lens, edges.corners, SIZE.corners, SIZE.radius), SIZE)
    covered = np.full_like(pictures[0], 90)
    assert edges.follow(covered) is None
    assert edges.missed == 1


def test_without_a_lens_the_tilt_is_not_measured(shown) -> None:
    _, pictures = shown
    corners = ordered(find_corners(pictures[0]), SIZE)
    assert not BoardEdges(pictures[:6], corners, None).watch(Plane.of(corners, SIZE), SIZE)


def grey_table(pictures: int, *, broken: bool) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the corners of a board on a table as bright, half in its shadow, and pictures of it."""
    corners = np.array([[80.3, 60.6], [260.4, 70.2], [250.7, 200.4], [70.8, 190.5]])
    fine = 4
    outline = np.rint(16 * ((corners + 0.5) * fine - 0.5)).astype(np.int32)
    light = np.full((260 * fine, 340 * fine, 3), 0.36, np.float32)
    cv2.fillPoly(light, [outline + 16 * 12 * fine], (0.08, 0.08, 0.08), cv2.LINE_AA, 4)
    cv2.fillPoly(light, [outline], (0.16, 0.31, 0.47), cv2.LINE_AA, 4)
    small = cv2.resize(cv2.GaussianBlur(light, (0, 0), 0.7 * fine), (340, 260), interpolation=cv2.INTER_AREA)
    shown = []
    for seed in range(pictures):
        random = np.random.default_rng(seed)
        levels = 255.0 * small ** (1 / 2.2) + random.normal(0, 2.0, small.shape)
        if broken and seed % 3:
            levels[183:215, 80:110] = random.uniform(0, 255, 3)
        shown.append(np.clip(np.rint(levels), 0, 255).astype(np.uint8))
    return corners, shown


@pytest.mark.parametrize("broken", [False, True])
def test_each_side_is_found_in_the_colour_that_shows_it(broken: bool) -> None:
    corners, pictures = grey_table(6, broken=broken)
    found = BoardEdges(
        pictures, corners + np.array([[1.5, -1.0], [-1.0, 1.5], [1.0, 1.0], [-1.5, -1.0]]), None
    )
    assert found.clear
    assert np.linalg.norm(found.corners - corners, axis=1).max() < 0.3
