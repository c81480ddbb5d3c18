"""MuJoCo through `mujoco.rollout`, with the fastest settings for which the marble rolls correctly.

Lengths are in marble radii and masses in marbles: MuJoCo takes a rolling friction coefficient, which is a
length, for at least 1e-5, more than this marble's in metres. Gravity acts as an applied force, the one input
of an open-loop rollout that can turn. Settings that make a difference, from measurements on this model:

- the rolling friction of a slow marble is only then that of Coulomb if the friction constraints are stiff
  (`impratio`), and friction constraints that stiff need an elliptic cone and a solver that converges: with
  pyramids, or with ten line search iterations, the path is wrong by a tenth of the board;
- Newton is faster than CG and PGS, Euler than implicitfast; planes are the cheapest walls; a tolerance of
  1e-2 leaves the path as it is.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import local

import mujoco
import numpy as np
from mujoco import rollout

from peers.workload import (
    BOARD,
    MARBLE,
    SUBSTEPS_PER_S,
    Array,
    gravity_in_board,
    observed,
    time_scales,
)

#: Sliding friction of marble and board, enough not to slip.
SLIDING_FRICTION = 0.5
FORCE = mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
#: Not needed here, and faster without.
DISABLED = (
    "actuation", "autoreset", "damper", "equality", "eulerdamp", "filterparent", "island", "limit",
    "midphase", "sensor", "spring",
)  # fmt: skip


def model_xml() -> str:
    """Return the labyrinth as MJCF."""
    half_x, half_y = BOARD.edge_x_m / 2 / MARBLE.radius_m, BOARD.edge_y_m / 2 / MARBLE.radius_m
    walls = [(1, 0, half_x), (-1, 0, half_x), (0, 1, half_y), (0, -1, half_y)]
    planes = "".join(
        f'<geom type="plane" size="100 100 1" pos="{x * far} {y * far} 0" zaxis="{-x} {-y} 0"'
        f' condim="3" friction="{BOARD.wall_friction} 0 0"/>'
        for x, y, far in walls
    )
    flags = " ".join(f'{name}="disable"' for name in DISABLED)
    # A contact as stiff as the substep allows, without rebound.
    contact = f'solref="{2.01 / SUBSTEPS_PER_S} 1" solimp="0.99 0.99 0.001"'
    return f"""
    <mujoco>
      <option timestep="{1 / SUBSTEPS_PER_S}" gravity="0 0 0" integrator="Euler" solver="Newton"
        cone="elliptic" impratio="1000" iterations="20" ls_iterations="50" tolerance="1e-2">
        <flag {flags}/>
      </option>
      <default><geom {contact}/></default>
      <worldbody>
        <geom name="board" type="plane" size="100 100 1" condim="6" friction="{SLIDING_FRICTION} 0 0"/>
        {planes}
        <body pos="0 0 1">
          <freejoint name="free"/>
          <geom type="sphere" size="1" mass="1" condim="1" friction="0 0 0"/>
        </body>
      </worldbody>
    </mujoco>"""


def resting(model: mujoco.MjModel) -> Array:
    """Return the state (1, nstate) of a marble at rest in the centre."""
    data = mujoco.MjData(model)
    state = np.empty((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, data, state[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def forces(parameters: Array, commands: Array, count: int) -> Array:
    """Return the force on the marble (1, substeps, 6) that is gravity, for `count` substeps a row."""
    force = np.zeros((len(commands) - 1, 6))
    force[:, :3] = gravity_in_board(parameters, commands[:-1]) / MARBLE.radius_m
    return np.repeat(force, count, axis=0)[None]


class Simulation:
    """A model with its data; one for each thread."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(model_xml())
        self._data = mujoco.MjData(self.model)
        self._start = resting(self.model)
        self._rollout = rollout.Rollout(nthread=0)

    def run(self, parameters: Array, commands: Array, count: int) -> Array:
        """Return positions (rows, 2) [board edges], with `count` of the model's timesteps a row."""
        positions = np.zeros((len(commands), 2))
        if count and len(commands) > 1:
            self.model.geom("board").friction[2] = parameters[2]
            force = forces(parameters, commands, count)
            state, _ = self._rollout.rollout(
                self.model, self._data, self._start, force, control_spec=FORCE, nstep=force.shape[1]
            )
            positions[1:] = state[0, count - 1 :: count, 1:3] * MARBLE.radius_m
        return observed(positions, parameters)


class Simulations(local):
    """A simulation for each thread."""

    def __init__(self) -> None:
        self.one = Simulation()


class MuJoCo:
    """MuJoCo in one or more threads.

    `rollout`'s own threads need rollouts of equal length, which the paper's are not. Since it releases the
    interpreter lock, Python threads work as well.
    """

    name = "MuJoCo"

    def __init__(self, threads: int) -> None:
        self.threads, self.rollouts = threads, 48 * threads
        self._pool = ThreadPoolExecutor(threads)
        self._simulations = Simulations()

    def simulate(self, parameters: Array, commands: Array) -> Array:
        """Return positions (n, rows, 2) [board edges] of parameters (n, 5) under commands (rows, 2)."""
        counts = time_scales(parameters).tolist()
        return np.stack(list(self._pool.map(self._one, parameters, [commands] * len(counts), counts)))

    def _one(self, parameters: Array, commands: Array, count: int) -> Array:
        return self._simulations.one.run(parameters, commands, count)
