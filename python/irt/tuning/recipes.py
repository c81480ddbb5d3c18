"""How networks are trained: settings of the trainings, which themselves need PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from irt.errors import IrtError

#: Of IRT+: pairs simulated at a time, and how often each is learned from, every time with other noise.
POOL, PASSES = 8192, 2


@dataclass(frozen=True)
class Recipe:
    """How a network is trained.

    Attributes
    ----------
    pairs : int
        Pairs to learn from (paper, section 5.2); a tenth as many more are held out.
    epochs : int
        Passes over the pairs.
    seed : int
        Of parameters, first weights and the order of the pairs; the same seed gives the same bits on the same
        device.
    batch : int
        Pairs to one step.
    learning_rate : float
        Of Adam (paper, section 5.3).
    dealing : {"every epoch", "once"}
        Whether simulations are dealt into other pairs every epoch. It costs nothing, and the network sees a
        pair once only. "once" is the paper's.
    schedule : {"cosine", "constant"}
        Whether the learning rate falls to zero along half a cosine, or stays, as in the paper.
    noise : (float, float)
        Least and largest standard deviation of what is added to each target [board edges]: a good tracker's
        scatter, and what five parameters leave of a real rig. Log-uniform, drawn anew every time. A network
        that never saw noise may take a difference from any few rows, and real ones are not that good. The
        paper says nothing of noise; (0, 0) is none.
    task : {"difference", "parameters"}
        What the network is to tell: the difference of two sets of parameters, or, for direct prediction, the
        target's own, its proposed input zero (paper, section 6.1).
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
    """How a network of IRT+ is trained.

    Attributes
    ----------
    samples : int
        Pairs of simulations to learn from; none is repeated but for `PASSES` with other noise.
    seed : int
        Of everything random.
    batch : int
        Pairs to one step.
    learning_rate : float
        Of AdamW; it falls to zero along half a cosine.
    noise : (float, float)
        Least and largest standard deviation [board edges] of what is added to half of the targets.
    affected : float
        Share of the targets that come from a board with an effect of the catalogue or two, of any size: the
        network learns to find the parameters of what it cannot match.
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
        """How many pools that takes."""
        return -(-self.samples // (POOL * PASSES))
