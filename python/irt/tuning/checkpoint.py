"""Checkpoints of a training: a network's weights, the optimiser's moments, the losses so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from irt.errors import IrtError
from irt.tuning.tensors import read_tensors, weights_of, write_tensors
from irt.tuning.torch_networks import put_weights, shapes_in, weights_in

#: Adam's state of each parameter.
_MOMENTS = ("step", "exp_avg", "exp_avg_sq")


@dataclass(frozen=True)
class Checkpoint:
    """Writes and reads the checkpoints of one training.

    Attributes
    ----------
    path : Path
        The file.
    format : str
        The value of "format" in its metadata.
    metadata : mapping
        Settings of the training.
    same : sequence of str
        Names of the settings that must be equal to resume from it.
    """

    path: Path
    format: str
    metadata: Mapping[str, str]
    same: Sequence[str]

    def save(
        self, network: nn.Module, adam: torch.optim.Optimizer, losses: Mapping[str, Sequence[float]]
    ) -> None:
        """Write the state of the training."""
        tensors = {f"network.{name}": value for name, value in weights_in(network).items()}
        for (name, _), state in zip(
            network.named_parameters(), adam.state_dict()["state"].values(), strict=True
        ):
            tensors |= {f"adam.{key}.{name}": value.cpu().numpy() for key, value in state.items()}
        tensors |= {name: np.array(each, dtype=np.float64) for name, each in losses.items()}
        write_tensors(self.path, tensors, {"format": self.format, **self.metadata})

    def restore(
        self, network: nn.Module, adam: torch.optim.Optimizer, losses: Mapping[str, list[float]]
    ) -> None:
        """Restore the network, the optimiser and the lists of losses.

        Raises
        ------
        IrtError
            If the file cannot be read, is broken, or belongs to another training.
        """
        tensors, found = read_tensors(self.path)
        if found.get("format") != self.format:
            raise IrtError(f"{self.path}: not a checkpoint of this release; train without --resume")
        for name in self.same:
            if found.get(name) != self.metadata[name]:
                raise IrtError(
                    f"{self.path}: of another training: its {name} is {found.get(name)}, not "
                    f"{self.metadata[name]}; give the same options as then, or train without --resume"
                )
        put_weights(network, weights_of(self.path, tensors, shapes_in(network)))
        try:
            state = {
                i: {key: torch.from_numpy(tensors[f"adam.{key}.{name}"]) for key in _MOMENTS}
                for i, (name, _) in enumerate(network.named_parameters())
            }
            for name, each in losses.items():
                each[:] = tensors[name].tolist()
        except KeyError as error:
            raise IrtError(f"{self.path}: broken: it lacks {error}; train without --resume") from error
        adam.load_state_dict({**adam.state_dict(), "state": state})
