"""Positions read off pictures for `irt prove`: an empty board is known, and colours come red first."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from rendered import CORNERS, HEIGHT, RADIUS, WIDTH, path, rendered

from irt.errors import IrtError
from irt.tracking import positions
from irt.tracking.corners import find_corners
from irt.tracking.geometry import Plane, Size

SIZE = Size(1.0, 0.8, RADIUS / 178)


def red_first(picture: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(picture[:, :, ::-1])


@pytest.fixture(scope="module")
def empty() -> np.ndarray:
    return red_first(rendered())


def read(empty: np.ndarray, places: list, *, light: float = 1.0) -> np.ndarray:
    run = [
        np.rint(light * red_first(rendered(*([place] if place is not None else []), seed=10 + index))).astype(
            np.uint8
        )
        for index, place in enumerate(places)
    ]
    dim = np.rint(light * empty).astype(np.uint8)
    return positions(empty, dim, run, (SIZE.along_x, SIZE.along_y), SIZE.radius)


def expected(places: np.ndarray) -> np.ndarray:
    return Plane.of(CORNERS, SIZE).positions(np.asarray(places))


def test_corners_are_found_to_a_tenth_of_a_pixel() -> None:
    np.testing.assert_allclose(find_corners(rendered()), CORNERS, atol=0.1)


def test_dark_board_on_bright_ground_is_found() -> None:
    np.testing.assert_allclose(find_corners(255 - rendered()), CORNERS, atol=0.1)


@pytest.mark.slow
def test_positions_are_right_to_a_tenth_of_a_pixel(empty: np.ndarray) -> None:
    places = path(40)
    missed = (read(empty, list(places)) - expected(places)) * 178
    assert not np.isnan(missed).any()
    assert np.sqrt((missed**2).mean()) < 0.1


def test_middle_of_the_board_is_where_its_diagonals_cross() -> None:
    (a, b, c, d) = CORNERS
    part = np.linalg.solve(np.stack([c - a, b - d], axis=1), b - a)[0]
    middle = a + part * (c - a)
    np.testing.assert_allclose(expected([middle])[0], 0.0, atol=1e-6)
    assert expected([middle + 0.5 * (0.5 * (a + b) - middle)])[0, 1] == pytest.approx(0.2, abs=0.05)


def test_lost_where_there_is_no_marble(empty: np.ndarray) -> None:
    places: list = list(path(30))
    places[12:15] = [None, None, None]
    seen = read(empty, places)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(seen[:, 0])), [12, 13, 14])


def test_a_run_without_any_marble_is_lost_throughout(empty: np.ndarray) -> None:
    assert np.isnan(read(empty, [None] * 8)).all()


def test_a_small_marble_between_two_pixels_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["rendered"], "RADIUS", 2.6)
    empty = red_first(rendered())
    places = np.floor(path(30)) + np.array([0.5, 0.0])
    run = [red_first(rendered(tuple(place), seed=10 + index)) for index, place in enumerate(places)]
    seen = positions(empty, empty, run, (SIZE.along_x, SIZE.along_y), 2.6 / 178)
    missed = (seen - expected(places)) * 178
    assert np.sqrt((missed**2).mean()) < 0.2


def test_light_that_changed_is_met_by_another_empty_picture(empty: np.ndarray) -> None:
    places = path(20)
    missed = (read(empty, list(places), light=0.6) - expected(places)) * 178
    assert np.sqrt((missed**2).mean()) < 0.15


def test_no_board_is_said() -> None:
    with pytest.raises(IrtError, match=r"no board in the picture|corners: all four|not clear"):
        find_corners(np.full((HEIGHT, WIDTH, 3), 30, dtype=np.uint8))
