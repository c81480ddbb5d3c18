"""Settings of trainings, without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from irt.errors import IrtError

#: IRT+: number of pairs per pool, and passes over each, with new noise every time.
POOL, PASSES = 8192, 2


@dataclass(frozen=True)
class Recipe:
    """Settings of a network's training.

    Attributes
    ----------
    pairs : int
        Number of training pairs (paper, section 5.2); a tenth as many more are held out.
    epochs : int
        Passes over the pairs.
    seed : int
        Seed of parameters, first weights and the order of the pairs; the same seed gives the same bits on the
        same device.
    batch : int
        Batch size in pairs.
    learning_rate : float
        Learning rate of Adam (paper, section 5.3).
    dealing : {"every epoch", "once"}
        Whether simulations are paired anew every epoch. This costs nothing, and the network sees each pair
        only once. In the paper it is "once".
    schedule : {"cosine", "constant"}
        Whether the learning rate falls to zero along half a cosine, or is constant, as in the paper.
    noise : (float, float)
        Smallest and largest standard deviation of the noise on each target [board edges]: a good tracker's
        noise, and typical residuals of five parameters on a real rig. Log-uniform, redrawn every time. A
        network trained without noise may rely on a few rows, which are not accurate in reality. The paper
        does not mention noise; (0, 0) is none.
    task : {"difference", "parameters"}
        Output of the network: the difference of two sets of parameters, or, for direct prediction, those of
        the target, with zero as the proposed input (paper, section 6.1).
    """

    pairs: int = 10_000
    epochs: int = 200
    seed: int = 0
    batch: int = 50
    learning_rate: float = 3e-4
    dealing: Literal["every epoch", "once"] = "every epoch"
    schedule: Literal["cosine", "constant"] = "cosine"
    noise: tuple[float, float] = (0.0005, 0.05)
    task: Literal["difference", "parameters"] = "difference"

    def __post_init__(self) -> None:
        for name, least in (("pairs", 1), ("epochs", 1), ("seed", 0), ("batch", 1)):
            if getattr(self, name) < least:
                raise IrtError(f"{name} must be at least {least}, not {getattr(self, name)}")


@dataclass(frozen=True)
class Streamed:
    """Settings of the training of an IRT+ network.

    Attributes
    ----------
    samples : int
        Number of training pairs; each is used in `PASSES` passes with different noise.
    seed : int
        Seed of all random numbers.
    batch : int
        Batch size in pairs.
    learning_rate : float
        Learning rate of AdamW, which falls to zero along half a cosine.
    noise : (float, float)
        Smallest and largest standard deviation [board edges] of the noise on half of the targets.
    affected : float
        Share of the targets with one or two effects of the catalogue, of any size, so that the network learns
        to estimate parameters of targets that it cannot match.
    """

    samples: int = 5_000_000
    seed: int = 0
    batch: int = 512
    learning_rate: float = 2e-3
    noise: tuple[float, float] = (0.0003, 0.03)
    affected: float = 0.2

    def __post_init__(self) -> None:
        for name, least in (("samples", 1), ("seed", 0), ("batch", 1)):
            if getattr(self, name) < least:
                raise IrtError(f"{name} must be at least {least}, not {getattr(self, name)}")

    @property
    def pools(self) -> int:
        """Number of pools."""
        return -(-self.samples // (POOL * PASSES))
