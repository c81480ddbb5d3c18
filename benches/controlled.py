"""Commands of a controller that sees the marble, for rigs of `hide_effects`.

A lab that trains or runs a policy records what it commands. Such commands change in every row, reach their
limits, and depend on the marble and on the tracker's noise, as no drive that was drawn beforehand does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.engine import GRAVITY
from irt.rig import Board
from mujoco_world.live import Live

Array = NDArray[np.float64]

#: Bandwidth of a controller [rad/s], its damping ratio, and largest command [rad].
BANDWIDTH, DAMPING, MOST_RAD = (0.7, 3.0), 0.7, 0.15
#: How long a target stays [s], and how far from the middle it is at most, as a part of the way to a rim.
STAYS_S, REACH = (0.8, 3.0), 0.9


def commands(
    values: Array,
    effects: Sequence[dict[str, Any]],
    noise: Array,
    turns: Array,
    *,
    seeds: NDArray[np.int64],
    random: np.random.Generator,
) -> Array:
    """Return what a controller of position and velocity commands (n, rows, 2) [rad].

    Parameters
    ----------
    values : (5,)
        Parameters, as of `mujoco_world.simulate`. The controller knows the gears.
    effects : sequence of dict
        As of `mujoco_world.live.Live`.
    noise : (n, rows, 2)
        Errors of the tracker [board edges], whose positions the controller sees a row late.
    turns : (n, rows, 2)
        Unrecorded turns of the knobs [rad].
    seeds : (n,)
        Of the runs.
    random : Generator
        Draws the controller, and its targets.
    """
    runs, rows = noise.shape[:2]
    live = Live(values, effects, np.zeros((runs, 2)), seeds)
    board = Board()
    limit = REACH * (0.5 * np.array([1.0, board.edge_y_m / board.edge_x_m]))
    wanted = random.uniform(*BANDWIDTH)
    # Of a command about x the marble falls towards -y, of one about y towards +x.
    per_edge = board.edge_x_m / (5.0 / 7.0 * GRAVITY * values[[1, 0]]) * wanted**2
    target = np.zeros((runs, 2))
    until, before, velocity = np.zeros(runs), noise[:, 0], np.zeros((runs, 2))
    issued = np.zeros((runs, rows, 2))
    for row in range(1, rows):
        for run in np.flatnonzero(until <= row * live.row_s):
            target[run] = random.uniform(-limit, limit)
            until[run] += random.uniform(*STAYS_S)
        seen = live.see() + noise[:, row - 1]
        velocity = 0.5 * (velocity + (seen - before) / live.row_s)
        before = seen
        push = per_edge * (target - seen - 2.0 * DAMPING / wanted * velocity)
        issued[:, row] = np.clip(np.stack([-push[:, 1], push[:, 0]], axis=1), -MOST_RAD, MOST_RAD).round(6)
        live.play(issued[:, row] + turns[:, row])
    return issued
