"""A marble is followed; where it jumps two pictures have to agree; lost is lost."""

from __future__ import annotations

import numpy as np
import pytest
from rendered import CORNERS, HEIGHT, MARBLE, RADIUS, WIDTH, path, rendered

from irt.tracking.blob_detector import Box
from irt.tracking.geometry import Plane, Size
from irt.tracking.learning import _first, learn, scale_of
from irt.tracking.tracker import FAR, Tracker

SIZE = Size(1.0, 0.8, RADIUS / 178)
PLANE = Plane.of(CORNERS, SIZE)


@pytest.fixture(scope="module")
def learned():
    pictures = [rendered(place, seed=index) for index, place in enumerate(path(40))]
    return learn(pictures, PLANE, Box(0, 0, WIDTH, HEIGHT))


@pytest.fixture
def tracker(learned) -> Tracker:
    return Tracker(learned, scale_of(PLANE, learned.finder.middle))


def test_a_window_is_enough_for_a_marble_that_rolls(tracker: Tracker) -> None:
    places = path(30, seed=4)
    seen = [tracker.see(rendered(place, seed=50 + index)) for index, place in enumerate(places)]
    assert np.abs([[one.x, one.y] for one in seen] - places).max() < 0.3
    assert all(one.in_window for one in seen[2:])


def test_a_drawing_without_noise_is_followed() -> None:
    places = path(16)
    pictures = [rendered(place, noise=0.0) for place in places]
    drawn = Tracker(
        learn(pictures, PLANE, Box(0, 0, WIDTH, HEIGHT)), scale_of(PLANE, (WIDTH / 2, HEIGHT / 2))
    )
    seen = [drawn.see(picture) for picture in pictures]
    assert np.abs([[one.x, one.y] for one in seen] - places).max() < 0.3


def test_a_marble_that_jumps_is_kept_once_the_next_picture_agrees(tracker: Tracker) -> None:
    for index in range(4):
        tracker.see(rendered((60.0 + index, 60.0), seed=index))
    jumped = tracker.see(rendered((170.0, 120.0), seed=10))
    assert not jumped.seen
    after = tracker.see(rendered((171.0, 121.0), seed=11))
    assert (after.x, after.y) == pytest.approx((171.0, 121.0), abs=0.3)
    assert after.confirms is not None
    assert (after.confirms.x, after.confirms.y) == pytest.approx((170.0, 120.0), abs=0.3)


def test_a_flash_in_one_picture_is_no_marble(tracker: Tracker) -> None:
    """What is there once, and elsewhere the next time, is believed neither time."""
    for index in range(4):
        tracker.see(rendered((60.0 + index, 60.0), seed=index))
    for index, place in enumerate([(170.0, 120.0), (100.0, 130.0), (180.0, 60.0)]):
        seen = tracker.see(rendered(place, seed=20 + index))
        assert not seen.seen
        assert seen.confirms is None


def test_two_alike_far_from_where_it_was_are_not_chosen_between(tracker: Tracker) -> None:
    for index in range(4):
        tracker.see(rendered((60.0, 60.0 + index), seed=index))
    for index in range(3):
        assert not tracker.see(rendered((170.0, 120.0), (100.0, 130.0), seed=30 + index)).seen


def test_a_ball_of_another_colour_is_not_it(tracker: Tracker) -> None:
    for index in range(4):
        tracker.see(rendered((60.0, 60.0 + index), seed=index))
    for index in range(4):
        assert not tracker.see(rendered((61.0, 64.0), seed=40 + index, colour=(40, 160, 60))).seen


def test_one_frame_after_another_gives_the_same_bits(learned) -> None:
    places = path(12, seed=4)
    runs = []
    for _ in range(2):
        tracker = Tracker(learned, scale_of(PLANE, learned.finder.middle))
        runs.append([tracker.see(rendered(place, seed=index)) for index, place in enumerate(places)])
    assert [(one.x, one.y) for one in runs[0]] == [(one.x, one.y) for one in runs[1]]


def test_what_is_dark_and_covers_the_marble_is_no_dim_marble(tracker: Tracker) -> None:
    """A finger of the marble's colour in less light was followed as the marble that it hid."""
    for index in range(4):
        tracker.see(rendered((60.0, 60.0 + index), seed=index))
    for index in range(12):
        picture = rendered(seed=60 + index)
        picture[35:110, 45 : 100 + index] = np.array(MARBLE) * 0.4
        assert not tracker.see(picture).seen


def test_a_marble_at_rest_that_is_less_sure_for_long_is_held(tracker: Tracker) -> None:
    """Where it lies at a wall, less of it may be as usual for more pictures than a glance lasts."""
    for index in range(6):
        tracker.see(rendered((60.0, 70.0), seed=80 + index))
    held = []
    for index in range(20):
        picture = rendered((60.0, 70.0), seed=90 + index)
        # A part of the marble has another colour.
        picture[64:77, 63:68] = (60, 90, 60)
        held.append(tracker.see(picture))
    assert max(one.confidence for one in held) < FAR
    assert all(one.seen for one in held)
    assert np.abs([[one.x - 60.0, one.y - 70.0] for one in held]).max() < 0.5


def test_the_first_place_is_followed_back_from_the_first_clear_one(learned) -> None:
    """A marble that leaves a spot of its own colour is not found there, but it is followed to it."""
    places = [(60.0 + 2.0 * index, 70.0) for index in range(6)]
    pictures = [rendered(place, seed=index) for index, place in enumerate(places)]
    tracker = Tracker(learned, scale_of(PLANE, learned.finder.middle))
    clear = [(index, tracker.match(pictures[index], *places[index])) for index in (4, 5)]
    assert _first(pictures, clear, tracker) == pytest.approx(places[0], abs=0.3)
    assert _first(pictures, clear[:1], tracker) is None
