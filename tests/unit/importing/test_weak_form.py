from __future__ import annotations

import numpy as np
import pytest

from irt.importing.log import Held
from irt.importing.weak_form import Run, Windows

EDGES = (0.26, 0.22)
NO_COMMANDS = Held(np.zeros(0), np.zeros((0, 2)))


def run(marble: np.ndarray, times: np.ndarray) -> Run:
    return Run(times, marble, None, times, NO_COMMANDS)


def test_the_acceleration_of_a_parabola_is_exact_for_any_stamps() -> None:
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.01, 0.025, 120))
    marble = np.column_stack([0.02 * times**2 - 0.01 * times, -0.03 * times**2 + 0.05 * times])
    windows = Windows.of([run(marble, times)], EDGES)
    assert windows is not None
    assert np.allclose(windows.stack("places"), [0.04, -0.06], atol=1e-9)


def test_windows_with_a_gap_a_rim_or_a_resting_marble_are_left_out() -> None:
    times = np.arange(0.0, 20.0, 1.0 / 60.0)
    marble = np.column_stack([0.1 * np.sin(times), 0.05 * np.cos(times)])
    marble[300:330] = np.nan
    marble[600:900] = [0.128, 0.0]
    windows = Windows.of([run(marble, times)], EDGES)
    assert windows is not None
    centres, free = windows.stack("centres"), windows.stack("free")
    assert not ((centres > 4.9) & (centres < 5.6)).any()
    assert not free[(centres > 10.3) & (centres < 14.7)].any()
    assert free[(centres > 6.0) & (centres < 9.5)].all()


@pytest.mark.parametrize("rows", [5, 60])
def test_too_little_to_fit(rows: int) -> None:
    times = np.arange(rows) / 60.0
    assert Windows.of([run(np.zeros((rows, 2)), times)], EDGES) is None
