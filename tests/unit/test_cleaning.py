"""Held places, hidden markers and garbage are found; resting marbles and fast boards are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.cleaning import (
    garbage_rows,
    held_rows,
    mask_spans,
    noise_of,
    repeated_rows,
    repeats_are_certain,
    tilt_jumps,
)

RATE = 60.0


def rolling(rows: int = 600, noise: float = 0.002, seed: int = 0) -> np.ndarray:
    times = np.arange(rows) / RATE
    path = np.column_stack([0.3 * np.sin(1.1 * times), 0.25 * np.cos(1.7 * times)])
    return path + noise * np.random.default_rng(seed).standard_normal(path.shape)


def test_noise_is_found_beside_the_signal() -> None:
    assert noise_of(rolling(5000)[:, 0]) == pytest.approx(0.002, rel=0.1)
    assert np.isnan(noise_of(np.full(50, np.nan)))


@settings(max_examples=30)
@given(first=st.integers(50, 500), rows=st.integers(1, 40), seed=st.integers(0, 1000))
def test_places_held_by_the_tracker_are_found(first: int, rows: int, seed: int) -> None:
    marble = rolling(seed=seed)
    marble[first : first + rows] = marble[first - 1]
    assert repeats_are_certain(marble)
    assert mask_spans(held_rows(marble)) == [(first, first + rows)]


def test_a_marble_at_rest_under_a_noisy_camera_is_not_held() -> None:
    marble = rolling()
    marble[200:400] = marble[200] + 0.002 * np.random.default_rng(1).standard_normal((200, 2))
    assert not held_rows(marble).any()


def rests(held: bool, decimals: int | None) -> np.ndarray:
    """A marble without noise that brakes to rest and starts again, and is held for 20 rows if so wished."""
    times = np.arange(600) / RATE
    x = np.where(
        times < 4.0, 0.4 - 0.025 * (4.0 - times) ** 2, 0.4 - 0.1 * np.clip(times - 6.0, 0.0, None) ** 2
    )
    marble = np.column_stack([x, np.full(600, 0.1)])
    if held:
        marble[60:80] = marble[59]
    return marble if decimals is None else marble.round(decimals)


@pytest.mark.parametrize("decimals", [None, 3])
def test_where_repeats_are_no_proof_the_motion_around_them_decides(decimals: int | None) -> None:
    assert not repeats_are_certain(rests(True, decimals))
    assert repeated_rows(rests(False, decimals)).sum() > 100
    assert not held_rows(rests(False, decimals)).any()
    assert (60, 80) in mask_spans(held_rows(rests(True, decimals)))


@settings(max_examples=30)
@given(
    first=st.integers(20, 550),
    rows=st.integers(1, 30),
    size=st.floats(0.1, 0.2),
    sign=st.sampled_from([-1.0, 1.0]),
    axis=st.sampled_from([0, 1]),
)
def test_hidden_markers_are_found(first: int, rows: int, size: float, sign: float, axis: int) -> None:
    tilt = 0.1 * rolling(noise=0.01)
    tilt[first : first + rows, axis] += sign * size
    expected = np.zeros(tilt.shape, dtype=bool)
    expected[first : first + rows, axis] = True
    assert np.array_equal(tilt_jumps(tilt), expected)


def test_a_board_that_moves_on_while_its_marker_is_hidden() -> None:
    tilt = np.zeros((600, 2))
    tilt[:, 0] = np.interp(np.arange(600), [300, 330], [0.07, -0.02])
    tilt[300:330, 0] += 0.145
    assert mask_spans(tilt_jumps(tilt)[:, 0]) == [(300, 330)]


def test_a_fast_board_does_not_jump() -> None:
    times = np.arange(900) / RATE
    angle = 0.14 * np.sign(np.sin(3.0 * times))
    # A board that is driven from stop to stop at 1 rad/s.
    for row in range(1, 900):
        angle[row] = angle[row - 1] + np.clip(angle[row] - angle[row - 1], -1.0 / RATE, 1.0 / RATE)
    assert not tilt_jumps(np.column_stack([angle, -angle]), times).any()


def test_a_marker_hidden_at_an_end_of_the_log_and_an_axis_that_was_not_measured() -> None:
    tilt = 0.1 * rolling(noise=0.01)
    tilt[:10, 0] += 0.15
    tilt[-10:, 0] -= 0.15
    tilt[:, 1] = np.nan
    jumps = tilt_jumps(tilt)
    assert mask_spans(jumps[:, 0]) == [(0, 10), (590, 600)]
    assert not jumps[:, 1].any()


def test_rows_before_the_first_picture_are_garbage() -> None:
    marble, tilt = rolling(), 0.1 * rolling(seed=1)
    assert garbage_rows(marble, tilt) == 0
    marble[:3], tilt[:5] = 0.0, 0.0
    assert garbage_rows(marble, tilt) == 5
    assert garbage_rows(np.full((100, 2), np.nan), None) == 0
