"""The tuning network, which estimates a parameter difference from two observations, and its file.

The network runs in numpy; `irt.tuning.torch_networks.TuneModule` is the same network for training.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irt.errors import IrtError
from irt.files import PathLike
from irt.rig import PARAMETERS
from irt.tuning.tensors import Floats, linear, linear_shapes, read_tensors, weights_of, write_tensors

Array = NDArray[np.float64]

HIDDEN = 256
#: The value of "format" in a network file's metadata.
FORMAT = "irt-tunenet-1"


@dataclass(frozen=True, eq=False)
class TuneNet:
    """TuneNet (Allevato et al., 2019) with the paper's hidden layer of 256 (paper, section 5.3).

    Each observation passes through its own linear layer with ReLU. Both results, the proposed one first, pass
    through another linear layer with ReLU and one with tanh: 235,525 weights for 200 inputs.

    Attributes
    ----------
    weights : mapping of str to float32 array
        Arrays by the names in `shapes`. ``input_gain`` is the factor of observations: 1 for the paper's
        drive.
    """

    weights: Mapping[str, Floats]

    @staticmethod
    def shapes(inputs: int) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the weights for that many samples of one observation."""
        return {
            "input_gain": (),
            **linear_shapes("proposed", inputs, HIDDEN),
            **linear_shapes("target", inputs, HIDDEN),
            **linear_shapes("joined", 2 * HIDDEN, HIDDEN),
            **linear_shapes("difference", HIDDEN, len(PARAMETERS)),
        }

    @property
    def inputs(self) -> int:
        """Number of samples of one observation."""
        return int(self.weights["proposed.weight"].shape[1])

    def __call__(self, proposed: ArrayLike, target: ArrayLike) -> Array:
        """Estimate (k, 5) scaled parameters of the target minus those of the proposal.

        Parameters
        ----------
        proposed, target : (k, inputs) arrays
            Observations; the network computes in single precision.
        """
        gain = self.weights["input_gain"]
        of_proposed = self._rectified("proposed", gain * np.asarray(proposed, dtype=np.float32))
        of_target = self._rectified("target", gain * np.asarray(target, dtype=np.float32))
        joined = self._rectified("joined", np.concatenate([of_proposed, of_target], axis=1))
        return np.tanh(linear(self.weights, "difference", joined)).astype(np.float64)

    def both_orders(self, proposed: ArrayLike, target: ArrayLike) -> Array:
        """Estimate as half the difference between both orders of the two observations.

        A parameter difference changes its sign when the observations are swapped, which the network has
        learned only approximately. With both orders an exact match is always a fixed point of the iteration.
        """
        return 0.5 * (self(proposed, target) - self(target, proposed))

    def _rectified(self, name: str, values: Floats) -> Floats:
        return np.maximum(linear(self.weights, name, values), np.float32(0.0))


@dataclass(frozen=True, eq=False)
class NetworkFile:
    """A trained network with its metadata.

    Attributes
    ----------
    network : TuneNet
        The network.
    metadata : dict
        Text by name: drive, ranges, engine, seed, pairs, epochs, heldout_loss, command, data, ...
    training, heldout : (epochs,) array
        Loss after each epoch: mean squared error of the scaled parameter difference.
    """

    network: TuneNet
    metadata: dict[str, str]
    training: NDArray[Any]
    heldout: NDArray[Any]


def save_network(path: PathLike, file: NetworkFile) -> None:
    """Write a trained network as safetensors, atomically.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    tensors: dict[str, NDArray[Any]] = {
        f"network.{name}": value for name, value in file.network.weights.items()
    }
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
    first = tensors.get("network.proposed.weight", np.empty(0))
    if first.ndim != 2:
        raise IrtError(f"{path}: broken: it holds no weights for the proposed observation")
    weights = weights_of(path, tensors, TuneNet.shapes(first.shape[1]))
    losses = [tensors.get(f"loss.{name}", np.empty(0)) for name in ("training", "heldout")]
    return NetworkFile(TuneNet(weights), metadata, *losses)
