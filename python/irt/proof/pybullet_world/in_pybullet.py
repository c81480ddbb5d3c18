"""PyBullet: a marble on a board with four rim walls, as rigid bodies in three dimensions.

The board is fixed and gravity turns instead, which is the same motion at these tilts; a board that jumps to
its next tilt between two steps would throw the marble up. Rolling friction is Bullet's own, a length: `mu *
radius / lateral friction` for the dimensionless `mu` that a tilt has to exceed. Damping is off, because
Bullet's grows with spin. Measured at 1/960 s and 50 solver iterations: above the threshold the acceleration
is 5/7 g (sin(tilt) - mu) to 1e-4, from rest and at speeds of 0.1 to 0.3 m/s, where 1/240 s is off by 1 to 2
%.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import numpy as np

from .engine import STEP_S, Base, Engine, Start, gravity, heavy_side
from .physics import EDGE_X_M, EDGE_Y_M, MASS_KG, RADIUS_M, Array, Physics
from .rim import LATERAL_FRICTION

ITERATIONS = 50


def bullet() -> ModuleType:
    """Import PyBullet without its greeting, which would break the line protocol."""
    if "pybullet" not in sys.modules:
        sys.stdout.flush()
        sys.stderr.flush()
        kept = [os.dup(1), os.dup(2)]
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            try:
                import pybullet  # noqa: F401, PLC0415
            finally:
                for number, one in enumerate(kept, start=1):
                    os.dup2(one, number)
                    os.close(one)
    return sys.modules["pybullet"]


class _Ball:
    """The marble in PyBullet: a `Body`."""

    def __init__(self, p: ModuleType, client: int, body: int, base: Base, heavy: Array) -> None:
        self._p, self._client, self._body = p, client, body
        self._heavy, self._friction, self._factor = heavy, base.rolling_friction, 1.0

    def step(self, tilt: Sequence[float]) -> Sequence[float]:
        """Go on by a step in which the board comes to tilts (2,) [rad]; return the marble's centre [m]."""
        p, client = self._p, self._client
        p.setGravity(*gravity(tilt), physicsClientId=client)
        p.stepSimulation(physicsClientId=client)
        place, turned = p.getBasePositionAndOrientation(self._body, physicsClientId=client)
        if self._heavy.any():
            turned = np.reshape(p.getMatrixFromQuaternion(turned), (3, 3))
            place = np.subtract(place, turned @ self._heavy)
        found: Sequence[float] = place
        return found

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step."""
        p, client, body = self._p, self._client, self._body
        if force.any():
            place, _ = p.getBasePositionAndOrientation(body, physicsClientId=client)
            push = (MASS_KG * force).tolist()
            p.applyExternalForce(body, -1, push, place, p.WORLD_FRAME, physicsClientId=client)
        if torque.any():
            turn = (MASS_KG * torque).tolist()
            p.applyExternalTorque(body, -1, turn, p.WORLD_FRAME, physicsClientId=client)
        if factor != self._factor:
            self._factor = factor
            rolling = _rolling(self._friction * factor)
            p.changeDynamics(body, -1, rollingFriction=rolling, physicsClientId=client)

    def velocity(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return velocity [m/s] and spin [rad/s]."""
        moves, turns = self._p.getBaseVelocity(self._body, physicsClientId=self._client)
        return moves, turns

    def set_velocity(self, moves: Sequence[float], turns: Sequence[float]) -> None:
        """Set velocity [m/s] and spin [rad/s]."""
        self._p.resetBaseVelocity(self._body, moves, turns, physicsClientId=self._client)


def _rolling(friction: float) -> float:
    """Return Bullet's coefficient, a length over the other body's, for a dimensionless one."""
    return friction * RADIUS_M / LATERAL_FRICTION


@contextmanager
def _marble(base: Base, start: Start, hidden: Sequence[Physics]) -> Iterator[_Ball]:
    """Make board, rim and a resting marble."""
    p, heavy = bullet(), heavy_side(hidden)
    client = p.connect(p.DIRECT)
    try:
        p.setPhysicsEngineParameter(
            fixedTimeStep=STEP_S,
            numSolverIterations=ITERATIONS,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        half_x, half_y, thick, high = EDGE_X_M / 2, EDGE_Y_M / 2, 0.01, 0.02
        _box(p, client, (half_x + 2 * thick, half_y + 2 * thick, thick), (0.0, 0.0, -thick))
        for side in (-1.0, 1.0):
            at_x, at_y = side * (half_x + thick), side * (half_y + thick)
            _box(p, client, (thick, half_y + 2 * thick, high), (at_x, 0.0, high))
            _box(p, client, (half_x + 2 * thick, thick, high), (0.0, at_y, high))
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=RADIUS_M, physicsClientId=client)
        body = p.createMultiBody(
            MASS_KG,
            ball,
            basePosition=[*start.place_m, RADIUS_M],
            baseInertialFramePosition=heavy.tolist(),
            useMaximalCoordinates=0,
            physicsClientId=client,
        )
        _material(p, client, body)
        p.changeDynamics(
            body,
            -1,
            rollingFriction=_rolling(base.rolling_friction),
            linearDamping=0.0,
            angularDamping=0.0,
            # Bullet treats a sphere that is off its centre of mass as its bounding box.
            localInertiaDiagonal=[0.4 * MASS_KG * RADIUS_M**2] * 3,
            activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=client,
        )
        yield _Ball(p, client, body, base, heavy)
    finally:
        p.disconnect(client)


def _box(
    p: ModuleType, client: int, half: tuple[float, float, float], centre: tuple[float, float, float]
) -> None:
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    _material(p, client, p.createMultiBody(0, shape, basePosition=centre, physicsClientId=client))


def _material(p: ModuleType, client: int, body: int) -> None:
    """Set friction, which multiplies over the two bodies of a contact, and no restitution."""
    p.changeDynamics(body, -1, lateralFriction=LATERAL_FRICTION, restitution=0.0, physicsClientId=client)


PYBULLET = Engine(_marble)
