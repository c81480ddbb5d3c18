"""Marbles that roll on plates, each of its own run, side by side in one model of MuJoCo.

Lengths are in marble radii and masses in marbles: MuJoCo takes a coefficient of rolling friction, which is a
length, for at least 1e-5, more than this marble's in metres.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from irt.maze import Maze
from irt.rig import Board, Marble

from .commands import STEP_S
from .contacts import FACTORS, FORCES, GRAVITY, Hidden, heavy_side

Array = NDArray[np.float64]

BOARD, MARBLE = Board(), Marble()
#: Time that the plate takes from one set point to the next [s]: less jolts the marble off. It passes the
#: middle when the command comes, so that this is no delay.
TURN_S = 0.05
HALF_TURN = round(0.5 * TURN_S / STEP_S)
#: How a set point is spread over the steps around its own.
BELL = 1.0 + np.cos(np.pi * np.arange(-HALF_TURN, HALF_TURN + 1) / (HALF_TURN + 1))
BELL /= BELL.sum()
#: Friction of marble and plate against slipping, and against spinning about the vertical [radii].
SLIDING, SPINNING = 0.25, 1e-3
#: Inertia of a plate about its hinges [marbles radii²]: its drive yields to no marble.
PLATE = 1e7
#: How far plates are apart [radii].
APART = 400.0
#: Time constant of a contact [s]. With two steps, the least that MuJoCo allows, it is chance how a marble
#: leaves a wall: its speed differs by 4 % of what it came with, depending on when in a step they met.
CONTACT_S = 4.0 * STEP_S
#: Damping ratio of a rim that throws nothing back. With 1, as a contact does not hold on to what leaves it,
#: a seventh of the speed comes back.
DEAD = 3.0
#: One over the frequency of a rim that throws marbles back [s]: it takes sixteen steps.
REBOUND_S = 16.0 * STEP_S / np.pi
#: The least restitution that such a rim is tuned to, and the damping ratio that is more than enough for it.
LEAST, DULL = 0.05, 2.5
#: Speed of the marbles by whose rebound rims are tuned [m/s], and how near that comes to the restitution.
TRIED_M_PER_S, NEAR = 0.1, 1e-3
#: The most that a rim gives back.
LIVELIEST = 0.95


def roll(tilts: Array, places: Array, rolling_friction: float, hidden: Hidden) -> Array:
    """Return the places (n, steps, 2) [m] of marbles on plates at angles (n, steps, 2) [rad].

    Marbles start at rest at places (n, 2) [m].
    """
    runs, steps = tilts.shape[:2]
    world = Plates(runs, rolling_friction, hidden)
    world.place(places)
    turned = smooth(np.pad(tilts, ((0, 0), (HALF_TURN, HALF_TURN), (0, 0)), mode="edge"))
    rates = np.diff(turned, axis=1, append=turned[:, -1:]) / STEP_S
    rotations = rotations_of(turned)
    found = np.empty((runs, steps, 2))
    for step in range(steps):
        found[:, step] = world.step(turned[:, step], rates[:, step], rotations[:, step])
    return found


class Plates:
    """The model, and where its marbles are."""

    def __init__(self, runs: int, rolling_friction: float, hidden: Hidden, maze: Maze | None = None) -> None:
        increase = hidden.get("wall_restitution", {}).get("increase", 0.0)
        restitution = min(max(BOARD.wall_restitution + increase, 0.0), LIVELIEST)
        self.model = mujoco.MjModel.from_xml_string(_xml(runs, rolling_friction, restitution, hidden, maze))
        self.data = mujoco.MjData(self.model)
        self._origins = APART * np.arange(runs)
        self._friction = rolling_friction
        self._plates = np.array([self.model.geom(f"plate{run}").id for run in range(runs)])
        self._forces = [make(hidden[name]) for name, make in FORCES.items() if name in hidden]
        self._factors = [make(hidden[name]) for name, make in FACTORS.items() if name in hidden]
        # Of each run: two hinges, then the marble's place and its quaternion, or its velocities.
        self._places = self.data.qpos.reshape(runs, 9)
        self._rates = self.data.qvel.reshape(runs, 8)
        self._applied = self.data.qfrc_applied.reshape(runs, 8)
        if "viscous_drag" in hidden:
            rate = hidden["viscous_drag"]["rate_per_s"]
            self.model.dof_damping.reshape(runs, 8)[:, 2:] = rate * np.array([1.0] * 3 + [0.4] * 3)

    def place(self, places: Array) -> None:
        """Puts marbles at rest (n, 2) [m], on plates that are level."""
        self._places[:, 2:4] = places / MARBLE.radius_m
        self._places[:, 2] += self._origins
        self._places[:, 4] = 1.0

    def step(self, angles: Array, rates: Array, rotations: Array) -> Array:
        """Return where marbles are on the plates (n, 2) [m], and go on by a step.

        Plates stand at angles (n, 2) [rad], turn at rates (n, 2) [rad/s], and are rotated (n, 3, 3).
        """
        self._places[:, :2] = angles
        self._rates[:, :2] = rates
        place = self.where(rotations)
        if self._forces or self._factors:
            velocity = np.einsum("nij,ni->nj", rotations, self._rates[:, 2:5])[:, :2]
            # As seen from the plate, which turns a radius beneath the marble's middle.
            velocity -= np.stack([rates[:, 1], -rates[:, 0]], axis=1)
            self._act(place, MARBLE.radius_m * velocity, rotations)
        mujoco.mj_step(self.model, self.data)
        return np.asarray(place)

    def where(self, rotations: Array) -> Array:
        """Return where marbles are on plates (n, 2) [m] that are rotated (n, 3, 3)."""
        way = self._places[:, 2:5].copy()
        way[:, 0] -= self._origins
        if way[:, 2].min() < -APART or not np.isfinite(way).all():
            raise RuntimeError("a marble has left its plate")
        return np.asarray(MARBLE.radius_m * np.einsum("nij,ni->nj", rotations, way)[:, :2])

    def _act(self, place: Array, velocity: Array, rotations: Array) -> None:
        force = np.zeros_like(place)
        for push in self._forces:
            force += push(place, velocity)
        self._applied[:, 2:5] = np.einsum("nij,nj->ni", rotations[:, :, :2], force / MARBLE.radius_m)
        if self._factors:
            along = np.linalg.norm(force - GRAVITY * rotations[:, 2, :2], axis=1)
            resistances = along / (self._friction * GRAVITY)
            factor = np.prod([law(place, velocity, resistances) for law in self._factors], axis=0)
            self.model.geom_friction[self._plates, 2] = self._friction * factor


def smooth(tilts: Array) -> Array:
    """Return the angles of plates that take their time from one set point to the next.

    They are those of all steps but as many at either end as half a `BELL` has.
    """
    steps = tilts.shape[1] - len(BELL) + 1
    found = np.zeros((len(tilts), steps, 2))
    for first, weight in enumerate(BELL):
        found += weight * tilts[:, first : first + steps]
    return found


def rotations_of(tilts: Array) -> Array:
    """Return rotations (..., 3, 3) about x, then about the y that has turned with it."""
    sin, cos = np.moveaxis(np.sin(tilts), -1, 0), np.moveaxis(np.cos(tilts), -1, 0)
    zero, one = np.zeros_like(sin[0]), np.ones_like(sin[0])
    about_x = np.array([[one, zero, zero], [zero, cos[0], -sin[0]], [zero, sin[0], cos[0]]])
    about_y = np.array([[cos[1], zero, sin[1]], [zero, one, zero], [-sin[1], zero, cos[1]]])
    return np.asarray(np.einsum("ij...,jk...->...ik", about_x, about_y))


def _xml(
    runs: int, rolling_friction: float, restitution: float, hidden: Hidden, maze: Maze | None = None
) -> str:
    """Return the plates and their marbles as MJCF."""
    half = 0.5 * np.array([BOARD.edge_x_m, BOARD.edge_y_m]) / MARBLE.radius_m
    friction = f'friction="{BOARD.wall_friction} {SPINNING} {rolling_friction}"'
    thick, high = 2.0, 3.0
    sides = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    rims = "".join(
        f'<geom type="box" pos="{x * (half[0] + thick)} {y * (half[1] + thick)} {high - thick}"'
        f' size="{thick if x else half[0] + 2 * thick} {thick if y else half[1] + 2 * thick} {high}"'
        f" {friction} {_rim_contact(restitution)}/>"
        for x, y in sides
    )
    rims += "".join(_inner_walls(maze, f"{friction} {_rim_contact(restitution)}")) if maze else ""
    off = heavy_side(hidden["eccentric_marble"]) if "eccentric_marble" in hidden else np.zeros(3)
    bodies = "".join(
        f"""
        <body pos="{APART * run} 0 0"><joint type="hinge" axis="1 0 0" armature="{PLATE}"/>
          <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body><joint type="hinge" axis="0 1 0" armature="{PLATE}"/>
            <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
            <geom name="plate{run}" type="box" pos="0 0 {-thick}"
              size="{half[0] + thick} {half[1] + thick} {thick}"
              friction="{SLIDING} {SPINNING} {rolling_friction}"/>{rims}
          </body>
        </body>
        <body pos="{APART * run} 0 1"><freejoint/>
          <inertial pos="{off[0]} {off[1]} {off[2]}" mass="1" diaginertia="0.4 0.4 0.4"/>
          <geom type="sphere" size="1" contype="2" conaffinity="1" priority="-1"/>
        </body>"""
        for run in range(runs)
    )
    return f"""
    <mujoco>
      <option timestep="{STEP_S}" gravity="0 0 {-GRAVITY / MARBLE.radius_m}" integrator="Euler"
        solver="Newton" cone="elliptic" impratio="1000" iterations="50" tolerance="1e-8"/>
      <default>
        <geom condim="6" contype="1" conaffinity="2" solref="{CONTACT_S} 1" solimp="0.99 0.99 0.001"/>
      </default>
      <worldbody>{bodies}</worldbody>
    </mujoco>"""


def _inner_walls(maze: Maze, contact: str) -> Iterator[str]:
    """Yield the inner walls as geometries: boxes, and a post at either end."""
    half, high = (0.5 * size / MARBLE.radius_m for size in (maze.wall_thickness_m, maze.wall_height_m))
    for wall in np.array(maze.walls) / MARBLE.radius_m:
        for x, y in {tuple(wall[:2].tolist()), tuple(wall[2:].tolist())}:
            yield f'<geom type="cylinder" pos="{x} {y} {high}" size="{half} {high}" {contact}/>'
        (x, y), way = (wall[:2] + wall[2:]) / 2.0, wall[2:] - wall[:2]
        length, angle = np.hypot(*way), 0.5 * np.arctan2(way[1], way[0])
        if length > 0.0:
            yield (
                f'<geom type="box" pos="{x} {y} {high}" size="{length / 2.0} {half} {high}"'
                f' quat="{np.cos(angle)} 0 0 {np.sin(angle)}" {contact}/>'
            )


def _rim_contact(restitution: float) -> str:
    """Return how stiff and how damped a rim is."""
    if restitution < LEAST:
        return f'solref="{CONTACT_S} {DEAD}"'
    return _spring(_damping_ratio(restitution))


def _spring(damping: float) -> str:
    # A time constant is one over damping ratio and frequency, which shall not depend on the damping.
    return f'solref="{REBOUND_S / damping} {damping}"'


@functools.cache
def _damping_ratio(restitution: float) -> float:
    """Return the damping ratio of a rim that returns this part of a marble's speed, found by trying."""
    low, high = 1e-3, DULL
    while True:
        damping = 0.5 * (low + high)
        returned = _rebound(_spring(damping))
        if abs(returned - restitution) < NEAR or high - low < NEAR * NEAR:
            return damping
        low, high = (damping, high) if returned > restitution else (low, damping)


def _rebound(contact: str) -> float:
    """Return the part of its speed that a marble keeps which meets such a wall head-on, without a board."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{STEP_S}" gravity="0 0 0" cone="elliptic"/>
      <worldbody>
        <geom type="plane" size="9 9 1" solimp="0.99 0.99 0.001" priority="1" {contact}/>
        <body pos="0 0 1.1"><freejoint/><geom type="sphere" size="1" mass="1"/></body>
      </worldbody>
    </mujoco>""")
    data = mujoco.MjData(model)
    speed = TRIED_M_PER_S / MARBLE.radius_m
    data.qvel[2] = -speed
    for _ in range(200):
        mujoco.mj_step(model, data)
    return max(float(data.qvel[2]) / speed, 0.0)
