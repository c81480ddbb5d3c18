import numpy as np
import pytest
import torch

from irt.errors import IrtError
from irt.tuning.tunenet import NetworkFile, TuneNet, load_network, save_network, write_tensors


@pytest.fixture
def network():
    torch.manual_seed(3)
    return TuneNet(6)


@pytest.fixture
def observations():
    random = torch.Generator().manual_seed(4)
    return torch.randn((7, 6), generator=random), torch.randn((7, 6), generator=random)


def test_as_many_weights_as_in_the_papers_network():
    assert sum(weight.numel() for weight in TuneNet(200).parameters()) == 235_525


def test_each_observation_goes_through_a_layer_of_its_own_proposed_first(network, observations):
    w = {name: value.numpy() for name, value in network.state_dict().items()}
    proposed, target = (each.numpy() for each in observations)

    def relu(x):
        return np.maximum(x, 0.0)

    first = relu(proposed @ w["proposed.weight"].T + w["proposed.bias"])
    second = relu(target @ w["target.weight"].T + w["target.bias"])
    joined = relu(np.concatenate([first, second], axis=1) @ w["joined.weight"].T + w["joined.bias"])
    expected = np.tanh(joined @ w["difference.weight"].T + w["difference.bias"])
    np.testing.assert_allclose(network(*observations).detach(), expected, atol=1e-6)


def test_gain_multiplies_both_observations(network, observations):
    expected = network(3 * observations[0], 3 * observations[1])
    network.input_gain.fill_(3.0)
    torch.testing.assert_close(network(*observations), expected)


def test_in_both_orders_a_match_is_a_difference_of_zero(network, observations):
    proposed, target = observations
    assert not network.both_orders(proposed, proposed).any()
    assert network(proposed, proposed).abs().max() > 0.01
    torch.testing.assert_close(
        network.both_orders(proposed, target), -network.both_orders(target, proposed), rtol=0, atol=0
    )


@pytest.fixture
def saved(network, tmp_path):
    path = tmp_path / "net.safetensors"
    save_network(
        path, NetworkFile(network, {"seed": "7"}, torch.tensor([0.2, 0.1]), torch.tensor([0.3, 0.2]))
    )
    return path


def test_a_file_gives_back_the_same_network(network, observations, saved):
    read = load_network(saved)
    torch.testing.assert_close(read.network(*observations), network(*observations), rtol=0, atol=0)
    assert read.metadata["seed"] == "7"
    assert read.training.tolist() == pytest.approx([0.2, 0.1])
    assert read.heldout.tolist() == pytest.approx([0.3, 0.2])


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.99999])
def test_a_file_cut_short_is_told_in_one_line(saved, share):
    data = saved.read_bytes()
    saved.write_bytes(data[: int(share * len(data))])
    with pytest.raises(IrtError, match=r"net\.safetensors: cut short or no safetensors file") as caught:
        load_network(saved)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_told():
    with pytest.raises(IrtError, match="nowhere: no such file"):
        load_network("nowhere")


def test_something_else_in_safetensors_is_told(tmp_path):
    write_tensors(tmp_path / "other", {"x": torch.zeros(3)}, {"format": "pt"})
    with pytest.raises(IrtError, match="other: not a trained network"):
        load_network(tmp_path / "other")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("network.joined.weight", torch.zeros(256, 256), r"joined\.weight is of shape \(256, 256\)"),
        ("network.difference.bias", None, r"difference\.bias is missing; expected shape \(5,\)"),
        ("network.proposed.weight", None, "no weights for the proposed observation"),
        (
            "network.target.bias",
            torch.full((256,), torch.nan),
            r"target\.bias holds values that are not finite",
        ),
    ],
)
def test_weights_of_another_shape_are_told(network, tmp_path, name, value, message):
    tensors = {f"network.{key}": weight for key, weight in network.state_dict().items()}
    tensors[name] = value
    write_tensors(
        tmp_path / "net",
        {key: weight for key, weight in tensors.items() if weight is not None},
        {"format": "irt-tunenet-1"},
    )
    with pytest.raises(IrtError, match=message):
        load_network(tmp_path / "net")
