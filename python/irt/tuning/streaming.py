"""Training of IRT+ networks on streamed simulations, without repetition.

An interrupted training resumes from its last checkpoint and ends with the same bits as an uninterrupted one,
because random numbers depend only on the seed and the number of the pool.
"""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from irt.catalogue import EffectInfo, hypothetical
from irt.errors import IrtError
from irt.files import PathLike, make_folder
from irt.fitting.fit import Progress
from irt.rig import PARAMETERS
from irt.tuning.checkpoint import Checkpoint
from irt.tuning.coordinates import Coordinates
from irt.tuning.drive import Drive
from irt.tuning.pretrain import best_device, reproducible
from irt.tuning.recipes import PASSES, POOL, Streamed
from irt.tuning.stepnet import StepFile, StepNet, middle, save_steps
from irt.tuning.tensors import checkpoint_path
from irt.tuning.torch_networks import StepModule, weights_in

Array = NDArray[np.float64]

#: Number of pools between checkpoints.
CHECKPOINT_POOLS = 20
#: The value of "format" in a checkpoint's metadata.
CHECKPOINT_FORMAT = "irt-stepnet-checkpoint-1"
#: Number of targets that share a choice of effects.
_TARGETS_AT_ONCE = 512
#: Shares of the proposals in the middle and anywhere in the ranges; the rest are around the target.
_MIDDLE, _ANYWHERE = 0.25, 0.2
#: Decimal logarithms of their distances from the target, in coordinates.
_NEAREST, _FURTHEST = -2.5, 0.0
#: Number of warm-up steps of the learning rate.
_WARM_UP = 200
#: Degrees of freedom of Student's t.
_FREEDOM = 4.0
#: Weight decay of AdamW, and the norm to which gradients are clipped.
_DECAY, _CLIP = 1e-4, 1.0


@dataclass(frozen=True, eq=False)
class Pool:
    """Training pairs: coordinates (n, 5) and observations (n, m) of proposals and targets."""

    proposal: Tensor
    proposed: Tensor
    target: Tensor
    observed: Tensor


def draw_pool(drive: Drive, recipe: Streamed, number: int, count: int, threads: int | None = None) -> Pool:
    """Draw and simulate the pairs of a pool; the same seed and number give the same bits."""
    random = np.random.default_rng([recipe.seed, number])
    coordinates = Coordinates(drive)

    def anywhere(k: int) -> Array:
        return drive.parameters(random.random((k, len(PARAMETERS))))

    truth = anywhere(count)
    target = coordinates.of(truth)
    kind = random.random(count)[:, None]
    distance = 10.0 ** random.uniform(_NEAREST, _FURTHEST, (count, 1))
    about = coordinates.parameters(target + distance * random.standard_normal(target.shape))
    proposal = np.where(
        kind < _MIDDLE, middle(drive), np.where(kind < _MIDDLE + _ANYWHERE, anywhere(count), about)
    )
    observed = np.concatenate(
        [
            drive.inputs(
                drive.simulate(
                    truth[k : k + _TARGETS_AT_ONCE],
                    threads,
                    effects=_affecting(random, recipe, truth[k : k + _TARGETS_AT_ONCE]),
                )
            )
            for k in range(0, count, _TARGETS_AT_ONCE)
        ]
    )
    proposed = drive.inputs(drive.simulate(proposal, threads))
    of_all = (coordinates.of(proposal), proposed, target, observed)
    return Pool(*(torch.from_numpy(each.astype(np.float32)) for each in of_all))


def train_steps(
    drive: Drive,
    path: PathLike,
    recipe: Streamed | None = None,
    *,
    resume: bool = False,
    command: str = "",
    device: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> StepFile:
    """Train a network for IRT+ on streamed simulations and write it.

    Parameters
    ----------
    drive : Drive
        The drive of the network.
    path : path
        The file to write; its folder is created. Until it is complete, a checkpoint is beside it.
    recipe : Streamed, optional
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

    Raises
    ------
    IrtError
        If a file cannot be read or written, or the checkpoint is broken or belongs to another training.
    """
    recipe = recipe or Streamed()
    if Path(path).is_dir():
        raise IrtError(f"{path}: is a folder; name the file to write")
    make_folder(Path(path).parent)
    place = torch.device(device or best_device())
    metadata = {
        "drive": drive.digest,
        "engine": drive.engine,
        "recipe": json.dumps(asdict(recipe)),
        "seed": f"{recipe.seed}",
        "samples": f"{recipe.pools * POOL * PASSES}",
        "rollouts": f"{recipe.pools * POOL * 2}",
        "command": command,
    }
    checkpoint = Checkpoint(checkpoint_path(path), CHECKPOINT_FORMAT, metadata, ("drive", "recipe"))
    with reproducible():
        training = _Training(drive, recipe, place, threads)
        if resume:
            checkpoint.restore(training.network, training.adam, training.curves)
        while training.pool < recipe.pools:
            training.run_pool()
            if progress:
                progress(training.pool, recipe.pools, f"training, loss {training.losses[-1]:.3f}")
            if training.pool % CHECKPOINT_POOLS == 0 and training.pool < recipe.pools:
                checkpoint.save(training.network, training.adam, training.curves)
    done = StepFile(
        StepNet(weights_in(training.network)),
        {**metadata, "device": place.type},
        np.array(training.losses, dtype=np.float32),
    )
    save_steps(path, done)
    with suppress(OSError):
        checkpoint.path.unlink()
    return done


class _Training:
    """State of a training: weights, the optimiser's moments, the losses so far."""

    def __init__(self, drive: Drive, recipe: Streamed, place: torch.device, threads: int | None) -> None:
        self.drive, self.recipe, self.place, self.threads = drive, recipe, place, threads
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(recipe.seed)
            self.network = StepModule(drive.input_count)
        first = draw_pool(drive, recipe, 0, _TARGETS_AT_ONCE, threads)
        self.network.input_gain.fill_(1.0 / max(float(first.observed.std()), 1e-6))
        self.network.to(place)
        self.adam = torch.optim.AdamW(
            self.network.parameters(), lr=recipe.learning_rate, weight_decay=_DECAY, fused=True
        )
        self.losses: list[float] = []

    @property
    def curves(self) -> dict[str, list[float]]:
        """The losses by their names in a checkpoint."""
        return {"losses": self.losses}

    @property
    def pool(self) -> int:
        """Number of finished pools."""
        return len(self.losses)

    def run_pool(self) -> None:
        """Simulate a pool and train on it, in batches in random order."""
        number = self.pool
        pool = draw_pool(self.drive, self.recipe, number, POOL, self.threads)
        # Random numbers depend only on the seed and the pool, so a checkpoint does not store their state.
        random = torch.Generator().manual_seed(self.recipe.seed * 1_000_003 + number)
        batches = [
            chosen
            for _ in range(PASSES)
            for chosen in torch.split(torch.randperm(len(pool.target), generator=random), self.recipe.batch)
        ]
        total = torch.zeros((), device=self.place)
        for step, chosen in enumerate(batches):
            self._set_rate(number * len(batches) + step, self.recipe.pools * len(batches))
            loss = self._loss(pool, chosen, random)
            self.adam.zero_grad()
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(self.network.parameters(), _CLIP)
            self.adam.step()
            total += loss.detach()
        self.losses.append(float(total) / len(batches))

    def _set_rate(self, step: int, steps: int) -> None:
        rise = min(1.0, (step + 1) / _WARM_UP)
        fall = 0.5 * (1.0 + math.cos(math.pi * step / steps))
        self.adam.param_groups[0]["lr"] = self.recipe.learning_rate * rise * fall

    def _loss(self, pool: Pool, chosen: Tensor, random: torch.Generator) -> Tensor:
        """Negative log-likelihood of the targets' coordinates under Student's t, up to a constant.

        Its tails limit the influence of the few targets that no parameters match.
        """
        least, largest = self.recipe.noise
        observed = pool.observed[chosen]
        level = torch.rand((len(chosen), 1), generator=random)
        noisy = torch.rand((len(chosen), 1), generator=random) < 0.5
        drawn = torch.randn(observed.shape, generator=random)
        observed = observed + noisy * least * (largest / least) ** level * drawn
        asked = (pool.proposal[chosen], pool.proposed[chosen], observed, pool.target[chosen])
        proposal, proposed, observed, target = (each.to(self.place) for each in asked)
        mean, log_deviation = self.network(proposal, proposed, observed)
        off = (target - mean) * torch.exp(-log_deviation)
        nats = 0.5 * (_FREEDOM + 1.0) * torch.log1p(off.square() / _FREEDOM)
        loss: Tensor = (log_deviation + nats).mean()
        return loss


def _affecting(random: np.random.Generator, recipe: Streamed, parameters: Array) -> list[dict[str, object]]:
    """Draw one or two effects for some of (k, 5) targets; for the others they are neutral."""
    known = hypothetical()
    chosen = random.choice(len(known), int(random.integers(1, 3)), replace=False)
    affected = random.random(len(parameters)) < recipe.affected
    return [_drawn(random, known[i], affected) for i in sorted(chosen)] if affected.any() else []


def _drawn(random: np.random.Generator, info: EffectInfo, affected: NDArray[np.bool_]) -> dict[str, object]:
    """Draw the parameters of an effect, small values more often than large ones."""
    size = random.random(len(affected)) ** 2
    drawn: dict[str, object] = {"name": info.name}
    for one in info.required:
        plausible = random.uniform(one.low, one.high, len(affected))
        if one.is_choice:
            value = random.choice(one.choices, len(affected))
        elif np.isfinite(one.neutral):
            value = one.neutral + size * (plausible - one.neutral)
        else:
            value = plausible / np.maximum(size, 1e-3)
        drawn[one.name] = np.where(affected, value, one.neutral)
    return drawn
