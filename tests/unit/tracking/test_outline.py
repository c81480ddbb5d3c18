"""The outline that is taken for the board is of its shape, and is measured on a large picture, too."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from irt.errors import IrtError
from irt.tracking.board_edges import BoardEdges
from irt.tracking.corners import (
    FAINTEST,
    LEAST_LEVELS,
    MISSHAPEN,
    find_corners,
    least_step,
    like_a_rim,
    misshapen,
)
from irt.tracking.geometry import Lens, Pose, Size
from irt.tracking.nested import AmbiguousBoardError, nested, require_board
from irt.tracking.outline import board_outline, board_sides
from irt.tracking.run import Question, prepare
from tracking.view import View, turned

EDGES = np.array([0.276, 0.231])
SIZE = Size(1.0, 231 / 276, 6.85 / 276)
WHITE, WOOD, TABLE = (225, 225, 225), (90, 150, 200), (40, 40, 40)
RIM_M = 0.010


def outline(view: View, tilt: np.ndarray, beyond: float = 0.0, size: Size = SIZE) -> np.ndarray:
    """Return the corners (4, 2) [pixels] of the board, or of what reaches so far beyond it [m]."""
    flat = size.corners * EDGES[0] + beyond * np.sign(size.corners)
    return view.project(np.column_stack([flat, np.zeros(4)]) @ turned(tilt).T)


def drawn(
    view: View,
    tilt: np.ndarray,
    board: tuple[int, ...],
    rim: tuple[int, ...] | None = None,
    *,
    size: Size = SIZE,
    border: float = 0.0,
    table: tuple[int, ...] = TABLE,
) -> np.ndarray:
    """Draw a board, with a rim about it, and a printed border so far within it [m]."""
    picture = np.full((view.height, view.width, 3), table, np.uint8)
    ways = [(RIM_M, rim), (0.0, board)]
    if border:
        ways += [(-border, TABLE), (-border - 0.0015, board)]
    for beyond, colour in ways:
        if colour is not None:
            corners = outline(view, tilt, beyond, size)
            cv2.fillConvexPoly(picture, np.rint(16 * corners).astype(int), colour, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(picture, (0, 0), 0.7)


def lens_of(view: View) -> Lens:
    return Lens(view.matrix, view.distortion, (view.width, view.height), 0.1)


VIEW = View.above(330.0, lean=(0.1, -0.1))
LEVEL = np.zeros(2)


def test_a_rim_in_the_place_of_the_board_is_refused() -> None:
    pictures = [drawn(VIEW, LEVEL, WOOD, rim=WOOD)] * 2
    source = SimpleNamespace(name="run", sample=lambda _: pictures)
    with pytest.raises(IrtError, match="may be its rim, or its edge: --corners"):
        prepare(source, Question(SIZE, lens_of(VIEW)), lambda *_: None)


def test_of_two_outlines_the_one_of_the_boards_shape_is_taken() -> None:
    """By brightness a white rim is found; by colour, the wood within it."""
    pictures = [drawn(VIEW, LEVEL, WOOD, rim=WHITE)] * 2
    found, words, _ = board_outline(pictures, lens_of(VIEW), SIZE)
    assert "colour" in words
    assert np.linalg.norm(found - outline(VIEW, LEVEL), axis=1).max() < 1.0


def test_sides_of_a_large_board_move_far_and_are_followed() -> None:
    view = View.above(1000.0, focal=1900.0, lean=(0.05, 0.1), size=(1440, 1080))
    phase = 2 * np.pi * np.arange(12) / 12
    tilts = 0.06 * np.column_stack([np.sin(phase), np.cos(phase)])
    pictures = [drawn(view, tilt, WHITE) for tilt in tilts]
    edges = BoardEdges(pictures, outline(view, tilts[0]), lens_of(view))
    assert edges.clear
    # The tilt moves corners by 12 pixels.
    assert np.linalg.norm(edges.corners - outline(view, LEVEL), axis=1).max() < 2.0


def test_a_line_printed_along_the_sides_is_another_step() -> None:
    """Inside was read on the line in some pictures, and the tilt was wrong by 20 mrad."""
    view = View.above(330.0, lean=(0.35, -0.3))
    phase = 2 * np.pi * np.arange(24) / 24
    tilts = 0.025 * np.column_stack([np.sin(phase), np.cos(2 * phase)])
    grey = (140, 140, 140)
    without = [drawn(view, tilt, WHITE, table=grey) for tilt in tilts]
    plain = BoardEdges(without, outline(view, tilts[0]), lens_of(view))
    pictures = [drawn(view, tilt, WHITE, border=0.004, table=grey) for tilt in tilts]
    edges = BoardEdges(pictures, outline(view, tilts[0]), lens_of(view))
    level = Pose.of(lens_of(view), edges.corners, SIZE.corners, SIZE.radius)
    assert np.linalg.norm(edges.corners - plain.corners, axis=1).max() < 0.3
    assert edges.watch(level, SIZE)
    poses = [edges.follow(picture) for picture in pictures]
    measured = np.array([pose.tilt_from(level) for pose in poses if isinstance(pose, Pose)])
    assert len(measured) == len(tilts)
    assert (measured - measured.mean(axis=0) - tilts).std(axis=0).max() < 0.003


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.25, -0.2)])
def test_a_hand_at_first_is_no_part_of_a_board_before_an_unknown_lens(lean: tuple[float, float]) -> None:
    """It moved a corner by 34 pixels, and a marble by 7 mm."""
    view = View.above(330.0, lean=lean)
    pictures = [drawn(view, LEVEL, WHITE) for _ in range(12)]
    corners = outline(view, LEVEL)
    steady, words, _ = board_outline(pictures, None, SIZE)
    assert words == "found in the first picture"
    x, y = corners[2]
    for picture in pictures[:3]:
        cv2.ellipse(picture, (int(x) - 92, int(y) - 66), (140, 45), 20, 0, 360, (120, 150, 210), -1)
    misled = find_corners(pictures[0], None, SIZE)
    assert np.linalg.norm(misled - corners, axis=1).max() > 5.0
    found, words, _ = board_outline(pictures, None, SIZE)
    assert words == "found in the median of the pictures"
    assert np.linalg.norm(found - steady, axis=1).max() < 0.1
    assert np.linalg.norm(found - corners, axis=1).max() < 2.0


def test_a_board_that_is_pushed_aside_does_not_stand() -> None:
    picture = drawn(VIEW, LEVEL, WHITE)
    edges = BoardEdges([picture] * 3, outline(VIEW, LEVEL), lens_of(VIEW))
    assert edges.stand(picture)
    assert not edges.stand(np.roll(picture, (8, 8), axis=(0, 1)))


def test_a_board_beside_a_lit_part_of_the_table_is_found_at_several_levels() -> None:
    """The one level that brightness or colour is divided at separates the lamp's light from all else."""
    picture = drawn(VIEW, LEVEL, (105, 108, 110), table=(80, 82, 84))
    cv2.ellipse(picture, (0, 0), (280, 110), 0, 0, 360, (200, 250, 255), -1)
    for by_colour in (False, True):
        with pytest.raises(IrtError):
            find_corners(picture, lens_of(VIEW), SIZE, by_colour=by_colour)
    found, words, _ = board_outline([picture] * 2, lens_of(VIEW), SIZE)
    assert "levels" in words
    assert np.linalg.norm(found - outline(VIEW, LEVEL), axis=1).max() < 1.5


def test_a_board_is_as_faint_as_its_noise_allows() -> None:
    """A dark board on a dark table was refused: its sides differ from the table by 9 levels."""
    random = np.random.default_rng(5)
    picture = drawn(VIEW, LEVEL, (61, 58, 59), table=(52, 52, 52)).astype(float)

    def sample(noise: float) -> list[np.ndarray]:
        return [
            np.clip(np.rint(picture + random.normal(0.0, noise, picture.shape)), 0, 255).astype(np.uint8)
            for _ in range(12)
        ]

    quiet = sample(1.5)
    assert least_step(quiet) == FAINTEST
    found, _, _ = board_outline(quiet, lens_of(VIEW), SIZE)
    edges = board_sides(quiet, found, lens_of(VIEW))
    plain = BoardEdges([drawn(VIEW, LEVEL, WHITE)] * 3, outline(VIEW, LEVEL), lens_of(VIEW))
    assert edges.clear
    assert np.linalg.norm(edges.corners - plain.corners, axis=1).max() < 0.7
    assert least_step(sample(6.0)) == LEAST_LEVELS


SQUARE = Size(1.0, 1.0, SIZE.radius)


def test_a_square_board_with_a_rim_is_asked_about() -> None:
    """Both squares have the board's shape."""
    picture = drawn(VIEW, LEVEL, WHITE, rim=WOOD, size=SQUARE)
    outer = outline(VIEW, LEVEL, RIM_M, SQUARE)
    with pytest.raises(IrtError, match="two outlines lie within each other"):
        require_board(picture, outer, lens_of(VIEW), SQUARE)
    within = nested(picture, outer, lens_of(VIEW), SQUARE)
    assert within is not None
    assert within.width == pytest.approx(RIM_M / EDGES[0], abs=0.004)
    assert np.linalg.norm(within.corners - outline(VIEW, LEVEL, 0.0, SQUARE), axis=1).max() < 1.5


def test_a_square_board_alone_is_the_board() -> None:
    picture = drawn(VIEW, LEVEL, WHITE, size=SQUARE)
    require_board(picture, outline(VIEW, LEVEL, 0.0, SQUARE), lens_of(VIEW), SQUARE)


def test_a_border_on_a_board_that_is_not_square_is_no_board() -> None:
    picture = drawn(VIEW, LEVEL, WHITE, border=0.004)
    assert nested(picture, outline(VIEW, LEVEL), lens_of(VIEW), SIZE) is not None
    require_board(picture, outline(VIEW, LEVEL), lens_of(VIEW), SIZE)


def test_without_a_lens_a_board_within_a_rim_is_asked_about() -> None:
    """A labyrinth's frame was taken for its board: all places were too small by 16 %, without a warning."""
    picture = drawn(VIEW, LEVEL, WHITE, rim=WOOD)
    with pytest.raises(AmbiguousBoardError, match="without a calibrated lens") as asked:
        require_board(picture, outline(VIEW, LEVEL, RIM_M), None, SIZE)
    outer, inner, *_ = asked.value.outlines
    assert np.linalg.norm(outer - outline(VIEW, LEVEL, RIM_M), axis=1).max() < 0.01
    assert np.linalg.norm(inner - outline(VIEW, LEVEL), axis=1).max() < 1.5


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.25, -0.2)])
def test_without_a_lens_a_board_alone_is_the_board(lean: tuple[float, float]) -> None:
    view = View.above(330.0, lean=lean)
    require_board(drawn(view, LEVEL, WOOD), outline(view, LEVEL), None, SIZE)


def test_a_lens_that_is_off_is_no_rim() -> None:
    """Boards were refused where the middle of the lens was off by 20 pixels."""
    view = View.above(330.0, focal=650.0, lean=(0.2, -0.15))
    seen = outline(view, LEVEL)
    missed, refused = [], []
    for turn in np.arange(12) * np.pi / 6:
        lens = lens_of(view)
        lens.matrix[:2, 2] += 20.0 * np.array([np.cos(turn), np.sin(turn)])
        missed.append(misshapen(seen, lens, SIZE))
        refused.append(like_a_rim(seen, lens, SIZE))
    assert np.mean(np.array(missed) > MISSHAPEN) > 0.4
    assert np.mean(refused) < 0.2
    assert like_a_rim(outline(view, LEVEL, 0.006), lens_of(view), SIZE)
