"""Pretraining: a network learns parameter differences from pairs of simulations.

An interrupted training resumes from its last checkpoint and ends with the same bits as an uninterrupted one:
random numbers depend only on the seed and the epoch, and all other state is in the checkpoint.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from irt.errors import IrtError
from irt.files import PathLike, make_folder
from irt.fitting.fit import Progress
from irt.rig import PARAMETERS
from irt.tuning.checkpoint import Checkpoint
from irt.tuning.drive import Drive
from irt.tuning.pairs import Pairs, simulate_pairs
from irt.tuning.recipes import Recipe
from irt.tuning.tensors import checkpoint_path, read_tensors
from irt.tuning.torch_networks import TuneModule, weights_in
from irt.tuning.tunenet import NetworkFile, TuneNet, save_network
from irt.workers import Workers

#: Number of epochs between checkpoints.
CHECKPOINT_EPOCHS = 5
#: The value of "format" in a checkpoint's metadata.
CHECKPOINT_FORMAT = "irt-tunenet-checkpoint-1"
#: Batch size of the held-out loss.
_HELDOUT_BATCH = 1000


def pretrain(
    drive: Drive,
    path: PathLike,
    recipe: Recipe | None = None,
    *,
    resume: bool = False,
    command: str = "",
    device: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    workers: Workers | None = None,
) -> NetworkFile:
    """Simulate pairs, train a network on them and write it.

    Parameters
    ----------
    drive : Drive
        The drive of the network.
    path : path
        The file to write; its folder is created. Until it is complete, a checkpoint is beside it
        (`checkpoint_path`).
    recipe : Recipe, optional
        Settings of the training.
    resume : bool
        Resume from the checkpoint.
    command : str
        The command to record in the file's metadata.
    device : str, optional
        Device of the training; by default CUDA or Apple's MPS if available, else the CPU.
    threads : int, optional
        Threads of the simulations; the result does not depend on them.
    progress : callable, optional
        Called with (done, total, text).
    workers : Workers, optional
        Workers for the simulations, instead of this process; the result does not depend on them.

    Returns
    -------
    NetworkFile
        The written network.

    Raises
    ------
    IrtError
        If a file cannot be read or written, or the checkpoint is broken or belongs to another training.
    """
    recipe = recipe or Recipe()
    if Path(path).is_dir():
        raise IrtError(f"{path}: is a folder; name the file to write")
    make_folder(Path(path).parent)
    if resume:
        # Checked before the simulations.
        read_tensors(checkpoint_path(path))
    pairs = simulate_pairs(
        drive, recipe.pairs, recipe.seed, threads=threads, progress=progress, workers=workers
    )
    metadata = _metadata(drive, recipe, pairs, command)
    checkpoint = Checkpoint(checkpoint_path(path), CHECKPOINT_FORMAT, metadata, ("drive", "recipe", "data"))
    place = torch.device(device or best_device())
    with reproducible():
        training = _Training(drive, recipe, pairs.to(place))
        if resume:
            checkpoint.restore(training.network, training.adam, training.curves)
        for epoch in range(training.epoch, recipe.epochs):
            training.run_epoch()
            if progress:
                text = f"training, held-out loss {training.heldout[-1]:.4f}"
                progress(epoch + 1, recipe.epochs, text)
            if (epoch + 1) % CHECKPOINT_EPOCHS == 0 and epoch + 1 < recipe.epochs:
                checkpoint.save(training.network, training.adam, training.curves)
    done = NetworkFile(
        TuneNet(weights_in(training.network)),
        {**metadata, "heldout_loss": repr(training.heldout[-1]), "device": place.type},
        np.array(training.losses, dtype=np.float32),
        np.array(training.heldout, dtype=np.float32),
    )
    save_network(path, done)
    with suppress(OSError):
        checkpoint.path.unlink()
    return done


def best_device() -> str:
    """Return the device to train on: "cuda", "mps" or "cpu"."""
    if torch.cuda.is_available():
        return "cuda"
    return "mps" if torch.backends.mps.is_available() else "cpu"


def checked_device(name: str) -> str:
    """Return the name of an available device.

    Raises
    ------
    IrtError
        If it is not available.
    """
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise IrtError(f"no device {name} here: {str(error).splitlines()[0]}; leave --device out") from error
    return name


class _Training:
    """State of a training: weights, Adam's moments, the losses so far."""

    def __init__(self, drive: Drive, recipe: Recipe, pairs: Pairs) -> None:
        self.recipe, self.pairs = recipe, pairs
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(recipe.seed)
            self.network = TuneModule(drive.input_count)
        self.network.input_gain.fill_(pairs.gain)
        self.network.to(pairs.scaled.device)
        self.adam = torch.optim.Adam(self.network.parameters(), lr=recipe.learning_rate, fused=True)
        self.losses: list[float] = []
        self.heldout: list[float] = []

    @property
    def curves(self) -> dict[str, list[float]]:
        """The losses by their names in a checkpoint."""
        return {"loss.training": self.losses, "loss.heldout": self.heldout}

    @property
    def epoch(self) -> int:
        """Number of finished epochs."""
        return len(self.losses)

    def run_epoch(self) -> None:
        """Train on every pair once, and compute the loss on the held-out pairs."""
        # Random numbers depend only on the seed and the epoch, so a checkpoint does not store their state.
        state = self.recipe.seed * 1_000_003 + self.epoch
        proposed, target = self._deal(torch.Generator().manual_seed(state))
        noise = torch.Generator(self.pairs.inputs.device).manual_seed(state)
        batches = range(0, self.recipe.pairs, self.recipe.batch)
        total = torch.zeros((), device=proposed.device)
        for step, first in enumerate(batches):
            stretch = slice(first, first + self.recipe.batch)
            self._set_rate((self.epoch + step / len(batches)) / self.recipe.epochs)
            loss = self._loss(proposed[stretch], target[stretch], noise)
            self.adam.zero_grad()
            torch.autograd.backward(loss)
            self.adam.step()
            total += loss.detach() * len(proposed[stretch])
        # Both at the end: `epoch` counts the losses, and the rate above depends on it.
        self.heldout.append(self._heldout_loss())
        self.losses.append(float(total) / self.recipe.pairs)

    def _deal(self, random: torch.Generator) -> tuple[Tensor, Tensor]:
        """Return the indices of proposals and of targets, in a random order."""
        count = self.recipe.pairs
        if self.recipe.dealing == "every epoch":
            order = torch.randperm(2 * count, generator=random)
            proposed, target = order[:count], order[count:]
        else:
            proposed = torch.randperm(count, generator=random)
            target = proposed + count
        place = self.pairs.scaled.device
        return proposed.to(place), target.to(place)

    def _set_rate(self, done: float) -> None:
        if self.recipe.schedule == "cosine":
            rate = self.recipe.learning_rate * 0.5 * (1.0 + math.cos(math.pi * done))
            self.adam.param_groups[0]["lr"] = rate

    def _loss(self, proposed: Tensor, target: Tensor, noise: torch.Generator | None = None) -> Tensor:
        """Mean squared error of the scaled parameter difference (paper, Eq. 2, without regularisation)."""
        pairs = self.pairs
        observed = pairs.inputs[target]
        least, largest = self.recipe.noise
        if noise is not None and least > 0.0:
            level = torch.rand((len(observed), 1), generator=noise, device=observed.device)
            drawn = torch.randn(observed.shape, generator=noise, device=observed.device)
            observed = observed + least * (largest / least) ** level * drawn
        if self.recipe.task == "parameters":
            estimated = self.network(torch.zeros_like(observed), observed)
            return torch.nn.functional.mse_loss(estimated, pairs.scaled[target])
        estimated = self.network(pairs.inputs[proposed], observed)
        return torch.nn.functional.mse_loss(estimated, pairs.scaled[target] - pairs.scaled[proposed])

    @torch.no_grad()
    def _heldout_loss(self) -> float:
        first, count = 2 * self.recipe.pairs, self.pairs.heldout
        index = torch.arange(first, first + count, device=self.pairs.scaled.device)
        total = 0.0
        for proposed in torch.split(index, _HELDOUT_BATCH):
            total += float(self._loss(proposed, proposed + count)) * len(proposed)
        return total / count


def _metadata(drive: Drive, recipe: Recipe, pairs: Pairs, command: str) -> dict[str, str]:
    """Return the metadata of a training."""
    return {
        "drive": drive.digest,
        "engine": drive.engine,
        "ranges": json.dumps({name: drive.ranges[name] for name in PARAMETERS}),
        "recipe": json.dumps(asdict(recipe)),
        "seed": f"{recipe.seed}",
        "task": recipe.task,
        "pairs": f"{recipe.pairs}",
        "epochs": f"{recipe.epochs}",
        "data": pairs.digest,
        "command": command,
    }


@contextmanager
def reproducible() -> Iterator[None]:
    """Train on one thread, by algorithms that give the same bits every time.

    More threads do not help, because the layers are small.
    """
    threads, deterministic = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    # Read when CUDA's matrix library starts; deterministic algorithms require it.
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.use_deterministic_algorithms(deterministic)
