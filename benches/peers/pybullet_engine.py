"""PyBullet as the paper used it: `stepSimulation` at 1/240 s, one rollout at a time in each process.

The world is built once a process and put back to its start before each rollout; collision shapes, solver and
contact settings are PyBullet's defaults.
"""

from __future__ import annotations

import multiprocessing

import numpy as np
import pybullet

from peers.workload import (
    BOARD,
    MARBLE,
    SUBSTEPS_PER_S,
    Array,
    gravity_in_board,
    observed,
    time_scales,
)

#: PyBullet's default; two bodies multiply to the board's wall friction of 0.25.
LATERAL_FRICTION = 0.5
#: Half thickness of board and rim, and half height of the rim [m].
THICK, HIGH = 0.01, 0.02


def build_world() -> int:
    """Connect this process to a new world, a board with four walls and a marble; return the marble's id."""
    pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(1 / SUBSTEPS_PER_S)
    half_x, half_y = BOARD.edge_x_m / 2, BOARD.edge_y_m / 2
    wide_x, wide_y, middle = half_x + 2 * THICK, half_y + 2 * THICK, HIGH - THICK
    boxes = [
        ((wide_x, wide_y, THICK), (0.0, 0.0, -THICK)),
        *(((THICK, wide_y, HIGH), (side * (half_x + THICK), 0.0, middle)) for side in (1, -1)),
        *(((wide_x, THICK, HIGH), (0.0, side * (half_y + THICK), middle)) for side in (1, -1)),
    ]
    shape = pybullet.createCollisionShapeArray(
        shapeTypes=[pybullet.GEOM_BOX] * len(boxes),
        halfExtents=[half for half, _ in boxes],
        collisionFramePositions=[centre for _, centre in boxes],
    )
    board = pybullet.createMultiBody(0, shape)
    ball = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=MARBLE.radius_m)
    marble = int(pybullet.createMultiBody(MARBLE.mass_kg, ball))
    pybullet.changeDynamics(board, -1, lateralFriction=LATERAL_FRICTION)
    pybullet.changeDynamics(
        marble, -1, lateralFriction=LATERAL_FRICTION, linearDamping=0.0, angularDamping=0.0
    )
    return marble


def simulate_one(marble: int, parameters: Array, commands: Array) -> Array:
    """Return observed positions (rows, 2) [board edges] of parameters (5,) in this process's world."""
    pybullet.resetBasePositionAndOrientation(marble, (0.0, 0.0, MARBLE.radius_m), (0.0, 0.0, 0.0, 1.0))
    pybullet.resetBaseVelocity(marble, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    # Bullet's coefficient is a length and is multiplied by the other body's lateral friction.
    rolling_friction = parameters[2] * MARBLE.radius_m / LATERAL_FRICTION
    pybullet.changeDynamics(marble, -1, rollingFriction=rolling_friction)
    (count,) = time_scales(parameters[None])
    positions = np.empty((len(commands), 2))
    for row, gravity in enumerate(gravity_in_board(parameters, commands).tolist()):
        centre, _ = pybullet.getBasePositionAndOrientation(marble)
        positions[row] = centre[:2]
        if row + 1 == len(commands):
            break
        pybullet.setGravity(*gravity)
        for _ in range(count):
            pybullet.stepSimulation()
    return observed(positions, parameters)


class _World:
    """The world of this process, built when it is first asked for."""

    marble: int | None = None

    @classmethod
    def simulate(cls, work: tuple[Array, Array]) -> Array:
        if cls.marble is None:
            cls.marble = build_world()
        return simulate_one(cls.marble, *work)


class PyBullet:
    """PyBullet in one or more processes, which live on from one repetition to the next."""

    name = "PyBullet"

    def __init__(self, processes: int) -> None:
        self.threads, self.rollouts = processes, 48 * processes
        # Not forked: a copy of a process that has threads may hang.
        self._pool = multiprocessing.get_context("spawn").Pool(processes) if processes > 1 else None

    def simulate(self, parameters: Array, commands: Array) -> Array:
        """Return positions (n, rows, 2) [board edges] of parameters (n, 5) under commands (rows, 2)."""
        work = [(one, commands) for one in parameters]
        if self._pool is None:
            return np.stack([_World.simulate(one) for one in work])
        return np.stack(self._pool.map(_World.simulate, work, chunksize=1))
