import numpy as np
import pytest

from irt.errors import IrtError
from irt.tuning.tensors import write_tensors
from irt.tuning.tunenet import NetworkFile, TuneNet, load_network, save_network


@pytest.fixture
def network():
    random = np.random.default_rng(3)
    weights = {
        name: 0.1 * random.standard_normal(shape).astype(np.float32)
        for name, shape in TuneNet.shapes(6).items()
    }
    return TuneNet({**weights, "input_gain": np.ones((), dtype=np.float32)})


@pytest.fixture
def observations():
    return np.random.default_rng(4).standard_normal((2, 7, 6))


def test_as_many_weights_as_in_the_papers_network():
    shapes = {name: shape for name, shape in TuneNet.shapes(200).items() if name != "input_gain"}
    assert sum(np.prod(shape) for shape in shapes.values()) == 235_525


def test_each_observation_goes_through_a_layer_of_its_own_proposed_first(network, observations):
    w = network.weights
    proposed, target = observations

    def relu(x):
        return np.maximum(x, 0.0)

    first = relu(proposed @ w["proposed.weight"].T + w["proposed.bias"])
    second = relu(target @ w["target.weight"].T + w["target.bias"])
    joined = relu(np.concatenate([first, second], axis=1) @ w["joined.weight"].T + w["joined.bias"])
    expected = np.tanh(joined @ w["difference.weight"].T + w["difference.bias"])
    np.testing.assert_allclose(network(*observations), expected, atol=1e-6)


def test_gain_multiplies_both_observations(network, observations):
    louder = TuneNet({**network.weights, "input_gain": np.float32(3.0)})
    np.testing.assert_allclose(louder(*observations), network(*(3 * observations)), atol=1e-6)


def test_in_both_orders_a_match_is_a_difference_of_zero(network, observations):
    proposed, target = observations
    assert not network.both_orders(proposed, proposed).any()
    assert np.abs(network(proposed, proposed)).max() > 0.01
    np.testing.assert_array_equal(
        network.both_orders(proposed, target), -network.both_orders(target, proposed)
    )


@pytest.fixture
def saved(network, tmp_path):
    path = tmp_path / "net.safetensors"
    save_network(path, NetworkFile(network, {"seed": "7"}, np.array([0.2, 0.1]), np.array([0.3, 0.2])))
    return path


def test_a_file_gives_back_the_same_network(network, observations, saved):
    read = load_network(saved)
    np.testing.assert_array_equal(read.network(*observations), network(*observations))
    assert read.metadata["seed"] == "7"
    assert read.training.tolist() == pytest.approx([0.2, 0.1])
    assert read.heldout.tolist() == pytest.approx([0.3, 0.2])


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.99999])
def test_a_truncated_file_is_refused_in_one_line(saved, share):
    data = saved.read_bytes()
    saved.write_bytes(data[: int(share * len(data))])
    with pytest.raises(IrtError, match=r"net\.safetensors: cut short or no safetensors file") as caught:
        load_network(saved)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused():
    with pytest.raises(IrtError, match="nowhere: no such file"):
        load_network("nowhere")


def test_other_safetensors_are_refused(tmp_path):
    write_tensors(tmp_path / "other", {"x": np.zeros(3)}, {"format": "pt"})
    with pytest.raises(IrtError, match="other: not a trained network"):
        load_network(tmp_path / "other")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("network.joined.weight", np.zeros((256, 256)), r"joined\.weight is of shape \(256, 256\)"),
        ("network.difference.bias", None, r"difference\.bias is missing; expected shape \(5,\)"),
        ("network.proposed.weight", None, "no weights for the proposed observation"),
        (
            "network.target.bias",
            np.full(256, np.nan),
            r"target\.bias holds values that are not finite",
        ),
    ],
)
def test_weights_of_another_shape_are_refused(network, tmp_path, name, value, message):
    tensors = {f"network.{key}": weight for key, weight in network.weights.items()}
    tensors[name] = value
    write_tensors(
        tmp_path / "net",
        {key: weight for key, weight in tensors.items() if weight is not None},
        {"format": "irt-tunenet-1"},
    )
    with pytest.raises(IrtError, match=message):
        load_network(tmp_path / "net")
