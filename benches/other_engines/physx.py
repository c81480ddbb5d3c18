"""PhysX 5, by SAPIEN: patches of contact points, temporal Gauss-Seidel; the rim gives nothing back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import nullcontext

import numpy as np
import sapien
from sapien.physx import (
    PhysxBodyConfig,
    PhysxCpuSystem,
    PhysxMaterial,
    PhysxRigidDynamicComponent,
    PhysxSceneConfig,
    PhysxShapeConfig,
    set_body_config,
    set_scene_config,
    set_shape_config,
)

from irt.proof.pybullet_world.engine import STEP_S, Base, Engine, Start, gravity, heavy_side
from irt.proof.pybullet_world.physics import MASS_KG, RADIUS_M, Array, Physics
from other_engines.board import SLIDING, boxes, resistance

#: Contacts are sought this far from a surface [m].
CONTACT_OFFSET_M = 0.002
#: Iterations of the solver for places and for velocities.
ITERATIONS = 20, 4


def engine() -> Engine:
    """Return PhysX as an engine of the concealed world."""
    scene = PhysxSceneConfig()
    scene.gravity, scene.enable_tgs, scene.enable_pcm = np.zeros(3, np.float32), True, True
    set_scene_config(scene)
    body = PhysxBodyConfig()
    body.sleep_threshold = 0.0
    body.solver_position_iterations, body.solver_velocity_iterations = ITERATIONS
    set_body_config(body)
    shape = PhysxShapeConfig()
    shape.contact_offset, shape.rest_offset = CONTACT_OFFSET_M, 0.0
    set_shape_config(shape)
    return Engine(lambda base, start, hidden: nullcontext(_Marble(base, start, hidden)))


class _Marble:
    """The marble in PhysX: a `Body` of the concealed world."""

    def __init__(self, base: Base, start: Start, hidden: Sequence[Physics]) -> None:
        self._scene = sapien.Scene([PhysxCpuSystem()])
        self._scene.set_timestep(STEP_S)
        material = PhysxMaterial(SLIDING, SLIDING, 0.0)
        for centre, half in boxes():
            box = self._scene.create_actor_builder()
            box.add_box_collision(half_size=half, material=material)
            box.build_static().set_pose(sapien.Pose(centre))
        sphere = self._scene.create_actor_builder()
        density = MASS_KG / (4.0 / 3.0 * math.pi * RADIUS_M**3)
        sphere.add_sphere_collision(radius=RADIUS_M, material=material, density=density)
        self._marble = sphere.build()
        self._marble.set_pose(sapien.Pose([*start.place_m, RADIUS_M]))
        self._body = self._marble.find_component_by_type(PhysxRigidDynamicComponent)
        self._body.set_mass(MASS_KG)
        self._body.set_inertia([0.4 * MASS_KG * RADIUS_M**2] * 3)
        self._body.set_cmass_local_pose(sapien.Pose(heavy_side(hidden)))
        self._body.set_linear_damping(0.0)
        self._body.set_angular_damping(0.0)
        self._friction = base.rolling_friction
        self.push(np.zeros(3), np.zeros(3), 1.0)

    def step(self, tilt: Sequence[float]) -> Sequence[float]:
        """Go on by a step in which the board comes to tilts (2,) [rad]; return the marble's centre [m]."""
        force, torque = MASS_KG * (np.array(gravity(tilt)) + self._force), MASS_KG * self._torque
        spin = np.asarray(self._body.angular_velocity, dtype=np.float64)
        against = resistance(spin, force, torque, self._friction * self._factor)
        self._body.add_force_torque(force, torque + against)
        self._scene.step()
        place: list[float] = np.asarray(self._marble.pose.p, dtype=np.float64).tolist()
        return place

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step."""
        self._force, self._torque, self._factor = force, torque, factor

    def velocity(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return velocity [m/s] and spin [rad/s]."""
        moves, turns = self._body.linear_velocity, self._body.angular_velocity
        return np.asarray(moves, np.float64).tolist(), np.asarray(turns, np.float64).tolist()

    def set_velocity(self, moves: Sequence[float], turns: Sequence[float]) -> None:
        """Set velocity [m/s] and spin [rad/s]."""
        self._body.set_linear_velocity(np.asarray(moves, np.float32))
        self._body.set_angular_velocity(np.asarray(turns, np.float32))
