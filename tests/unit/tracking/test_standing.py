"""A board that is not in its place for a second or more is said, from the last look that found it."""

from __future__ import annotations

import numpy as np

from irt.tracking.standing import absences, stretches

STAMPS = np.arange(100) / 20.0


def looks(*missing: int) -> list[tuple[int, bool]]:
    """Return looks at every tenth picture."""
    return [(picture, picture not in missing) for picture in range(0, 100, 10)]


def test_a_board_that_stays_is_nowhere_away() -> None:
    assert absences(looks(), STAMPS) == ()


def test_a_board_that_leaves_is_away_to_the_end() -> None:
    assert absences(looks(60, 70, 80, 90), STAMPS) == ((51, 49),)


def test_a_board_that_comes_back_is_away_between() -> None:
    assert absences(looks(30, 40, 50), STAMPS) == ((21, 30),)


def test_a_hand_over_the_sides_is_no_absence() -> None:
    assert absences(looks(30), STAMPS) == ()


def test_stretches() -> None:
    assert stretches(np.array([1, 1, 0, 0, 1], dtype=bool)) == ((0, 2), (4, 1))
