"""The networks as PyTorch modules, for training: the same functions as `TuneNet` and `StepNet` of numpy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from irt.rig import PARAMETERS
from irt.tuning import stepnet, tunenet
from irt.tuning.tensors import Floats


class TuneModule(nn.Module):
    """The network of `irt.tuning.tunenet.TuneNet`.

    Parameters
    ----------
    inputs : int
        Samples of one observation.
    """

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.proposed = nn.Linear(inputs, tunenet.HIDDEN)
        self.target = nn.Linear(inputs, tunenet.HIDDEN)
        self.joined = nn.Linear(2 * tunenet.HIDDEN, tunenet.HIDDEN)
        self.difference = nn.Linear(tunenet.HIDDEN, len(PARAMETERS))
        #: Factor of observations; not trained.
        self.input_gain: Tensor
        self.register_buffer("input_gain", torch.ones(()))

    def forward(self, proposed: Tensor, target: Tensor) -> Tensor:
        """Estimate (k, 5) scaled parameters of the target minus those of the proposal, from (k, inputs)."""
        of_proposed = torch.relu(self.proposed(self.input_gain * proposed))
        of_target = torch.relu(self.target(self.input_gain * target))
        joined = torch.relu(self.joined(torch.cat([of_proposed, of_target], dim=1)))
        estimated: Tensor = torch.tanh(self.difference(joined))
        return estimated


class StepModule(nn.Module):
    """The network of `irt.tuning.stepnet.StepNet`.

    Parameters
    ----------
    inputs : int
        Samples of one observation (`irt.tuning.drive.Drive.input_count`).
    """

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.enter = nn.Linear(stepnet.entering(inputs), stepnet.HIDDEN)
        self.deeper = nn.ModuleList(
            [nn.Linear(stepnet.HIDDEN, stepnet.HIDDEN) for _ in range(stepnet.LAYERS - 1)]
        )
        self.leave = nn.Linear(stepnet.HIDDEN, 2 * len(PARAMETERS))
        #: Factor of observations; not trained.
        self.input_gain: Tensor
        self.register_buffer("input_gain", torch.ones(()))

    def forward(self, coordinates: Tensor, proposed: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
        """Estimate the target's coordinates: mean (k, 5) and logarithm of the standard deviation (k, 5).

        Parameters
        ----------
        coordinates : (k, 5) tensor
            Coordinates of the proposal (`irt.tuning.coordinates.Coordinates`).
        proposed, target : (k, inputs) tensor
            Observations.
        """
        proposed, target = self.input_gain * proposed, self.input_gain * target
        residual = target - proposed
        size = (residual.square().mean(dim=1, keepdim=True) + stepnet.SMALLEST**2).sqrt()
        seen = torch.cat([coordinates, proposed, target, residual / size, torch.log(size)], dim=1)
        hidden = nn.functional.silu(self.enter(seen))
        for layer in self.deeper:
            hidden = hidden + nn.functional.silu(layer(hidden))
        step, log_deviation = self.leave(hidden).split(len(PARAMETERS), dim=1)
        length = (size / stepnet.LARGE).clamp(max=1.0)
        return (
            coordinates + length * step,
            torch.log(length) + log_deviation.clamp(*stepnet.LOG_DEVIATIONS),
        )


def weights_in(module: nn.Module) -> dict[str, Floats]:
    """Return copies of the weights and buffers of a module as arrays."""
    return {name: value.detach().cpu().numpy().copy() for name, value in module.state_dict().items()}


def put_weights(module: nn.Module, weights: Mapping[str, Floats]) -> None:
    """Load weights into a module of the same shapes."""
    module.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in weights.items()})


def shapes_in(module: nn.Module) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a module's weights."""
    return {name: tuple(value.shape) for name, value in module.state_dict().items()}
