"""The tuning network and its file: two observations in, the difference of their parameters out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from irt.errors import IrtError
from irt.files import PathLike, write_atomic
from irt.rig import PARAMETERS

HIDDEN = 256
#: What the metadata of a network file says under "format".
FORMAT = "irt-tunenet-1"
#: The entry of a safetensors header that holds all metadata, as JSON.
_METADATA = "irt"


class TuneNet(nn.Module):
    """TuneNet (Allevato et al., 2019) with the paper's hidden layer of 256 (paper, section 5.3).

    Each observation goes through a linear layer of its own with ReLU; both results, proposed first, go
    through another linear layer with ReLU and one with tanh: 235,525 weights for 200 inputs.

    Parameters
    ----------
    inputs : int
        Samples of one observation.
    """

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.proposed = nn.Linear(inputs, HIDDEN)
        self.target = nn.Linear(inputs, HIDDEN)
        self.joined = nn.Linear(2 * HIDDEN, HIDDEN)
        self.difference = nn.Linear(HIDDEN, len(PARAMETERS))
        #: What observations are multiplied by. Not a weight: 1 for the paper's drive.
        self.input_gain: Tensor
        self.register_buffer("input_gain", torch.ones(()))

    def forward(self, proposed: Tensor, target: Tensor) -> Tensor:
        """Estimate (k, 5) scaled parameters of the target minus those of the proposal.

        Parameters
        ----------
        proposed, target : (k, inputs) tensor
            Observations.
        """
        of_proposed = torch.relu(self.proposed(self.input_gain * proposed))
        of_target = torch.relu(self.target(self.input_gain * target))
        joined = torch.relu(self.joined(torch.cat([of_proposed, of_target], dim=1)))
        estimated: Tensor = torch.tanh(self.difference(joined))
        return estimated

    def both_orders(self, proposed: Tensor, target: Tensor) -> Tensor:
        """Estimate as `forward`, as half the difference between both orders of the two observations.

        A parameter difference changes its sign when the two are swapped. The network only nearly knows: this
        way an exact match is a fixed point of the iteration, wherever it lies.
        """
        forth: Tensor = self(proposed, target)
        back: Tensor = self(target, proposed)
        return 0.5 * (forth - back)


@dataclass(frozen=True, eq=False)
class NetworkFile:
    """A trained network, and what is known about it.

    Attributes
    ----------
    network : TuneNet
        On the processor, in evaluation mode.
    metadata : dict
        Text by name: drive, ranges, engine, seed, pairs, epochs, heldout_loss, command, data, ...
    training, heldout : (epochs,) tensor
        Loss after each epoch: mean squared error of the scaled parameter difference.
    """

    network: TuneNet
    metadata: dict[str, str]
    training: Tensor
    heldout: Tensor


def save_network(path: PathLike, file: NetworkFile) -> None:
    """Write a trained network as safetensors, atomically.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    tensors = {f"network.{name}": value for name, value in file.network.state_dict().items()}
    tensors |= {"loss.training": file.training, "loss.heldout": file.heldout}
    write_tensors(path, tensors, {"format": FORMAT, **file.metadata})


def load_network(path: PathLike) -> NetworkFile:
    """Read a trained network.

    Raises
    ------
    IrtError
        If the file is missing, cut short, no tuning network, or one of another shape.
    """
    tensors, metadata = read_tensors(path)
    if metadata.get("format") != FORMAT:
        raise IrtError(f"{path}: not a trained network of this release; make one with 'irt pretrain'")
    first = tensors.get("network.proposed.weight", torch.empty(0))
    if first.ndim != 2:
        raise IrtError(f"{path}: broken: it holds no weights for the proposed observation")
    network = TuneNet(first.shape[1])
    load_weights(path, network, tensors)
    losses = [tensors.get(f"loss.{name}", torch.empty(0)) for name in ("training", "heldout")]
    return NetworkFile(network.eval(), metadata, *losses)


def load_weights(path: PathLike, network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Put the weights of a file, named ``network.*``, into a network.

    Raises
    ------
    IrtError
        If one is missing or of another shape, or not finite.
    """
    weights = {}
    for name, wanted in network.state_dict().items():
        found = tensors.get(f"network.{name}")
        if found is None or found.shape != wanted.shape:
            shape = "missing" if found is None else f"of shape {tuple(found.shape)}"
            raise IrtError(f"{path}: network.{name} is {shape}; expected shape {tuple(wanted.shape)}")
        if not bool(torch.isfinite(found).all()):
            raise IrtError(f"{path}: network.{name} holds values that are not finite; train it anew")
        weights[name] = found
    network.load_state_dict(weights)


def write_tensors(path: PathLike, tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> None:
    """Write tensors as safetensors, atomically.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    plain = {name: value.detach().to("cpu").contiguous() for name, value in tensors.items()}
    # In one entry: several are written in an order that changes from run to run.
    write_atomic(path, save(plain, {_METADATA: json.dumps(metadata, sort_keys=True)}))


def read_tensors(path: PathLike) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read the tensors and the metadata of a safetensors file.

    Raises
    ------
    IrtError
        If the file is missing, cut short or no safetensors file.
    """
    if not Path(path).is_file():
        raise IrtError(f"{path}: no such file")
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # not a mapping
            metadata = json.loads((file.metadata() or {}).get(_METADATA, "{}"))
    except (SafetensorError, OSError, ValueError) as error:
        raise IrtError(f"{path}: cut short or no safetensors file ({error}); make it anew") from error
    return tensors, metadata
