"""The jackknife of a mean: its pseudo-values are the numbers themselves."""

from __future__ import annotations

import numpy as np
import pytest

from irt.diagnosis.sessions import differences, sentences

RUNS = [f"day-{day}/run-{run}" for day in (1, 2) for run in range(6)]


def fits(numbers: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the mean of numbers, and the means without each."""
    return float(numbers.mean()), (numbers.sum() - numbers) / (len(numbers) - 1)


def measured(shift: float, seed: int = 0) -> np.ndarray:
    numbers = 0.1 + 0.01 * np.random.default_rng(seed).standard_normal(12)
    numbers[6:] += shift
    return numbers


def test_a_value_that_differs_is_found_with_that_of_each_session() -> None:
    numbers = measured(0.05)
    value, without = fits(numbers)
    (found,) = differences(RUNS, {"delay.delay_s": value}, {"delay.delay_s": without})
    assert found.parameter == "delay.delay_s"
    assert found.values == pytest.approx({"day-1": numbers[:6].mean(), "day-2": numbers[6:].mean()})
    assert found.p_value < 1e-4
    (sentence,) = sentences(RUNS, [found])
    assert "delay.delay_s differs: 0.1" in sentence
    assert "in day-2" in sentence


def test_what_only_scatters_is_seldom_found() -> None:
    false = 0
    for seed in range(200):
        named = {name: fits(measured(0.0, seed=1000 * seed + i)) for i, name in enumerate("abcd")}
        values = {name: one[0] for name, one in named.items()}
        false += bool(differences(RUNS, values, {name: one[1] for name, one in named.items()}))
    # Two in 200 are expected; more than eight come by chance once in five thousand times.
    assert false <= 8
    assert next(sentences(RUNS, [])).startswith("No value differs between day-1 and day-2")


def test_what_is_held_is_not_compared() -> None:
    assert differences(RUNS, {"time_scale": 20.0}, {"time_scale": np.full(12, 20.0)}) == []


def test_few_recordings_cannot_be_compared() -> None:
    few = [*RUNS[:2], *RUNS[6:]]
    value, without = fits(measured(0.5)[:8])
    assert differences(few, {"gear_x": value}, {"gear_x": without}) == []
    assert next(sentences(few, [])).startswith("Sessions with fewer than 3 recordings")


def test_one_session_has_nothing_to_say() -> None:
    assert list(sentences(["run-1", "run-2"], [])) == []
