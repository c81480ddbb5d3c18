"""Drake: compliant spheres and boxes with Hunt and Crossley's dissipation, and regularised Coulomb friction.

A marble rebounds the more the slower it is: at an approach speed v, Drake's rim gives back about
1 / (1 + 0.6 dissipation v) of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext

import numpy as np
from pydrake.geometry import AddContactMaterial, Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    ExternallyAppliedSpatialForce,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from irt.proof.pybullet_world.engine import STEP_S, Base, Engine, Start, gravity, heavy_side
from irt.proof.pybullet_world.physics import MASS_KG, RADIUS_M, Array, Physics
from other_engines.board import SLIDING, boxes, resistance

#: Stiffness of a contact [N/m]; the marble sinks into the board by 0.5 um.
STIFFNESS = 2e4
#: Dissipation of board and rim [s/m]: a marble of 0.05 m/s keeps 7 % of its speed.
DISSIPATION = 500.0


def engine(dissipation: float = DISSIPATION) -> Engine:
    """Return Drake as an engine of the concealed world, with a dissipation of the rim [s/m]."""
    return Engine(lambda base, start, hidden: nullcontext(_Marble(base, start, hidden, dissipation)))


class _Marble:
    """The marble in Drake: a `Body` of the concealed world."""

    def __init__(self, base: Base, start: Start, hidden: Sequence[Physics], dissipation: float) -> None:
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=STEP_S, contact_model="point", discrete_contact_approximation="lagged"
        )
        plant, _ = AddMultibodyPlant(config, builder)
        # Gravity turns in the board's frame; it is applied as a force.
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
        heavy, inertia = heavy_side(hidden), UnitInertia.SolidSphere(RADIUS_M)
        mass = SpatialInertia.MakeFromCentralInertia(MASS_KG, heavy, inertia * MASS_KG)
        body = plant.AddRigidBody("marble", mass)
        plant.RegisterCollisionGeometry(
            body, RigidTransform(), Sphere(RADIUS_M), "marble", _material(DISSIPATION)
        )
        for number, (centre, half) in enumerate(boxes()):
            material = _material(dissipation if number else DISSIPATION)
            shape, place = Box(*(2.0 * half)), RigidTransform(centre)
            plant.RegisterCollisionGeometry(plant.world_body(), place, shape, f"box {number}", material)
        plant.Finalize()
        self._simulator = Simulator(builder.Build())
        self._plant, self._steps = plant, 0
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        plant.SetPositions(self._context, np.array([1.0, 0.0, 0.0, 0.0, *start.place_m, RADIUS_M]))
        self._applied = ExternallyAppliedSpatialForce()
        self._applied.body_index, self._applied.p_BoBq_B = body.index(), heavy
        self._friction = base.rolling_friction
        self.push(np.zeros(3), np.zeros(3), 1.0)
        self._simulator.Initialize()

    def step(self, tilt: Sequence[float]) -> Sequence[float]:
        """Go on by a step in which the board comes to tilts (2,) [rad]; return the marble's centre [m]."""
        force = MASS_KG * (np.array(gravity(tilt)) + self._force)
        torque = MASS_KG * self._torque
        spin = self._plant.GetVelocities(self._context)[:3]
        against = resistance(spin, force, torque, self._friction * self._factor)
        self._applied.F_Bq_W = SpatialForce(torque + against, force)
        self._plant.get_applied_spatial_force_input_port().FixValue(self._context, [self._applied])
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * STEP_S)
        place: list[float] = self._plant.GetPositions(self._context)[4:].tolist()
        return place

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step."""
        self._force, self._torque, self._factor = force, torque, factor

    def velocity(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return velocity [m/s] and spin [rad/s]."""
        found = self._plant.GetVelocities(self._context)
        return found[3:].tolist(), found[:3].tolist()

    def set_velocity(self, moves: Sequence[float], turns: Sequence[float]) -> None:
        """Set velocity [m/s] and spin [rad/s]."""
        self._plant.SetVelocities(self._context, np.array([*turns, *moves]))


def _material(dissipation: float) -> ProximityProperties:
    properties = ProximityProperties()
    friction = CoulombFriction(SLIDING, SLIDING)
    AddContactMaterial(
        dissipation=dissipation, point_stiffness=STIFFNESS, friction=friction, properties=properties
    )
    return properties
