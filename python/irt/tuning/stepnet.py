"""The network of IRT+: estimates the target and its uncertainty from a proposal and its residual.

The network runs in numpy; `irt.tuning.torch_networks.StepModule` is the same network for training.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from irt.errors import IrtError
from irt.files import PathLike
from irt.rig import PARAMETERS
from irt.tuning.coordinates import Coordinates
from irt.tuning.drive import Drive
from irt.tuning.search import Seen
from irt.tuning.tensors import Floats, linear, linear_shapes, read_tensors, weights_of, write_tensors

Array = NDArray[np.float64]

HIDDEN, LAYERS = 384, 3
#: The value of "format" in a network file's metadata.
FORMAT = "irt-stepnet-1"
#: Size of a residual [observations' standard deviations] for a step of full length; smaller ones give
#: proportional steps.
LARGE = 0.33
#: Lower bound of a residual's size [the same unit].
SMALLEST = 3e-4
#: Bounds of the logarithm of the predicted standard deviation, in lengths of the step.
LOG_DEVIATIONS = (-8.0, 2.0)
_FIVE = len(PARAMETERS)


def entering(inputs: int) -> int:
    """Return the width of the first layer: coordinates, three observations' worth, and a size."""
    return _FIVE + 3 * inputs + 1


@dataclass(frozen=True, eq=False)
class StepNet:
    """A residual network: proposal, observations and residual in; mean and deviation of the target out.

    The input is the residual scaled to unit size, together with its size; the output step is proportional to
    that size. Thus small residuals are as informative as large ones, and an exact match is nearly a fixed
    point.

    Attributes
    ----------
    weights : mapping of str to float32 array
        Arrays by the names in `shapes`. ``input_gain`` is the factor of observations.
    """

    weights: Mapping[str, Floats]

    @staticmethod
    def shapes(inputs: int) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the weights for `irt.tuning.drive.Drive.input_count` samples."""
        shapes = {"input_gain": (), **linear_shapes("enter", entering(inputs), HIDDEN)}
        for layer in range(LAYERS - 1):
            shapes |= linear_shapes(f"deeper.{layer}", HIDDEN, HIDDEN)
        return shapes | linear_shapes("leave", HIDDEN, 2 * _FIVE)

    def __call__(self, coordinates: ArrayLike, proposed: ArrayLike, target: ArrayLike) -> Belief:
        """Estimate the target's coordinates.

        Parameters
        ----------
        coordinates : (k, 5) array
            Coordinates of the proposal (`irt.tuning.coordinates.Coordinates`).
        proposed, target : (k, inputs) arrays
            Observations; the network computes in single precision.
        """
        coordinates = np.asarray(coordinates, dtype=np.float32)
        gain = self.weights["input_gain"]
        proposed = gain * np.asarray(proposed, dtype=np.float32)
        target = gain * np.asarray(target, dtype=np.float32)
        residual = target - proposed
        size = np.sqrt(np.mean(residual**2, axis=1, keepdims=True) + np.float32(SMALLEST**2))
        hidden = self._silu(
            "enter",
            np.concatenate([coordinates, proposed, target, residual / size, np.log(size)], axis=1),
        )
        for layer in range(LAYERS - 1):
            hidden = hidden + self._silu(f"deeper.{layer}", hidden)
        step, log_deviation = np.split(linear(self.weights, "leave", hidden), 2, axis=1)
        length = np.minimum(size / np.float32(LARGE), np.float32(1.0))
        return Belief(
            (coordinates + length * step).astype(np.float64),
            (length * np.exp(np.clip(log_deviation, *LOG_DEVIATIONS))).astype(np.float64),
        )

    def _silu(self, name: str, values: Floats) -> Floats:
        """Return the outputs of a linear layer, each times its logistic function."""
        outputs = linear(self.weights, name, values)
        activated: Floats = outputs * expit(outputs)
        return activated


@dataclass(frozen=True, eq=False)
class Belief:
    """Posterior of the target given one proposal: independent normal distributions of (k, 5) coordinates.

    Attributes
    ----------
    mean, deviation : (k, 5) arrays
    """

    mean: Array
    deviation: Array


@dataclass(frozen=True, eq=False)
class StepFile:
    """A trained network for one drive, with its metadata.

    Attributes
    ----------
    network : StepNet
        The network.
    metadata : dict
        Text by name: drive, engine, seed, samples, command, ...
    losses : (n,) array
        Mean negative log-likelihood of the coordinates over parts of the training.
    """

    network: StepNet
    metadata: dict[str, str]
    losses: NDArray[Any]

    def ask(self, drive: Drive, seen: Seen, *, joint: bool = True) -> Belief:
        """Return the posterior of the target, given k proposals for a drive.

        A network for one repeated run (`irt.tuning.cache.Need.joint`) is evaluated for each run, and the
        means are averaged.
        """
        target = [p + m for p, m in zip(seen.proposed, seen.missing, strict=True)]
        coordinates = Coordinates(drive).of(seen.parameters)
        if joint:
            return self.network(coordinates, drive.inputs(seen.proposed), drive.inputs(target))
        runs = [
            self.network(coordinates, p.reshape(len(p), -1), t.reshape(len(t), -1))
            for p, t in zip(seen.proposed, target, strict=True)
        ]
        return Belief(
            *(np.mean([getattr(one, name) for one in runs], axis=0) for name in ("mean", "deviation"))
        )


def save_steps(path: PathLike, file: StepFile) -> None:
    """Write a trained network as safetensors, in half precision, atomically.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    tensors = {f"network.{name}": value.astype(np.float16) for name, value in file.network.weights.items()}
    write_tensors(path, {**tensors, "losses": file.losses}, {"format": FORMAT, **file.metadata})


def load_steps(path: PathLike) -> StepFile:
    """Read a trained network.

    Raises
    ------
    IrtError
        If the file is missing, cut short, no network of IRT+, or one of another shape.
    """
    tensors, metadata = read_tensors(path)
    if metadata.get("format") != FORMAT:
        raise IrtError(
            f"{path}: not a network of irt+ of this release; make one with 'irt pretrain --method irt+'"
        )
    first = tensors.get("network.enter.weight", np.empty(0))
    inputs = (first.shape[1] - entering(0)) // 3 if first.ndim == 2 else 0
    if inputs < 1:
        raise IrtError(f"{path}: broken: it holds no weights for the observations")
    weights = weights_of(path, tensors, StepNet.shapes(inputs))
    return StepFile(StepNet(weights), metadata, tensors.get("losses", np.empty(0)))


def middle(drive: Drive) -> Array:
    """Return the first proposal (1, 5): each parameter in the middle of its range."""
    return drive.parameters(np.full((1, _FIVE), 0.5))
