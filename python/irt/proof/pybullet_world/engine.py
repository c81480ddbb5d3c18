"""PyBullet: a marble on a board with four rim walls, as rigid bodies in three dimensions.

The board is fixed and gravity turns instead, which is the same motion at these tilts; a board that jumps to
its next tilt between two steps would throw the marble up. Rolling friction is Bullet's own, a length: `mu *
radius / lateral friction` for the dimensionless `mu` that a tilt has to exceed. Damping is off, because
Bullet's grows with spin. Measured at 1/960 s and 50 solver iterations: above the threshold the acceleration
is 5/7 g (sin(tilt) - mu) to 1e-4, from rest and at speeds of 0.1 to 0.3 m/s, where 1/240 s is off by 1 to 2
%.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Protocol

import numpy as np

from .physics import EDGE_X_M, EDGE_Y_M, GRAVITY, MASS_KG, RADIUS_M, Array, Marble, Physics, acts
from .rim import LATERAL_FRICTION, Moving, Rim

STEP_S = 1 / 960
#: A unit of `time_scale`: the paper's physics update.
UPDATE_S = 1 / 240
ITERATIONS = 50


@dataclass(frozen=True)
class Base:
    """The five parameters that every simulator of the board has, in the units of the recordings' format."""

    gear_x: float
    gear_y: float
    rolling_friction: float
    time_scale: float
    observation_scale: float

    @property
    def row_s(self) -> float:
        """Seconds from one row to the next."""
        return self.time_scale * UPDATE_S


@dataclass(frozen=True)
class Played:
    """The true run, one row for each command.

    Attributes
    ----------
    places : (n, 2) array
        The marble's centre [m] at the time of the row's picture.
    tilts : (n, 2) array
        Tilts of the board [rad] at that time.
    seen : (n, 2) array
        Positions of a perfect tracker [board edges].
    """

    places: Array
    tilts: Array
    seen: Array


#: Returns the marble's centre (steps + 1, 2) [m] from the five parameters, tilts, start and hidden physics.
Roll = Callable[[Base, Array, tuple[float, float], Sequence[Physics]], Array]


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


def play(
    base: Base,
    commands: Array,
    start_m: tuple[float, float],
    hidden: Sequence[Physics] = (),
    random: np.random.Generator | None = None,
    *,
    rolled: Roll | None = None,
) -> Played:
    """Simulate a run that starts at rest with level knobs.

    Parameters
    ----------
    base : Base
        The five parameters.
    commands : (n, 2) array
        Knob angles [rad], each from its row to the next.
    start_m : tuple
        Position of the marble at row 0 [m].
    hidden : sequence of Physics
        Hidden physics, in the order in which it acts.
    random : Generator
        Generator of random physics; the same seed gives the same run.
    rolled : callable, optional
        Moves the marble; by default PyBullet (`roll`).
    """
    rows: Array = np.asarray(base.row_s * np.arange(len(commands)), dtype=np.float64)
    exposed = rows
    for one in hidden:
        exposed = one.expose(exposed)
    exposed = np.maximum(exposed, np.float64(0.0))
    steps = max(1, math.ceil(exposed.max() / STEP_S - 1e-9))
    tilts = tilt(base, arrived(commands, rows, steps, hidden, random or np.random.default_rng(0)), hidden)
    path = (rolled or roll)(base, tilts, start_m, hidden)
    moments = STEP_S * np.arange(steps + 1)
    places = np.stack([np.interp(exposed, moments, path[:, axis]) for axis in (0, 1)], axis=1)
    # A picture at the time of a change of the board shows the board before it.
    then = tilts[np.ceil(exposed / STEP_S - 1e-9).astype(int)]
    seen = places / EDGE_X_M * base.observation_scale
    for one in hidden:
        seen = one.see(seen, then)
    return Played(places, then, seen)


def arrived(
    commands: Array, rows: Array, steps: int, hidden: Sequence[Physics], random: np.random.Generator
) -> Array:
    """Return the mean command (steps, 2) in each step, of commands that hold until the next one arrives."""
    times = rows
    for one in hidden:
        times = one.arrive(times, random)
    # An overtaken command is dropped.
    soonest_after = np.append(np.minimum.accumulate(times[::-1])[::-1][1:], np.inf)
    kept = times < soonest_after
    knots = np.concatenate([[-1.0], times[kept], [max(steps * STEP_S, times[-1]) + 1.0]])
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


def gravity(tilts: Array) -> Array:
    """Return gravity (n, 3) [m/s^2] as a board sees it that is turned about x, then about its y."""
    sin, cos = np.sin(tilts), np.cos(tilts)
    return GRAVITY * np.stack([cos[:, 0] * sin[:, 1], -sin[:, 0], -cos[:, 0] * cos[:, 1]], axis=1)


class Body(Moving, Protocol):
    """A marble in an engine, in SI units and the board's frame."""

    def step(self, pull: Sequence[float]) -> Sequence[float]:
        """Go on by a step under gravity (3,) [m/s^2]; return the marble's centre [m]."""

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step.

        Parameters
        ----------
        force, torque : (3,) array
            At the centre of mass, divided by the mass [m/s^2], [m^2/s^2].
        factor : float
            Factor on the rolling friction.
        """


def follow(
    body: Body, base: Base, tilts: Array, start_m: tuple[float, float], hidden: Sequence[Physics]
) -> Array:
    """Return the marble's centre (steps + 1, 2) [m], moved step by step by its engine and hidden physics."""
    rim = Rim(body, bounced(hidden))
    forces = [one.force for one in hidden if acts(one, "force")]
    torques = [one.torque for one in hidden if acts(one, "torque")]
    resistances = [one.resist for one in hidden if acts(one, "resist")]
    marble = Marble(*start_m, STEP_S, friction=base.rolling_friction)
    path = np.empty((len(tilts), 2))
    path[0] = start_m
    for step, pull in enumerate(gravity(tilts[1:]).tolist()):
        if forces or torques or resistances:
            (marble.vx, marble.vy, _), (spin_x, spin_y, spin_z) = body.velocity()
            marble.spin = spin_x, spin_y, spin_z
            marble.time, marble.pull_x, marble.pull_y = step * STEP_S, pull[0], pull[1]
            pushed, turned = np.zeros(3), np.zeros(3)
            for force in forces:
                x, y = force(marble)
                marble.pull_x += x
                marble.pull_y += y
                pushed[:2] += (x, y)
            for torque in torques:
                turned += torque(marble)
            body.push(pushed, turned, math.prod(resistance(marble) for resistance in resistances))
        place = body.step(pull)
        path[step + 1] = place[:2]
        if rim.acts:
            rim.apply(place)
        marble.way += math.hypot(marble.x - place[0], marble.y - place[1])
        marble.x, marble.y = place[0], place[1]
    return path


def roll(base: Base, tilts: Array, start_m: tuple[float, float], hidden: Sequence[Physics]) -> Array:
    """Return the marble's centre (steps + 1, 2) [m]."""
    p = bullet()
    heavy = heavy_side(hidden)
    with _world(p, base, start_m, heavy) as (client, body):
        return follow(_Ball(p, client, body, base, heavy), base, tilts, start_m, hidden)


class _Ball:
    """The marble in PyBullet: a `Body`."""

    def __init__(self, p: ModuleType, client: int, body: int, base: Base, heavy: Array) -> None:
        self._p, self._client, self._body = p, client, body
        self._heavy, self._friction, self._factor = heavy, base.rolling_friction, 1.0

    def step(self, pull: Sequence[float]) -> Sequence[float]:
        """Go on by a step under gravity (3,) [m/s^2]; return the marble's centre [m]."""
        p, client = self._p, self._client
        p.setGravity(*pull, physicsClientId=client)
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
def _world(
    p: ModuleType, base: Base, start_m: tuple[float, float], heavy: Array
) -> Iterator[tuple[int, int]]:
    """Board, rim and a resting marble; yields the client and the marble's body."""
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
            basePosition=[*start_m, RADIUS_M],
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
        yield client, body
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


def bounced(hidden: Sequence[Physics]) -> float:
    """Return the restitution of the rim."""
    restitution = 0.0
    for one in hidden:
        restitution = one.bounce(restitution)
    return restitution


def heavy_side(hidden: Sequence[Physics]) -> Array:
    """Return the centre of mass at the release (3,) [m], relative to the marble's centre."""
    found: Array = RADIUS_M * np.sum([(0.0, 0.0, 0.0), *(one.heavy_side() for one in hidden)], axis=0)
    return found
