"""Logs of made-up labs with known truth: a simulated board and marble, logged in a random convention."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from irt.rig import Board, Marble
from irt.rollouts import rollouts

#: The truth is simulated at this rate [Hz]: the engine's own.
FINE = 240.0
BEGIN = 1_700_000_000.0


@dataclass
class Truth:
    """One run in the board's own frame; tilt by the right-hand rule.

    ``gear`` (2, 2) is in rad per unit of command: tilt_x, tilt_y by command 1, 2.
    """

    stamps: np.ndarray
    marble_m: np.ndarray
    tilt: np.ndarray
    command_stamps: np.ndarray
    commands: np.ndarray
    gear: np.ndarray
    delay: float
    lag: float
    held: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    jumped: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))


@dataclass
class Convention:
    """How a lab logs: signs and swaps of its columns, and what its clocks differ by."""

    marble_signs: np.ndarray
    tilt_swap: bool
    tilt_signs: np.ndarray
    offset: float

    def marble(self, truth: Truth) -> np.ndarray:
        return truth.marble_m * self.marble_signs

    def tilt(self, truth: Truth) -> np.ndarray:
        """Logged tilt, (n, 2) [rad]."""
        tilt = truth.tilt * self.tilt_signs
        return tilt[:, ::-1] if self.tilt_swap else tilt

    def expected_tilt(self, truth: Truth) -> np.ndarray:
        """Tilt about x and y in the frame of the logged marble, (n, 2) [rad]."""
        # x'' = +5/7 g tilt_y and y'' = -5/7 g tilt_x hold in any mirrored frame, if the tilts are mirrored so.
        return truth.tilt * self.marble_signs[::-1]

    def expected_gear(self, truth: Truth) -> np.ndarray:
        """Gear from the logged commands to `expected_tilt`, (2, 2)."""
        return self.marble_signs[::-1, None] * truth.gear


def draw_convention(rng: np.random.Generator) -> Convention:
    signs = rng.choice([-1.0, 1.0], size=(2, 2))
    return Convention(signs[0], bool(rng.integers(2)), signs[1], float(rng.uniform(-0.3, 0.3)))


def draw_gear(rng: np.random.Generator, unit: float) -> np.ndarray:
    """A gear of either order and signs; in a third of the draws each command moves both axes alike."""
    gear = np.diag(rng.choice([-1.0, 1.0], size=2) * rng.uniform(0.7, 1.4, size=2) / unit)
    if rng.integers(2):
        gear = gear[:, ::-1]
    if rng.integers(3) == 0:
        turn = np.pi / 4.0
        gear = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ gear
    return gear


def simulate(
    rng: np.random.Generator,
    *,
    seconds: float = 60.0,
    rate: float = 55.0,
    unit: float = 1.0,
    board: Board | None = None,
    jitter: float = 0.001,
    spoil: bool = True,
) -> Truth:
    """Simulate a run: commands in steps, a chain of gear, dead time and lag, a marble, a camera with noise.

    Commands are of the order 0.03 rad x ``unit``. With ``spoil``, places of a lost marble are held, and the
    tilt jumps where a marker is hidden.
    """
    board = board or Board(wall_restitution=0.3)
    delay, lag = rng.uniform(0.03, 0.09), rng.uniform(0.02, 0.15)
    gear = draw_gear(rng, unit)
    # Event-driven commands: a new one after 30 to 120 ms, and now and then silence.
    gaps = rng.uniform(0.03, 0.12, size=int(40 * seconds))
    gaps[rng.random(gaps.size) < 0.02] += 1.0
    command_stamps = np.cumsum(gaps) - 0.5
    command_stamps = command_stamps[command_stamps < seconds + 0.5]
    phases, rates = rng.uniform(0, 2 * np.pi, (4, 2)), rng.uniform(1.5, 7.0, (4, 2))
    waves = np.sin(rates * command_stamps[:, None, None] + phases).sum(axis=1) / 2.0
    commands = unit * (0.045 * waves + 0.008 * rng.standard_normal(waves.shape))
    fine = np.arange(-0.5, seconds + 0.1, 1.0 / FINE)
    # A command counts from the next fine step on, half a step late on average.
    since = fine - delay + 0.5 / FINE
    asked = (commands @ gear.T)[np.clip(np.searchsorted(command_stamps, since, "right") - 1, 0, None)]
    tilt = np.empty_like(asked)
    tilt[0] = asked[0]
    decay = np.exp(-1.0 / (FINE * lag))
    for row in range(1, len(fine)):
        tilt[row] = asked[row - 1] + (tilt[row - 1] - asked[row - 1]) * decay
    level = rng.uniform(-0.01, 0.01, 2)
    rig = SimpleNamespace(board=board, marble=Marble(radius_m=0.006, mass_kg=0.007))
    places = rollouts(
        [[1.0, 1.0, 0.003, 1.0, 1.0]],
        tilt,
        rig=rig,
        start=[0.0, 0.0],
        durations=np.full(len(fine), 1.0 / FINE),
        threads=1,
    )[0]
    stamps = np.arange(0.0, seconds, 1.0 / rate)
    stamps = stamps + rng.uniform(-jitter, jitter, stamps.size)
    marble = np.column_stack([np.interp(stamps, fine, one) for one in places.T]) * board.edge_x_m
    seen = np.column_stack([np.interp(stamps, fine, one) for one in tilt.T]) + level
    marble += 0.0005 * rng.standard_normal(marble.shape)
    seen += np.deg2rad(0.05) * rng.standard_normal(seen.shape)
    held, jumped = np.zeros(stamps.size, dtype=bool), np.zeros(stamps.size, dtype=bool)
    if spoil:
        for first in rng.integers(100, stamps.size - 100, 4):
            rows = slice(first, first + int(rng.integers(3, 20)))
            marble[rows], held[rows] = marble[first - 1], True
        for first in rng.integers(100, stamps.size - 100, 3):
            rows = slice(first, first + int(rng.integers(3, 15)))
            if not jumped[first - 60 : first + 60].any():
                seen[rows] += rng.uniform(0.1, 0.2) * rng.choice([-1.0, 1.0])
                jumped[rows] = True
    return Truth(stamps, marble, seen, command_stamps, commands, gear, delay, lag, held, jumped)


def write_csv(path: Path, columns: dict[str, Sequence[Any] | np.ndarray]) -> Path:
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path
