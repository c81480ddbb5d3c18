"""The network of IRT+: from a proposal and what it lacks, where the target is, and how surely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from irt.errors import IrtError
from irt.files import PathLike
from irt.rig import PARAMETERS
from irt.tuning.coordinates import Coordinates
from irt.tuning.drive import Drive
from irt.tuning.search import Seen
from irt.tuning.tunenet import load_weights, read_tensors, write_tensors

Array = NDArray[np.float64]

HIDDEN, LAYERS = 384, 3
#: What the metadata of a network file says under "format".
FORMAT = "irt-stepnet-1"
#: A residual of this size [observations' standard deviations] calls for a step of full length, smaller ones
#: for steps in proportion.
_LARGE = 0.33
#: Residuals smaller than this [the same] all look alike.
_SMALLEST = 3e-4
#: Ends of the logarithm of the standard deviation that is predicted, in lengths of the step.
_LEAST_LOG, _MOST_LOG = -8.0, 2.0
_FIVE = len(PARAMETERS)


class StepNet(nn.Module):
    """A residual network: proposal, observations and residual in; mean and deviation of the target out.

    The residual goes in at size one, its size beside it, and the step comes out in proportion to that size:
    so a small residual is as easy to read as a large one, and an exact match is nearly a fixed point.

    Parameters
    ----------
    inputs : int
        Samples of one observation (`irt.tuning.drive.Drive.input_count`).
    """

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.enter = nn.Linear(3 * inputs + _FIVE + 1, HIDDEN)
        self.deeper = nn.ModuleList([nn.Linear(HIDDEN, HIDDEN) for _ in range(LAYERS - 1)])
        self.leave = nn.Linear(HIDDEN, 2 * _FIVE)
        #: What observations are multiplied by. Not a weight.
        self.input_gain: Tensor
        self.register_buffer("input_gain", torch.ones(()))

    def forward(self, coordinates: Tensor, proposed: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
        """Estimate the target's coordinates: mean (k, 5) and logarithm of the standard deviation (k, 5).

        Parameters
        ----------
        coordinates : (k, 5) tensor
            Of the proposal (`irt.tuning.coordinates.Coordinates`).
        proposed, target : (k, inputs) tensor
            Observations.
        """
        proposed, target = self.input_gain * proposed, self.input_gain * target
        residual = target - proposed
        size = (residual.square().mean(dim=1, keepdim=True) + _SMALLEST**2).sqrt()
        seen = torch.cat([coordinates, proposed, target, residual / size, torch.log(size)], dim=1)
        hidden = nn.functional.silu(self.enter(seen))
        for layer in self.deeper:
            hidden = hidden + nn.functional.silu(layer(hidden))
        step, log_deviation = self.leave(hidden).split(_FIVE, dim=1)
        length = (size / _LARGE).clamp(max=1.0)
        return (
            coordinates + length * step,
            torch.log(length) + log_deviation.clamp(_LEAST_LOG, _MOST_LOG),
        )


@dataclass(frozen=True, eq=False)
class Belief:
    """Where the target is, given one proposal: independent normal distributions of k times five coordinates.

    Attributes
    ----------
    mean, deviation : (k, 5) arrays
    """

    mean: Array
    deviation: Array


@dataclass(frozen=True, eq=False)
class StepFile:
    """A trained network for one drive, and what is known about it.

    Attributes
    ----------
    network : StepNet
        On the processor, in evaluation mode.
    metadata : dict
        Text by name: drive, engine, seed, samples, command, ...
    losses : (n,) tensor
        Mean negative log-likelihood of the coordinates over stretches of the training.
    """

    network: StepNet
    metadata: dict[str, str]
    losses: Tensor

    def ask(self, drive: Drive, seen: Seen, *, joint: bool = True) -> Belief:
        """Say where the target is, given k proposals for a drive.

        A network for one run that is repeated (`irt.tuning.cache.Need.joint`) is asked about each run, and
        the means are averaged.
        """
        target = [p + m for p, m in zip(seen.proposed, seen.missing, strict=True)]
        coordinates = Coordinates(drive).of(seen.parameters)
        if joint:
            return self._believe(coordinates, drive.inputs(seen.proposed), drive.inputs(target))
        runs = [
            self._believe(coordinates, p.reshape(len(p), -1), t.reshape(len(t), -1))
            for p, t in zip(seen.proposed, target, strict=True)
        ]
        return Belief(
            *(np.mean([getattr(one, name) for one in runs], axis=0) for name in ("mean", "deviation"))
        )

    @torch.no_grad()
    def _believe(self, coordinates: Array, proposed: Array, target: Array) -> Belief:
        tensors = (torch.tensor(each, dtype=torch.float32) for each in (coordinates, proposed, target))
        mean, log_deviation = self.network(*tensors)
        return Belief(mean.double().numpy(), log_deviation.exp().double().numpy())


def save_steps(path: PathLike, file: StepFile) -> None:
    """Write a trained network as safetensors, in half precision, atomically.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    tensors = {f"network.{name}": value.half() for name, value in file.network.state_dict().items()}
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
    first = tensors.get("network.enter.weight", torch.empty(0))
    inputs = (first.shape[1] - _FIVE - 1) // 3 if first.ndim == 2 else 0
    if inputs < 1:
        raise IrtError(f"{path}: broken: it holds no weights for the observations")
    network = StepNet(inputs)
    whole = {name: value.float() if value.is_floating_point() else value for name, value in tensors.items()}
    load_weights(path, network, whole)
    return StepFile(network.eval(), metadata, whole.get("losses", torch.empty(0)))


def middle(drive: Drive) -> Array:
    """Return the parameters (1, 5) of which the network is asked first: each in the middle of its range."""
    return drive.parameters(np.full((1, _FIVE), 0.5))
