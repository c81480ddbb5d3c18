"""Stamps, gaps, and two clocks brought together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.engine import rollouts
from irt.errors import IrtError
from irt.tracking.timing import MOST_CODED, align, at_commands, find_gaps, repeated_by_encoder


def test_missing_and_repeated_pictures_are_counted() -> None:
    stamps = np.delete(np.arange(60) / 30.0, [10, 11, 40])
    repeated = np.zeros(57, dtype=bool)
    repeated[[5, 20]] = True
    gaps = find_gaps(stamps, repeated)
    assert (gaps.dropped, gaps.repeated) == (3, 2)
    assert gaps.interval == pytest.approx(1 / 30)
    assert gaps.longest == pytest.approx(0.1)


def test_pictures_that_an_encoder_repeats_change_less_than_those_around_them() -> None:
    random = np.random.default_rng(0)
    for times in range(1, MOST_CODED + 2):
        changes = np.where(np.arange(80) % times == 0, 1.0, 0.1) * random.uniform(0.8, 1.25, 80)
        changes[0] = np.inf
        again = repeated_by_encoder(changes)
        # The last ones have no picture after them.
        whole = 80 - 80 % times - times + 1
        np.testing.assert_array_equal(again[:whole], np.arange(whole) % times != 0)


@given(st.lists(st.floats(0.5, 1.0), max_size=40), st.integers(MOST_CODED + 1, 20))
def test_neither_noise_nor_a_rest_is_a_repeated_picture(changes: list[float], rest: int) -> None:
    resting = [np.inf, *changes, *[0.01] * rest, *changes]
    assert not repeated_by_encoder(np.array(resting)).any()


def rolled(seed: int, rows: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps [s], commands and path of a marble that rolls at 40 rows a second."""
    random = np.random.default_rng(seed)
    time = np.arange(rows)[:, None, None] / 40.0
    waves = np.sin(2 * np.pi * (time * random.uniform(0.2, 0.9, (2, 4)) + random.random((2, 4))))
    knobs = 0.06 * waves.sum(axis=2)
    return time[:, 0, 0], knobs, rollouts([[0.08, 0.07, 3e-4, 6.0, 1.0]], knobs)[0]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_offset_is_found_to_a_few_milliseconds(seed: int) -> None:
    stamps, knobs, marble = rolled(seed)
    random = np.random.default_rng(seed)
    noisy = marble + 5e-4 * random.standard_normal(marble.shape)
    noisy[120:135] = np.nan
    found = align(stamps + 17.0, knobs, stamps + 0.23, noisy)
    assert abs(found.offset - (0.23 - 17.0)) < max(4 * found.error, 0.004)
    assert found.error < 0.02
    assert found.explained > 0.5


def test_commands_of_another_run_are_refused() -> None:
    stamps, _, marble = rolled(1)
    _, other, _ = rolled(2)
    random = np.random.default_rng(0)
    with pytest.raises(IrtError, match="follow these commands at no offset"):
        align(stamps, np.abs(other) * random.standard_normal(other.shape), stamps, marble)


def test_places_between_pictures_are_interpolated_but_never_across_a_loss() -> None:
    stamps = np.arange(50) / 50.0
    path = np.column_stack([np.sin(3 * stamps), stamps**2])
    path[20] = np.nan
    times = np.arange(0.005, 0.95, 0.02)
    found = at_commands(stamps, path, times)
    lost = np.isnan(found[:, 0])
    np.testing.assert_array_equal(np.flatnonzero(lost), [19, 20])
    truth = np.column_stack([np.sin(3 * times), times**2])
    # Beside the loss and at the ends there is only the straight line.
    assert np.nanmax(np.abs(found - truth)) < 5e-4
    assert np.nanmedian(np.abs(found - truth)) < 1e-6


def test_each_picture_speaks_for_one_command() -> None:
    stamps = np.arange(30) / 30.0
    path = np.column_stack([stamps, -stamps])
    times = np.arange(300) / 300.0
    found = at_commands(stamps, path, times)
    seen = ~np.isnan(found[:, 0])
    assert seen.sum() == 30
    np.testing.assert_allclose(found[seen, 0], times[seen], atol=1e-9)
