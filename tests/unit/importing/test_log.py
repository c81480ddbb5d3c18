"""Commands hold from message to message."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.errors import IrtError
from irt.importing.log import Held, Log


def log(stamps: list[float], commands: list[float], rows: int = 10) -> Log:
    return Log(
        name="log",
        path=Path("log.csv"),
        stamps=np.arange(rows) / 10.0,
        marble=np.zeros((rows, 2)),
        tilt=None,
        command_stamps=np.array(stamps),
        commands=np.column_stack([commands, -np.array(commands)]),
        episodes=np.zeros(rows),
    )


def test_the_mean_over_a_row_and_a_command_before_it() -> None:
    held = Held.of(log([0.1, 0.25, 0.5], [1.0, 3.0, 5.0]))
    begins = np.array([0.0, 0.1, 0.2, 0.3, 0.6])
    means = held.mean(begins, begins + 0.1)
    assert np.isnan(means[0]).all()
    assert np.allclose(means[1:, 0], [1.0, 2.0, 3.0, 5.0])
    assert np.array_equal(means[1:, 1], -means[1:, 0])


def test_commands_in_step_with_the_rows_are_copied_to_the_last_digit() -> None:
    values = np.random.default_rng(0).standard_normal(10)
    stamps = np.cumsum(np.full(10, 0.1))
    means = Held.of(log(stamps.tolist(), values.tolist())).mean(stamps, np.append(stamps[1:], 1.1))
    assert np.array_equal(means[:, 0], values)


def test_of_two_commands_at_one_moment_the_later_holds_and_lost_ones_do_not() -> None:
    held = Held.of(log([0.0, 0.2, 0.2, 0.3], [1.0, 2.0, 3.0, np.nan]))
    assert np.array_equal(held.stamps, [0.0, 0.2])
    assert np.array_equal(held.values[:, 0], [1.0, 3.0])


def test_a_driver_goes_home_after_silence() -> None:
    held = Held.of(log([0.0, 0.2, 2.0], [1.0, 2.0, 3.0]), home_after=1.0)
    times = np.array([0.1, 0.3, 1.1, 1.3, 2.5, 3.5])
    assert np.array_equal(held.lagged(times, 0.0)[:, 0], [1.0, 2.0, 2.0, 0.0, 3.0, 0.0])


@given(lag=st.floats(0.01, 0.5), seed=st.integers(0, 100))
def test_a_lag_is_that_of_a_first_order_filter(lag: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    stamps, values = np.cumsum(rng.uniform(0.02, 0.2, 20)), rng.standard_normal(20)
    held = Held.of(log(stamps.tolist(), values.tolist()))
    times = np.arange(stamps[0], stamps[-1], 1e-3)
    state, filtered = values[0], []
    for target in held.lagged(times, 0.0)[:, 0]:
        filtered.append(state)
        state = target + (state - target) * np.exp(-1e-3 / lag)
    assert np.abs(held.lagged(times, lag)[:, 0] - filtered).max() < 8e-3 / lag


def test_arrays_of_another_length_are_refused() -> None:
    good = log([0.0], [1.0])
    with pytest.raises(
        IrtError, match=r"log\.csv: 8 rows of tilt, but 10 stamps; they must be of one length"
    ):
        replace(good, tilt=np.zeros((8, 2)))
    with pytest.raises(IrtError, match="2 commands, but 1 stamps"):
        replace(good, commands=np.zeros((2, 2)))
