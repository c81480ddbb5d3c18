"""Maps come back from simulated runs; idle and silent signals are no evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irt.importing.axes import command_axes, is_matrix, tilt_axes
from irt.importing.conventions import (
    DECIDED,
    ROLLING_GAIN,
    commands_to_marble,
    commands_to_tilt,
    tilt_to_marble,
)
from irt.importing.log import Held
from irt.importing.weak_form import Run
from lab_logs import Truth, simulate

EDGES = (0.264, 0.219)


def run(truth: Truth, offset: float = 0.0) -> Run:
    return Run(
        truth.stamps,
        truth.marble_m,
        truth.tilt,
        truth.stamps + offset,
        Held(truth.command_stamps, truth.commands),
    )


@pytest.fixture(scope="module")
def truth() -> Truth:
    return simulate(np.random.default_rng(5), seconds=40.0, spoil=False)


def test_a_rolling_ball_accelerates_by_five_sevenths_g(truth: Truth) -> None:
    found = tilt_to_marble([run(truth)], EDGES, search=False)
    assert found is not None
    expected = ROLLING_GAIN * np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert np.abs(found.gains - expected).max() < 0.3
    assert (np.abs(found.gains - expected) < 6.0 * found.errors + 0.05).all()
    assert np.abs(found.delay).max() < 0.008


def test_a_tilt_of_another_clock_is_found_by_the_acceleration(truth: Truth) -> None:
    found = tilt_to_marble([run(truth, offset=0.21)], EDGES, search=True)
    assert found is not None
    assert found.delay == pytest.approx([-0.21, -0.21], abs=0.005)


def test_without_tilt_commands_move_the_marble(truth: Truth) -> None:
    found = commands_to_marble([replace(run(truth), tilt=None)], EDGES)
    assert found is not None
    axes = command_axes(found, tilt_axes(None), by_marble=True)
    main = [truth.gear[axis, axes.order[axis]] for axis in (0, 1)]
    assert axes.gains == pytest.approx(main, rel=0.1)
    assert not is_matrix(axes) or (np.abs(truth.gear) > 0.3).all()


def test_commands_move_the_tilt_after_a_dead_time_and_a_lag(truth: Truth) -> None:
    found = commands_to_tilt([run(truth)])
    assert found is not None
    assert np.abs(found.gains - truth.gear).max() < 0.02
    assert found.delay == pytest.approx([truth.delay] * 2, abs=0.002)
    assert found.lag == pytest.approx([truth.lag] * 2, abs=0.003)


def test_a_command_that_never_moves_is_left_out(truth: Truth) -> None:
    commands = truth.commands.copy()
    commands[:, 1] = 3.0
    found = commands_to_tilt([replace(run(truth), commands=Held(truth.command_stamps, commands))])
    assert found is not None
    assert np.isnan(found.gains[:, 1]).all()
    assert np.isfinite(found.gains[:, 0]).all()


def test_signals_without_a_connection_decide_nothing(truth: Truth) -> None:
    # The run of another rig: as alive as the true commands, and unrelated.
    other = simulate(np.random.default_rng(6), seconds=40.0, spoil=False)
    strange = replace(run(truth), commands=Held(other.command_stamps, other.commands))
    found = commands_to_tilt([strange])
    assert found is not None
    assert found.explained.max() < 0.5
    still = replace(run(truth), tilt=1e-3 * np.random.default_rng(0).standard_normal(truth.tilt.shape))
    found = tilt_to_marble([still], EDGES, search=False)
    assert found is not None
    assert np.abs(found.z).max() < DECIDED
    assert tilt_axes(found).sure == ("undecided", "undecided")
    assert tilt_axes(found).order == (0, 1)


def test_a_tilt_that_is_nan_throughout_is_no_tilt(truth: Truth) -> None:
    nothing = replace(run(truth), tilt=np.full(truth.tilt.shape, np.nan))
    assert tilt_to_marble([nothing], EDGES, search=False) is None
    half = replace(run(truth), tilt=np.column_stack([truth.tilt[:, 0], np.full(len(truth.tilt), np.nan)]))
    found = tilt_to_marble([half], EDGES, search=False)
    assert found is not None
    axes = tilt_axes(found)
    assert (axes.order, axes.sure) == ((0, 1), ("surely", "undecided"))
