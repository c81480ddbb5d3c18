"""A track whose corners are not certain, or that may be a shadow's, says so."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from irt.tracking.doubts import doubts


@pytest.mark.parametrize(
    ("corners_mm", "shadow", "disagree", "said"),
    [
        (0.2, 0.0, 0.09, []),
        (0.3, 0.04, 0.13, []),
        (0.8, 0.0, 0.0, ["corners are uncertain by 0.8 mm"]),
        (0.3, 0.5, 0.0, ["50 % that this is the marble's shadow"]),
        (0.2, 0.0, 0.15, ["edge and its filled area disagree by 0.15 radii"]),
        (4.0, 0.2, 0.0, ["corners are uncertain by 4.0 mm", "20 % that this is the marble's shadow"]),
    ],
)
def test_warnings(corners_mm: float, shadow: float, disagree: float, said: list[str]) -> None:
    lines = doubts(
        SimpleNamespace(corners_mm=corners_mm, shadow=shadow, disagree=disagree, away=(), still=())
    )
    assert len(lines) == len(said)
    for line, words in zip(lines, said, strict=True):
        assert words in line
