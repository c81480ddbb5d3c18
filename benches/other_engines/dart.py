"""DART 6: contacts and friction as a boxed linear complementarity problem; the rim gives nothing back.

Its contacts are solved exactly in each step (Dantzig), while those of the other engines are iterated.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext

import dartpy as dart
import numpy as np

from irt.proof.pybullet_world.engine import STEP_S, Base, Engine, Start, gravity, heavy_side
from irt.proof.pybullet_world.physics import MASS_KG, RADIUS_M, Array, Physics
from other_engines.board import SLIDING, boxes, resistance


def engine() -> Engine:
    """Return DART as an engine of the concealed world."""
    return Engine(lambda base, start, hidden: nullcontext(_Marble(base, start, hidden)))


class _Marble:
    """The marble in DART: a `Body` of the concealed world."""

    def __init__(self, base: Base, start: Start, hidden: Sequence[Physics]) -> None:
        self._world = dart.simulation.World()
        self._world.setTimeStep(STEP_S)
        self._world.setGravity([0.0, 0.0, 0.0])
        detector = dart.collision.BulletCollisionDetector()
        self._world.getConstraintSolver().setCollisionDetector(detector)
        for number, (centre, half) in enumerate(boxes()):
            self._world.addSkeleton(_fixed(f"box {number}", centre, half))
        marble = dart.dynamics.Skeleton("marble")
        self._joint, self._body = marble.createFreeJointAndBodyNodePair()
        _collides(self._body, dart.dynamics.SphereShape(RADIUS_M))
        about = 0.4 * MASS_KG * RADIUS_M**2
        heavy = heavy_side(hidden)
        self._body.setInertia(dart.dynamics.Inertia(MASS_KG, heavy, np.eye(3) * about))
        self._joint.setPositions(np.array([0.0, 0.0, 0.0, *start.place_m, RADIUS_M]))
        self._world.addSkeleton(marble)
        self._heavy, self._friction = heavy, base.rolling_friction
        self.push(np.zeros(3), np.zeros(3), 1.0)

    def step(self, tilt: Sequence[float]) -> Sequence[float]:
        """Go on by a step in which the board comes to tilts (2,) [rad]; return the marble's centre [m]."""
        force, torque = MASS_KG * (np.array(gravity(tilt)) + self._force), MASS_KG * self._torque
        spin = np.asarray(self._body.getAngularVelocity())
        against = resistance(spin, force, torque, self._friction * self._factor)
        self._body.setExtForce(force, self._heavy, False, True)
        # To set a torque would take away that of a force beside the origin.
        self._body.addExtTorque(torque + against, False)
        self._world.step()
        place: list[float] = self._body.getTransform().translation().tolist()
        return place

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step."""
        self._force, self._torque, self._factor = force, torque, factor

    def velocity(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return velocity [m/s] and spin [rad/s]."""
        moves, turns = self._body.getLinearVelocity(), self._body.getAngularVelocity()
        return np.asarray(moves).tolist(), np.asarray(turns).tolist()

    def set_velocity(self, moves: Sequence[float], turns: Sequence[float]) -> None:
        """Set velocity [m/s] and spin [rad/s]."""
        back = np.asarray(self._body.getTransform().rotation()).T
        self._joint.setVelocities(np.concatenate([back @ np.asarray(turns), back @ np.asarray(moves)]))


def _fixed(name: str, centre: Array, half: Array) -> dart.dynamics.Skeleton:
    skeleton = dart.dynamics.Skeleton(name)
    joint, body = skeleton.createWeldJointAndBodyNodePair()
    place = dart.math.Isometry3()
    place.set_translation(centre)
    joint.setTransformFromParentBodyNode(place)
    _collides(body, dart.dynamics.BoxShape(2.0 * half))
    return skeleton


def _collides(body: dart.dynamics.BodyNode, shape: dart.dynamics.Shape) -> None:
    node = body.createShapeNode(shape)
    node.createCollisionAspect()
    node.createDynamicsAspect()
    node.getDynamicsAspect().setFrictionCoeff(SLIDING)
    node.getDynamicsAspect().setRestitutionCoeff(0.0)
