"""Make rigs with hidden physics whose marble is moved by Drake, for `benches/diagnosis.py`.

    .venv/bin/pip install drake
    .venv/bin/python benches/drake_rigs.py concealed --seed 1 --jobs 2
    OMP_NUM_THREADS=1 .venv/bin/python benches/diagnosis.py concealed --out diagnosed --jobs 2

The hidden physics is that of `irt prove`. Nothing in this project was made with Drake's contacts in mind:
compliant spheres and boxes with Hunt and Crossley's dissipation and regularised Coulomb friction, solved for
each step. A marble rebounds the more the slower it is: at an approach speed v, Drake's rim gives back about
1 / (1 + 0.6 dissipation v) of it. `rig.toml` says that rims give back nothing, so an answer may name
wall_restitution or not.

Drake has no rolling friction. A torque against the roll stands for it, at most friction x weight x radius,
and no more than stops the marble in a step. Before any rig is made, marbles on slopes must roll as theory
says.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

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

import irt
from irt.files import write_atomic
from irt.proof.pybullet_world import spec
from irt.proof.pybullet_world.engine import STEP_S, Base, follow, heavy_side
from irt.proof.pybullet_world.physics import EDGE_X_M, EDGE_Y_M, GRAVITY, MASS_KG, RADIUS_M, Array, Physics
from irt.proof.pybullet_world.record import record

#: Coulomb friction of board and rim, and friction against spins about the normal [radii].
SLIDING, SPINNING = 0.25, 1e-4
#: Stiffness of a contact [N/m]; the marble sinks into the board by 0.5 um.
STIFFNESS = 2e4
#: Dissipation of board and rim [s/m]: a marble of 0.05 m/s keeps 7 % of its speed.
DISSIPATION = 500.0
#: Kinds of rigs in the order in which they are made, again and again.
KINDS = ("none", "single", "single", "pair", "none", "single", "unlisted", "triple")


def main() -> None:
    """Make the rigs and their labels."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--dissipation", type=float, default=DISSIPATION, help="of the rim [s/m]")
    args = parser.parse_args()
    check()
    args.out.mkdir(parents=True, exist_ok=True)
    labels = {}
    with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
        made = partial(make, args.out, args.seed, args.dissipation)
        for name, label in pool.imap(made, range(args.rigs)):
            labels[name] = label
            print(name, label["kind"], flush=True)
            write_atomic(args.out / "labels.json", json.dumps(labels, indent=1))


def check() -> None:
    """Raise an error unless a marble rolls down slopes as a sphere does, and rests where it should.

    Raises
    ------
    RuntimeError
        If it does not.
    """
    friction, steps = 0.004, 960
    for slope in (0.003, 0.02, 0.05):
        tilts = np.tile([0.0, slope], (steps + 1, 1))
        path = Roll()(Base(0.1, 0.1, friction, 20.0, 1.0), tilts, (-0.12, 0.0), [])
        pull = 5.0 / 7.0 * GRAVITY * max(math.sin(slope) - friction, 0.0)
        # Away from the start, where the contact settles.
        speeds = np.diff(path[:, 0])[[100, 400]] / STEP_S
        found = float(np.diff(speeds)[0]) / (300 * STEP_S)
        if abs(found - pull) > 1e-3 * max(pull, 0.1):
            raise RuntimeError(
                f"a marble on a slope of {slope} accelerates by {found:.5f}, not {pull:.5f} m/s^2"
            )


def make(out: Path, seed: int, dissipation: float, index: int) -> tuple[str, dict[str, Any]]:
    """Write the recordings of a rig; return its name and label."""
    spec.ENGINES["drake"] = Roll(dissipation)
    name = f"drake-{seed}-{index:03d}"
    random, kind = np.random.default_rng([seed, index]), KINDS[index % len(KINDS)]
    drawn = spec.draw(random, kind, name, [], through_camera=False, engine="drake")
    recorded = record(drawn)
    recorded.write(out / name)
    label = recorded.label()
    tests = label.pop("tests")
    for test, one in tests.items():
        write_atomic(out / name / f"{test}.csv", one["csv"])
    rig = irt.load_rig(out / name)
    trained = tuple(one for one in rig.recordings if one.name not in tests)
    held_out = [one for one in rig.recordings if one.name in tests]
    base = irt.tune(replace(rig, recordings=trained), threads=1).model
    missed = [np.nanmean(np.abs(one.marble - np.array(tests[one.name]["clean"]))) for one in held_out]
    label["base"], label["oracle"] = float(irt.evaluate(base, held_out).mae), float(np.mean(missed))
    label["left_over"] = [{"name": "wall_restitution"}]
    beyond = label["truth"].pop("out_of_catalogue")
    return name, label if beyond is None else {**label, "beyond": beyond}


class Roll:
    """Moves the marble: a `Roll` of the concealed world."""

    def __init__(self, dissipation: float = DISSIPATION) -> None:
        self._dissipation = dissipation

    def __call__(
        self, base: Base, tilts: Array, start_m: tuple[float, float], hidden: Sequence[Physics]
    ) -> Array:
        """Return the marble's centre (steps + 1, 2) [m]."""
        return follow(_Marble(base, start_m, hidden, self._dissipation), base, tilts, start_m, hidden)


class _Marble:
    """The marble in Drake: a `Body` of the concealed world."""

    def __init__(
        self, base: Base, start_m: tuple[float, float], hidden: Sequence[Physics], dissipation: float
    ) -> None:
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
        half_x, half_y, thick = EDGE_X_M / 2.0, EDGE_Y_M / 2.0, 0.02
        walls = [("board", (0.0, 0.0, -thick), (half_x + thick, half_y + thick, thick), DISSIPATION)]
        walls += [
            (
                f"rim {x} {y}",
                (x * (half_x + thick), y * (half_y + thick), thick),
                (thick if x else half_x + 2.0 * thick, thick if y else half_y + 2.0 * thick, thick),
                dissipation,
            )
            for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
        ]
        for name, centre, half, of_wall in walls:
            box = Box(*(2.0 * np.array(half)))
            plant.RegisterCollisionGeometry(
                plant.world_body(), RigidTransform(centre), box, name, _material(of_wall)
            )
        plant.Finalize()
        self._simulator = Simulator(builder.Build())
        self._plant, self._steps = plant, 0
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        plant.SetPositions(self._context, np.array([1.0, 0.0, 0.0, 0.0, *start_m, RADIUS_M]))
        self._applied = ExternallyAppliedSpatialForce()
        self._applied.body_index, self._applied.p_BoBq_B = body.index(), heavy
        self._friction = base.rolling_friction
        self.push(np.zeros(3), np.zeros(3), 1.0)
        self._simulator.Initialize()

    def step(self, pull: Sequence[float]) -> Sequence[float]:
        """Go on by a step under gravity (3,) [m/s^2]; return the marble's centre [m]."""
        force = MASS_KG * (np.array(pull) + self._force)
        torque = MASS_KG * self._torque
        self._applied.F_Bq_W = SpatialForce(torque + self._resistance(force, torque), force)
        self._plant.get_applied_spatial_force_input_port().FixValue(self._context, [self._applied])
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * STEP_S)
        place: list[float] = self._plant.GetPositions(self._context)[4:].tolist()
        return place

    def _resistance(self, force: Array, torque: Array) -> Array:
        """Return the torque (3,) [N m] of rolling and spinning friction, which at most stops the marble."""
        spin = self._plant.GetVelocities(self._context)[:3]
        about_contact, about_normal = 1.4 * MASS_KG * RADIUS_M**2, 0.4 * MASS_KG * RADIUS_M**2
        driven = torque[:2] + RADIUS_M * np.array([-force[1], force[0]])
        stops = -(about_contact * spin[:2] / STEP_S + driven)
        weight = max(-force[2], 0.0) * RADIUS_M
        most = self._friction * self._factor * weight
        rolling = stops * min(1.0, most / max(float(np.hypot(*stops)), 1e-300))
        spinning = np.clip(-about_normal * spin[2] / STEP_S, -SPINNING * weight, SPINNING * weight)
        return np.array([*rolling, spinning])

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


if __name__ == "__main__":
    main()
