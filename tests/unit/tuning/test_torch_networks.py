"""The networks of numpy and those of PyTorch are the same functions."""

import numpy as np
import pytest

from irt.tuning.stepnet import StepNet
from irt.tuning.tunenet import TuneNet

torch = pytest.importorskip("torch", reason="training needs PyTorch: labsim-irt[train]")

INPUTS = 40
#: Single precision, through four layers.
CLOSE = {"rtol": 1e-4, "atol": 1e-5}


@pytest.fixture
def modules():
    from irt.tuning import torch_networks  # noqa: PLC0415  # imports torch

    torch.manual_seed(5)
    return torch_networks


@pytest.fixture
def asked():
    """Coordinates (9, 5) and two observations (9, 40), from tiny to large, the last two alike."""
    random = np.random.default_rng(6)
    sizes = 10.0 ** np.linspace(-4, 1.5, 9)[:, None]
    proposed, target = (sizes * random.standard_normal((9, INPUTS)) for _ in range(2))
    target[-1] = proposed[-1]
    return random.standard_normal((9, 5)), proposed, target


def tensors(arrays):
    return [torch.tensor(array, dtype=torch.float32) for array in arrays]


@torch.no_grad()
def test_tunenet(modules, asked):
    module = modules.TuneModule(INPUTS)
    module.input_gain.fill_(1.7)
    _, *observations = asked
    network = TuneNet(modules.weights_in(module))
    np.testing.assert_allclose(network(*observations), module(*tensors(observations)), **CLOSE)


@torch.no_grad()
def test_stepnet(modules, asked):
    module = modules.StepModule(INPUTS)
    module.input_gain.fill_(0.6)
    # Deviations beyond both ends, too.
    module.leave.bias[5:] += torch.tensor([-20.0, -3.0, 0.0, 1.0, 20.0])
    belief = StepNet(modules.weights_in(module))(*asked)
    mean, log_deviation = module(*tensors(asked))
    np.testing.assert_allclose(belief.mean, mean, **CLOSE)
    np.testing.assert_allclose(belief.deviation, log_deviation.exp(), **CLOSE)


def test_weights_go_back_into_a_module(modules):
    one, other = modules.StepModule(INPUTS), modules.StepModule(INPUTS)
    weights = modules.weights_in(one)
    assert {name: array.shape for name, array in weights.items()} == StepNet.shapes(INPUTS)
    modules.put_weights(other, weights)
    for name, array in modules.weights_in(other).items():
        np.testing.assert_array_equal(array, weights[name])
