"""Whether commands set the rate of the tilt or the tilt: both planted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from irt.importing.log import Held, Log
from irt.importing.rates import commands_to_rates
from irt.importing.weak_form import Run
from lab_logs import Truth, simulate


def run_of(truth: Truth) -> Run:
    names = truth.command_stamps
    log = Log(
        "log",
        Path("log"),
        truth.stamps,
        truth.marble_m,
        truth.tilt,
        names,
        truth.commands,
        np.zeros(len(truth.stamps)),
    )
    return Run(truth.stamps, truth.marble_m, truth.tilt, truth.stamps, Held.of(log))


@pytest.mark.parametrize("seed", range(4))
def test_rates_of_motors_are_recovered(seed: int) -> None:
    truth = simulate(np.random.default_rng(seed), seconds=40.0, unit=200.0, motors=True, spoil=False)
    found = commands_to_rates([run_of(truth)])
    assert found is not None
    assert found.map.gains == pytest.approx(truth.gear, abs=0.03 * np.abs(truth.gear).max())
    assert found.dead == pytest.approx(truth.dead, rel=0.03)
    assert found.map.delay == pytest.approx(truth.delay, abs=0.02)
    assert found.map.lag == pytest.approx(truth.lag, abs=0.02)
    assert (found.map.explained > 0.99).all()


@pytest.mark.parametrize("by_rows", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_angles_are_no_rates(seed: int, by_rows: bool) -> None:
    truth = simulate(np.random.default_rng(seed), seconds=30.0, by_rows=by_rows)
    assert commands_to_rates([run_of(truth)]) is None


def test_a_tilt_that_nothing_moves_shows_no_rates() -> None:
    random = np.random.default_rng(5)
    truth = simulate(random, seconds=30.0)
    others = random.permutation(truth.commands)
    run = run_of(truth)
    shuffled = Run(run.stamps, run.marble, run.tilt, run.tilt_stamps, Held(run.commands.stamps, others))
    assert commands_to_rates([shuffled]) is None


def test_too_little_to_say() -> None:
    truth = simulate(np.random.default_rng(1), seconds=30.0, motors=True)
    run = run_of(truth)
    short = slice(0, 100)
    assert (
        commands_to_rates(
            [Run(run.stamps[short], run.marble[short], run.tilt[short], run.stamps[short], run.commands)]
        )
        is None
    )
    assert commands_to_rates([Run(run.stamps, run.marble, None, run.stamps, run.commands)]) is None
    assert commands_to_rates([]) is None
