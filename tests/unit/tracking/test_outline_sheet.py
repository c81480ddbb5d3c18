"""The picture of outlines that may be the board's shows each, and its corners can be read off it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from irt.tracking.nested import AmbiguousBoardError
from irt.tracking.outline_sheet import COLOURS, LINE, MARGIN, write_outlines


@pytest.mark.parametrize(("width", "larger"), [(320, 3), (640, 2), (1280, 1)])
def test_outlines_are_where_the_scales_say(tmp_path: Path, width: int, larger: int) -> None:
    picture = np.full((width * 3 // 4, width, 3), 128, np.uint8)
    inset = np.array([0.1, 0.2, 0.3])[:, None, None] * width
    box = np.array([[0, 0], [1, 0], [1, 0.75], [0, 0.75]]) * width
    outlines = list(box + inset * [[1, 1], [-1, 1], [-1, -1], [1, -1]])
    path = tmp_path / "run-outlines.png"
    write_outlines(path, AmbiguousBoardError("which?", picture, outlines))
    drawn = cv2.imread(str(path))
    assert drawn.shape == (larger * width * 3 // 4 + MARGIN + LINE * 4, larger * width + MARGIN, 3)
    for corners, colour in zip(outlines, COLOURS, strict=False):
        # The middle of the left side, away from the numbers.
        x, y = MARGIN + larger * (corners[[0, 3]].mean(axis=0) + 0.5)
        around = drawn[round(y), round(x) - 3 : round(x) + 3].astype(int)
        assert np.abs(around - colour).max(axis=1).min() < 60
