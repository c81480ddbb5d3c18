"""IRT+ with the network that is shipped: simulated targets, noise, another engine, and a drive of its own."""

import numpy as np
import pytest

from irt.cli.demo import data
from irt.engine import paper_drive, rollouts
from irt.residual import evaluate
from irt.rig import load_rig
from irt.tuning import cache, tune
from irt.tuning.drive import Drive
from irt.tuning.library import Library
from irt.tuning.plus import Plus
from irt.tuning.recipes import Streamed
from irt.tuning.search import compare, run
from irt.tuning.stepnet import load_steps, middle
from irt.tuning.streaming import train_steps


@pytest.fixture(scope="module")
def paths():
    drive, file = Drive.paper(), load_steps(cache.SHIPPED_STEPS)
    library = Library(drive)
    truth = drive.parameters(np.random.default_rng(5).random((40, 5)))
    targets = [[each] for each in drive.simulate(truth)[0]]
    searches = [
        Plus(drive, file, True, compare(drive, middle(drive), target), library).search(
            np.random.default_rng(i)
        )
        for i, target in enumerate(targets)
    ]
    return [path.best.padded(60) for path in run(drive, targets, searches, 60)]


@pytest.mark.parametrize(("rollouts", "most"), [(5, 0.01), (20, 0.003)])
def test_few_rollouts_are_enough(paths, rollouts, most):
    assert np.mean([path.mae[rollouts - 1] for path in paths]) < most


def test_none_goes_astray(paths):
    assert max(path.mae[-1] for path in paths) < 0.01


def test_other_physics_do_not_mislead_it():
    """The network predicts the parameters of a board that lags; those whose path is nearest are others."""
    drive, file = Drive.paper(), load_steps(cache.SHIPPED_STEPS)
    truth = np.array([[0.06, 0.04, 3e-4, 20.0, 1.05]])
    lag = [{"name": "lag", "time_constant_s": 0.35}]
    target = [rollouts(truth, paper_drive(), effects=lag)[0]]
    first, library = compare(drive, middle(drive), target), Library(drive)
    _, distance = library.nearest([each[None] for each in target])
    plus = Plus(drive, file, True, first, library)
    (path,) = run(drive, [target], [plus.search(np.random.default_rng(0))], 5)
    predicted = plus.drive.simulate(plus._coordinates.parameters(file.ask(drive, first).mean))[0][0]
    assert path.best.mae[-1] < 1.05 * distance < np.abs(predicted - target[0]).mean()


def test_what_no_path_shows_is_taken_from_the_middle_of_its_interval():
    """Off the rim every observation scale has the same path: the answer must not depend on it."""
    drive, file = Drive.paper(), load_steps(cache.SHIPPED_STEPS)
    truth = np.array([[0.02 / r, 0.015 / r, 1e-4 / r, 12.0, r] for r in (0.82, 1.0, 1.18)])
    targets = [[each] for each in drive.simulate(truth)[0]]
    begun = [compare(drive, middle(drive), target) for target in targets]
    searches = [
        Plus(drive, file, True, first, Library(drive)).search(np.random.default_rng(i))
        for i, first in enumerate(begun)
    ]
    ended = np.array([path.best.parameters[-1] for path in run(drive, targets, searches, 5)])
    np.testing.assert_allclose(ended[:, 3], ended[0, 3])
    np.testing.assert_allclose(ended[:, 4], ended[0, 4], atol=1e-3)


@pytest.mark.slow
def test_noise_is_left_and_the_truth_is_in_the_intervals(write_rig):
    truth = np.array([[0.07, 0.045, 3e-4, 24.0, 0.92]])
    random = np.random.default_rng(2)
    recordings = {
        run: (paper_drive(), rollouts(truth, paper_drive())[0] + 0.002 * random.standard_normal((100, 2)))
        for run in ("run-1", "run-2")
    }
    result = tune(load_rig(write_rig(recordings)), "irt+")
    assert result.noise == pytest.approx(0.002, rel=0.2)
    for parameter, true in zip(result.model.parameters.values(), truth[0], strict=True):
        assert parameter.low <= true <= parameter.high
    predicted = rollouts(result.model.values[None], paper_drive())[0]
    assert np.abs(predicted - rollouts(truth, paper_drive())[0]).mean() < 0.002


@pytest.mark.slow
def test_another_engines_recordings_are_met():
    rig = load_rig(data("labyrinth"))
    result = tune(rig, "irt+")
    assert evaluate(result.model, rig.recordings).free_run.mae < 0.012


@pytest.mark.slow
def test_a_drive_of_its_own_needs_little_training(write_rig, wave, tmp_path):
    """Gauss-Newton makes up for a network that has hardly learned."""
    truth = np.array([[0.07, 0.045, 3e-4, 24.0, 1.0]])
    rig = load_rig(write_rig({"run": (wave, rollouts(truth, wave)[0])}))
    path = tmp_path / "steps.safetensors"
    train_steps(cache.need(rig).network_drive, path, Streamed(samples=1))
    result = tune(rig, "irt+", network=path, rollouts=100)
    assert result.mae < 0.001


@pytest.mark.parametrize(
    ("option", "message"), [({"rollouts": 0}, "rollouts: expected"), ({"starts": 0}, "starts")]
)
@pytest.mark.parametrize("method", ["irt+", "cma-es", "es"])
def test_options_are_checked(write_rig, method, option, message):
    rig = load_rig(write_rig({"run": (paper_drive(), np.zeros((100, 2)))}))
    with pytest.raises(ValueError, match=message):
        tune(rig, method, **option)
