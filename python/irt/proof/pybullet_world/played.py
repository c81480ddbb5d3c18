"""A run: from commands, or from a controller that sees the marble, to what a perfect tracker sees."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .engine import STEP_S, Base, Engine, Rolling, Start
from .in_pybullet import PYBULLET
from .physics import EDGE_X_M, Array, Physics

#: Knob angles (n, 2) [rad], each from its row to the next; or a controller, which answers the last picture, a
#: position (2,) [board edges], by the next row's command (2,) [rad], and a number of rows.
Commands = Array | tuple[Callable[[Array], Array], int]


@dataclass(frozen=True)
class Played:
    """The true run, one row for each command.

    Attributes
    ----------
    commands : (n, 2) array
        Knob angles [rad].
    places : (n, 2) array
        The marble's centre [m] at the time of the row's picture.
    tilts : (n, 2) array
        Tilts of the board [rad] at that time.
    seen : (n, 2) array
        Positions of a perfect tracker [board edges].
    """

    commands: Array
    places: Array
    tilts: Array
    seen: Array


def play(
    base: Base,
    commands: Commands,
    start_m: tuple[float, float],
    hidden: Sequence[Physics] = (),
    random: np.random.Generator | None = None,
    *,
    engine: Engine = PYBULLET,
) -> Played:
    """Simulate a run that starts at rest with level knobs.

    Parameters
    ----------
    base : Base
        The five parameters.
    commands : (n, 2) array, or a controller and a number of rows
        A controller answers in each row the last picture that was taken by the row before.
    start_m : tuple
        Position of the marble at row 0 [m].
    hidden : sequence of Physics
        Hidden physics, in the order in which it acts.
    random : Generator
        Generator of random physics; the same seed gives the same run.
    engine : Engine
        Moves the marble.
    """
    controller, count = (None, len(commands)) if isinstance(commands, np.ndarray) else commands
    issued = np.zeros((count, 2)) if controller is not None else np.asarray(commands)
    rows: Array = np.asarray(base.row_s * np.arange(count), dtype=np.float64)
    exposed = rows
    for one in hidden:
        exposed = one.expose(exposed)
    exposed = np.maximum(exposed, np.float64(0.0))
    arrivals = arrival_times(rows, hidden, random or np.random.default_rng(0))
    bell = _bell(engine.turn_s)

    def asked(steps: int) -> Array:
        """Return tilts [rad] that the commands so far ask of the board: of steps, and of half a bell more."""
        return tilt(base, mean_commands(issued, arrivals, steps + len(bell) // 2), hidden)

    def shown(moments: Array) -> tuple[Array, Array, Array]:
        """Return places, tilts and perfect positions (n, 2) in pictures that were exposed at moments [s]."""
        path = rolling.path()
        times = STEP_S * np.arange(len(path))
        places = np.stack([np.interp(moments, times, path[:, axis]) for axis in (0, 1)], axis=1)
        # A picture at the time of a change of the board shows the board before it.
        then = tilts[np.ceil(moments / STEP_S - 1e-9).astype(int)]
        seen = places / EDGE_X_M * base.observation_scale
        for one in hidden:
            seen = one.see(seen, then)
        return places, then, seen

    tilts = asked(0)
    x, y = _smooth(tilts, bell)[0].tolist()
    start = Start(start_m, (x, y))
    with engine.body(base, start, hidden) as body:
        rolling = Rolling(body, base, start, hidden)

        def until(moment: float) -> None:
            nonlocal tilts
            steps = max(1, math.ceil(moment / STEP_S - 1e-9))
            if steps > rolling.steps:
                tilts = asked(steps)
                rolling.go(_smooth(tilts, bell)[rolling.steps + 1 :])

        if controller is not None:
            for row in range(1, count):
                until(rows[row - 1])
                last = int(np.searchsorted(exposed, rows[row - 1], side="right")) - 1
                _, _, seen = shown(exposed[[max(last, 0)]])
                # What is issued later has not arrived when the board begins to turn to this command.
                issued[row:] = controller(seen[0])
        until(exposed.max())
        return Played(issued, *shown(exposed))


def arrival_times(rows: Array, hidden: Sequence[Physics], random: np.random.Generator) -> Array:
    """Return when the commands of rows at times (n,) [s] arrive at the knobs."""
    times = rows
    for one in hidden:
        times = one.arrive(times, random)
    return times


def mean_commands(commands: Array, arrivals: Array, steps: int) -> Array:
    """Return the mean command (steps, 2) in each step, of commands that hold until the next one arrives."""
    # An overtaken command is dropped.
    soonest_after = np.append(np.minimum.accumulate(arrivals[::-1])[::-1][1:], np.inf)
    kept = arrivals < soonest_after
    knots = np.concatenate([[-1.0], arrivals[kept], [max(steps * STEP_S, arrivals[-1]) + 1.0]])
    held = np.concatenate([np.zeros((1, 2)), commands[kept]])
    area = np.concatenate([np.zeros((1, 2)), np.cumsum(held * np.diff(knots)[:, None], axis=0)])
    edges = STEP_S * np.arange(steps + 1)
    return np.stack([np.diff(np.interp(edges, knots, area[:, axis])) / STEP_S for axis in (0, 1)], axis=1)


def tilt(base: Base, knobs: Array, hidden: Sequence[Physics]) -> Array:
    """Return the board's tilts (steps + 1, 2) [rad]: before row 0, then in each step."""
    for one in hidden:
        knobs = one.turn(knobs, STEP_S)
    tilts = np.vstack([np.zeros(2), knobs]) * (base.gear_x, base.gear_y)
    for one in hidden:
        tilts = one.lean(tilts)
    return tilts


def _bell(turn_s: float) -> Array:
    """Return the weights by which a set point is spread over the steps around its own: an odd number."""
    half = round(0.5 * turn_s / STEP_S)
    weights = 1.0 + np.cos(np.pi * np.arange(-half, half + 1) / (half + 1))
    return np.asarray(weights / weights.sum())


def _smooth(tilts: Array, bell: Array) -> Array:
    """Return tilts that take their time from one set point to the next; they end half a bell earlier."""
    half = len(bell) // 2
    if not half:
        return tilts
    padded = np.pad(tilts, ((half, 0), (0, 0)), mode="edge")
    return np.stack([np.convolve(padded[:, axis], bell, mode="valid") for axis in (0, 1)], axis=1)
