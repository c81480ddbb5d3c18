"""Workload of all engines: the paper's rollouts, and gentle ones to compare paths."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irt.engine import SUBSTEP_S, paper_drive
from irt.rig import PARAMETERS, RANGES, Board, Marble

Array = NDArray[np.float64]

BOARD, MARBLE = Board(), Marble()
GRAVITY = 9.81
#: Substeps per second, as a whole number for engines that count them.
SUBSTEPS_PER_S = round(1 / SUBSTEP_S)
ROWS = 100
#: Rollouts of one of the paper's pretraining sets: 10,000 pairs.
PAPER_ROLLOUTS = 20_000


class Contender(Protocol):
    """One engine, set up with a number of threads or processes."""

    name: str
    threads: int
    rollouts: int
    """Rollouts in one timed repetition, enough to outlast the noise of a shared machine."""

    def simulate(self, parameters: Array, commands: Array) -> Array:
        """Return positions (n, rows, 2) [board edges] of parameters (n, 5) under commands (rows, 2)."""


def spread(count: int, first: int = 0) -> Array:
    """Return parameters (count, 5), from number `first` on, of a draw that fills the paper's ranges evenly.

    The additive recurrence of Roberts (2018), the same draw as in ``crates/labsim/benches/engine.rs``.
    """
    root = 1.23650570339149  # the positive root of x⁶ = x + 1
    steps = np.arange(first + 1, first + count + 1)[:, None] * root ** -np.arange(1.0, 6.0)
    low, high = np.array([RANGES[name] for name in PARAMETERS]).T
    filled: Array = low + (0.5 + steps) % 1.0 * (high - low)
    return filled


def gentle(count: int) -> Array:
    """Return parameters (count, 5) under which the paper's drive keeps the marble moving and off the rim."""
    low = np.array([0.015, 0.015, 0.0001, 9.0, 0.9])
    high = np.array([0.03, 0.03, 0.0004, 14.0, 1.1])
    box = np.array([RANGES[name] for name in PARAMETERS])
    share = (spread(count) - box[:, 0]) / (box[:, 1] - box[:, 0])
    return np.asarray(low + share * (high - low))


def time_scales(parameters: Array) -> NDArray[np.int64]:
    """Return the whole number of substeps a row (n,) of parameters (n, 5), as the paper rounds it."""
    return np.floor(parameters[:, PARAMETERS.index("time_scale")] + 0.5).astype(np.int64)


def substeps(parameters: Array) -> int:
    """Return how many substeps the rollouts of parameters (n, 5) take together."""
    return int(time_scales(parameters).sum()) * (ROWS - 1)


def gravity_in_board(parameters: Array, commands: Array) -> Array:
    """Return gravity (rows, 3) [m/s²] as the board sees it, of parameters (5,) under commands (rows, 2).

    At these tilts a fixed board under a turning gravity is equivalent to a turning board. It avoids jolts by
    changes of the board's tilt in engines with contacts.
    """
    tilt_x, tilt_y = (parameters[:2] * commands).T
    along_x, along_y = np.cos(tilt_x) * np.sin(tilt_y), -np.sin(tilt_x)
    return GRAVITY * np.stack([along_x, along_y, -np.cos(tilt_x) * np.cos(tilt_y)], axis=1)


def observed(positions_m: Array, parameters: Array) -> Array:
    """Return observed positions [board edges] of positions (rows, 2) [m] under parameters (5,)."""
    scale = parameters[PARAMETERS.index("observation_scale")]
    return np.asarray(positions_m / BOARD.edge_x_m * scale)


def drive() -> Array:
    """Return the paper's commands (rows, 2) [rad]."""
    return paper_drive(ROWS)
