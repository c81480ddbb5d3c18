"""Training data of tuning networks: pairs of simulations with random parameters."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from irt.fitting.fit import Progress
from irt.rig import PARAMETERS
from irt.tuning.drive import Drive
from irt.tuning.shards import of_threads, of_workers
from irt.workers import Workers

#: Timesteps per call: enough work for all threads, with little memory.
_ROWS_AT_ONCE = 500_000


@dataclass(frozen=True, eq=False)
class Pairs:
    """Simulations that are combined into pairs.

    For n training pairs and h held-out pairs, pair i has simulation i < n as proposal and simulation i + n as
    target. The held-out pairs follow: proposals, then targets.

    Attributes
    ----------
    scaled : (2 n + 2 h, 5) tensor
        Parameters scaled to [0, 1].
    inputs : (2 n + 2 h, m) tensor
        The network's inputs from their observations.
    heldout : int
        Number h of held-out pairs.
    gain : float
        Scale of joint observations to unit size; 1 for a single run, as in the paper.
    digest : str
        Hash (SHA-256) of parameters and observations.
    """

    scaled: Tensor
    inputs: Tensor
    heldout: int
    gain: float
    digest: str

    def to(self, device: torch.device) -> Pairs:
        """Return the pairs on a device."""
        return replace(self, scaled=self.scaled.to(device), inputs=self.inputs.to(device))


def simulate_pairs(
    drive: Drive,
    count: int,
    seed: int,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    workers: Workers | None = None,
) -> Pairs:
    """Draw parameters uniformly and simulate them, for ``count`` pairs and a tenth as many held-out ones.

    Parameters
    ----------
    drive : Drive
        The simulated drive.
    count : int
        Number of training pairs.
    seed : int
        The same seed gives the same bits for any number of threads.
    threads : int, optional
        Threads of the engine.
    progress : callable, optional
        Called with (done, total, text).
    workers : Workers, optional
        Workers for the simulations, instead of this process; the bits are the same.

    Raises
    ------
    IrtError
        If a worker fails.
    """
    heldout = max(1, count // 10)
    total = 2 * (count + heldout)
    scaled = np.where(drive.open, np.random.default_rng([seed, 0]).random((total, len(PARAMETERS))), 0.0)
    inputs = np.empty((total, drive.input_count), dtype=np.float32)
    chunk = max(1, _ROWS_AT_ONCE // sum(len(run.knobs) for run in drive.runs))
    shards = {first: scaled[first : first + chunk] for first in range(0, total, chunk)}
    answers = of_workers(workers, drive, shards) if workers else of_threads(drive, shards, threads)
    done = 0
    for first, seen in answers:
        inputs[first : first + chunk] = seen
        done += len(seen)
        if progress:
            progress(done, total, "simulating pairs")
    narrow = scaled.astype(np.float32)
    return Pairs(
        torch.from_numpy(narrow),
        torch.from_numpy(inputs),
        heldout,
        gain=1.0 if len(drive.runs) == 1 else 1.0 / max(float(inputs[: 2 * count].std()), 1e-6),
        digest=hashlib.sha256(narrow.tobytes() + inputs.tobytes()).hexdigest(),
    )
