"""The printed sheet: all four markers are read from it, at the size that it states."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from irt.tracking.marker_sheet import BAR_MM, PAPER_MM, SIDE_MM, write_marker_sheet
from irt.tracking.markers import detect_markers


def test_markers_are_read_at_their_stated_size(tmp_path: Path) -> None:
    path = tmp_path / "markers.png"
    write_marker_sheet(path)
    picture = cv2.imread(str(path))
    per_mm = picture.shape[1] / PAPER_MM[0]
    assert abs(picture.shape[0] / PAPER_MM[1] - per_mm) < 0.01
    seen = detect_markers(picture)
    assert sorted(seen) == [0, 1, 2, 3]
    for four in seen.values():
        sides = np.linalg.norm(np.roll(four, -1, axis=0) - four, axis=1)
        np.testing.assert_allclose(sides / per_mm, SIDE_MM, atol=0.3)
    # Clockwise from the top left, as they go onto the board.
    middles = np.array([seen[number].mean(axis=0) for number in range(4)])
    assert middles[0, 0] < middles[1, 0]
    assert middles[1, 1] < middles[2, 1]


def test_the_bar_is_as_long_as_it_says(tmp_path: Path) -> None:
    path = tmp_path / "markers.png"
    write_marker_sheet(path)
    dark = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) < 128
    rows = dark.sum(axis=1) * PAPER_MM[0] / dark.shape[1]
    assert abs(rows.max() - BAR_MM) < 0.5


def test_a_page_of_a4_in_points(tmp_path: Path) -> None:
    path = tmp_path / "markers.pdf"
    write_marker_sheet(path)
    assert b"/MediaBox [ 0 0 595.27" in path.read_bytes()
