import numpy as np
import pytest
import torch

from irt.errors import IrtError
from irt.tuning.drive import Drive
from irt.tuning.recipes import Streamed
from irt.tuning.search import compare
from irt.tuning.stepnet import StepFile, StepNet, load_steps, middle, save_steps
from irt.tuning.streaming import draw_pool
from irt.tuning.tensors import write_tensors


@pytest.fixture
def file():
    random = np.random.default_rng(0)
    weights = {
        name: random.uniform(-0.04, 0.04, shape).astype(np.float32)
        for name, shape in StepNet.shapes(200).items()
    }
    weights["input_gain"] = np.ones((), dtype=np.float32)
    return StepFile(StepNet(weights), {"drive": "d", "samples": "1"}, np.array([1.0, 0.5]))


def test_a_file_keeps_the_network_to_half_precision(file, tmp_path):
    path = tmp_path / "steps.safetensors"
    save_steps(path, file)
    again = load_steps(path)
    assert again.metadata["drive"] == "d"
    for name, value in file.network.weights.items():
        np.testing.assert_allclose(again.network.weights[name], value, rtol=1e-3, atol=1e-4)


def test_a_belief_is_about_every_proposal(file):
    drive = Drive.paper()
    proposals = drive.parameters(np.random.default_rng(0).random((3, 5)))
    target = drive.simulate(middle(drive))[0][0]
    belief = file.ask(drive, compare(drive, proposals, [target]))
    assert belief.mean.shape == belief.deviation.shape == (3, 5)
    assert (belief.deviation > 0.0).all()


def test_small_residuals_call_for_small_steps(file):
    drive = Drive.paper()
    target = drive.simulate(middle(drive))[0][0]
    length = []
    for size in (1e-1, 1e-3):
        moved = target + size * np.sin(np.arange(100) / 9.0)[:, None]
        seen = compare(drive, middle(drive), [moved])
        belief = file.ask(drive, seen)
        exact = file.ask(drive, compare(drive, middle(drive), [target]))
        length.append(np.abs(belief.mean - exact.mean).max())
    assert length[1] < 0.1 * length[0]


def test_repeated_runs_are_averaged(file, small_drive):
    drive = Drive(
        (*Drive.paper().runs, *Drive.paper().runs),
        *(getattr(Drive.paper(), name) for name in ("board", "marble", "ranges", "start", "engine")),
    )
    target = Drive.paper().simulate(middle(drive))[0][0]
    alone = file.ask(Drive.paper(), compare(Drive.paper(), middle(drive), [target + 0.1]))
    both = file.ask(drive, compare(drive, middle(drive), [target + 0.1, target + 0.1]), joint=False)
    np.testing.assert_allclose(both.mean, alone.mean, rtol=1e-6)


@pytest.mark.parametrize(
    ("tensors", "format_", "message"),
    [
        ({}, "irt-tunenet-1", "not a network of irt\\+"),
        ({}, "irt-stepnet-1", "broken"),
        ({"network.enter.weight": np.zeros((3, 606))}, "irt-stepnet-1", "expected shape"),
    ],
)
def test_what_is_no_network_takes_one_line(tmp_path, tensors, format_, message):
    path = tmp_path / "net.safetensors"
    write_tensors(path, tensors, {"format": format_})
    with pytest.raises(IrtError, match=message):
        load_steps(path)


def test_pools_are_drawn_alike_for_any_threads_and_differ_by_number():
    drive, recipe = Drive.paper(), Streamed()
    one, again = (draw_pool(drive, recipe, 3, 600, threads) for threads in (1, 2))
    other = draw_pool(drive, recipe, 4, 600)
    for name in ("proposal", "proposed", "target", "observed"):
        assert torch.equal(getattr(one, name), getattr(again, name))
        assert torch.isfinite(getattr(one, name)).all()
        assert not torch.equal(getattr(one, name), getattr(other, name))


def test_what_no_effect_touches_is_as_simulated():
    drive, recipe = Drive.paper(), Streamed(affected=0.0)
    pool = draw_pool(drive, recipe, 0, 64)
    plain = draw_pool(drive, Streamed(affected=0.99), 0, 64)
    assert not torch.equal(pool.observed, plain.observed)
    assert torch.equal(pool.target, plain.target)


@pytest.mark.parametrize("change", [{"samples": 0}, {"batch": 0}, {"seed": -1}])
def test_a_recipe_that_cannot_be_is_refused(change):
    with pytest.raises(IrtError, match="must be at least"):
        Streamed(**change)
