"""Plant a truth and recover it by IRT."""

from __future__ import annotations

import numpy as np
import pytest

from irt.cli.demo import data
from irt.engine import paper_drive, rollouts
from irt.residual import evaluate
from irt.rig import load_rig
from irt.tuning import tune
from irt.tuning.cache import SHIPPED, need
from irt.tuning.drive import Drive
from irt.tuning.iterate import Tuner
from irt.tuning.pretrain import pretrain
from irt.tuning.recipes import Recipe
from irt.tuning.tunenet import load_network


@pytest.fixture(scope="module")
def trials():
    """Return errors of 60 random trials without noise: of state and parameters, after each iteration."""
    drive = Drive.paper()
    random = np.random.default_rng(77)
    target, start = random.random((2, 60, 5))
    tuner = Tuner(drive, load_network(SHIPPED).network, joint=True)
    trace = tuner.iterate(start, drive.simulate(drive.parameters(target)), 20)
    return trace.mae.mean(axis=1), np.abs(trace.scaled - target).mean(axis=(1, 2))


def test_five_iterations_bring_the_state_error_down_to_a_twentieth(trials):
    state, _ = trials
    assert state[0] > 0.1
    assert state[5] < 0.05 * state[0]
    assert state[20] < 0.01


def test_parameters_end_on_the_plateau_that_the_symmetries_leave(trials):
    """The paper's parameter error stays at about 10 % of the ranges (Fig. 4)."""
    _, parameters = trials
    assert parameters[0] > 0.3
    assert parameters[20] < 0.13


def test_what_noise_and_lost_rows_leave_is_recovered(write_rig):
    """With walls in play, the ratio of the gears and the observation scale are pinned down."""
    truth = np.array([[0.07, 0.045, 3e-4, 24.0, 0.92]])
    random = np.random.default_rng(2)
    recordings = {}
    for run in ("run-1", "run-2"):
        marble = rollouts(truth, paper_drive())[0] + 0.002 * random.standard_normal((100, 2))
        marble[random.choice(np.arange(5, 100), 10, replace=False)] = np.nan
        marble[random.choice(np.flatnonzero(np.isfinite(marble[:, 0]))[5:], 2)] += 0.2
        recordings[run] = (paper_drive(), marble)
    rig = load_rig(write_rig(recordings))
    result = tune(rig, "irt", starts=5, seed=1)
    fitted = result.model.values
    assert fitted[0] / fitted[1] == pytest.approx(truth[0, 0] / truth[0, 1], rel=0.05)
    assert fitted[4] == pytest.approx(truth[0, 4], rel=0.02)
    for parameter, true in zip(result.model.parameters.values(), truth[0], strict=True):
        assert parameter.low <= true <= parameter.high
    predicted = rollouts(fitted[None], paper_drive())[0]
    assert np.abs(predicted - rollouts(truth, paper_drive())[0]).mean() < 0.01


def test_another_engines_recordings_are_met():
    """The sample rig, from PyBullet: all starts together, against an error of half a board untuned."""
    rig = load_rig(data("labyrinth"))
    result = tune(rig, "irt", starts=5, seed=0)
    assert evaluate(result.model, rig.recordings).free_run.mae < 0.015
    assert result.mae == min(step.mae for each in result.estimates for step in each.history)
    assert [each.best.mae for each in result.estimates] == sorted(each.best.mae for each in result.estimates)


def tune_jointly(rig, path, recipe):
    """Tune with a joint network that was trained more briefly than `irt tune` would."""
    pretrain(need(rig).network_drive, path, recipe)
    return tune(rig, "irt", network=path)


@pytest.mark.slow
def test_a_joint_network_meets_what_least_squares_meets(shared, tmp_path):
    rig = load_rig(shared / "rigs" / "rig-27")
    by_irt = tune_jointly(rig, tmp_path / "net.safetensors", Recipe(pairs=2000, epochs=40))
    by_least_squares = tune(rig, "least-squares", starts=4)
    errors = [evaluate(each.model, rig.recordings).free_run.mae for each in (by_irt, by_least_squares)]
    assert errors[0] < 1.5 * errors[1] + 0.002


@pytest.mark.slow
def test_a_real_ball_on_a_real_table(shared, tmp_path):
    rig = load_rig(shared / "real" / "ball-table")
    result = tune_jointly(rig, tmp_path / "net.safetensors", Recipe(pairs=2000, epochs=40))
    assert result.model.parameters["time_scale"].low is None
    assert any("stamps" in note for note in result.notes)
    # Over windows of two seconds gears and friction alone leave 0.048 of an edge, this network 0.056.
    assert evaluate(result.model, rig.recordings, 2.0).windowed.mae < 0.065
