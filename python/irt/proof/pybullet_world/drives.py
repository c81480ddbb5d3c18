"""Excitations of the knobs, and start positions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .physics import EDGE_X_M, EDGE_Y_M, GRAVITY, RADIUS_M, Array

ROWS = 120
#: The knobs' largest angle [rad], as of the game's servo.
MOST_RAD, LEAST_RAD = 0.15, 0.03

Random = np.random.Generator


def paper(random: Random) -> Array:
    """Draw the paper's sinusoid, a period of 100 rows, in either direction and from any phase."""
    phase = 2.0 * np.pi * np.arange(ROWS) / 100.0 + random.uniform(0.0, 2.0 * np.pi)
    return np.asarray(np.stack([np.sin(phase), np.cos(phase)], axis=1) * random.choice([-1.0, 1.0], 2))


def multisine(random: Random) -> Array:
    """Draw sums of four sines of up to seven periods."""
    periods = random.uniform(0.7, 7.0, (4, 2))
    angles = 2.0 * np.pi * np.arange(ROWS)[:, None, None] / ROWS * periods + random.uniform(0, 6.3, (4, 2))
    return np.asarray((np.sin(angles) * random.uniform(0.4, 1.0, (4, 2))).sum(axis=1))


def steps(random: Random) -> Array:
    """Draw levels that each knob holds for 5 to 20 rows."""
    return np.stack([_levels(random, 5, 20) for _ in range(2)], axis=1)


def holds(random: Random) -> Array:
    """Draw pulses of 4 to 10 rows with level knobs in between, in which the marble coasts."""
    pushes = _levels(random, 8, 16)
    quiet = np.zeros(ROWS, dtype=bool)
    row = int(random.integers(4, 10))
    while row < ROWS:
        end = row + int(random.integers(4, 9))
        quiet[row:end] = True
        row = end + int(random.integers(4, 11))
    other = _levels(random, 8, 16)
    return np.where(quiet[:, None], 0.0, np.stack([pushes, other], axis=1))


def chirp(random: Random) -> Array:
    """Draw chirps from half a period per run to up to five."""
    time = np.arange(ROWS) / ROWS
    end = random.uniform(2.0, 5.0, 2)
    phase = 2.0 * np.pi * (0.5 * time[:, None] + 0.5 * (end - 0.5) * time[:, None] ** 2)
    return np.asarray(np.sin(phase + random.uniform(0.0, 2.0 * np.pi, 2)))


def single(random: Random) -> Array:
    """Draw a drive of one knob, while the other stays level."""
    other = (multisine, steps, chirp, holds)[int(random.integers(4))](random)
    other[:, int(random.integers(2))] = 0.0
    return other


DRIVES: dict[str, Callable[[Random], Array]] = {
    "paper": paper,
    "multisine": multisine,
    "steps": steps,
    "holds": holds,
    "chirp": chirp,
    "single": single,
}


def drive(kind: str, random: Random, gears: tuple[float, float], row_s: float) -> Array:
    """Draw commands (ROWS, 2) [rad] with six digits, at most `MOST_RAD`.

    Each knob's amplitude is chosen so that without friction and rim the marble would move over 1 to 3 times
    half the board's edge; the commands ramp up over three rows.
    """
    shape = DRIVES[kind](random) * np.minimum(1.0, np.arange(ROWS) / 3.0)[:, None]
    knobs = np.zeros_like(shape)
    for axis, (gear, edge) in enumerate(zip(gears, (EDGE_Y_M, EDGE_X_M), strict=True)):
        size = np.abs(shape[:, axis]).max()
        if size == 0.0:
            continue
        unit = shape[:, axis] / size
        per_rad = 5.0 / 7.0 * GRAVITY * gear * row_s**2
        reach = per_rad * np.ptp(np.cumsum(np.cumsum(unit)))
        wanted = float(random.uniform(1.0, 3.0)) * edge / 2.0
        knobs[:, axis] = min(max(wanted / reach, LEAST_RAD), MOST_RAD) * unit
    # Adding zero removes the sign of negative zeros.
    return knobs.round(6) + 0.0


def start(kind: str, random: Random) -> tuple[float, float]:
    """Draw the start position [m]: "centre", or "anywhere" well inside the rim."""
    if kind == "centre":
        return 0.0, 0.0
    room = np.array([EDGE_X_M, EDGE_Y_M]) / 2.0 - RADIUS_M
    x, y = random.uniform(-0.7, 0.7, 2) * room
    return round(float(x), 4), round(float(y), 4)


def _levels(random: Random, shortest: int, longest: int) -> Array:
    levels: list[float] = []
    while len(levels) < ROWS:
        sign = -np.sign(levels[-1]) if levels and random.random() < 0.7 else random.choice([-1.0, 1.0])
        level = float(sign * random.uniform(0.3, 1.0))
        levels += [level] * int(random.integers(shortest, longest + 1))
    return np.array(levels[:ROWS])
