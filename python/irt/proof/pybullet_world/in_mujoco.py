"""The same board, rim, marble and hidden physics in MuJoCo, whose board really turns.

The board is a plate on two hinges, about x and then about its y, which a heavy drive turns: the marble also
feels the inertial forces of its turns, which a world that turns gravity lacks. Lengths are in marble radii
and masses in marbles, because MuJoCo takes a coefficient of rolling friction, a length, for at least 1e-5. As
in PyBullet the rim's restitution is an impulse: in MuJoCo it would follow from stiffness and damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from .engine import STEP_S, Base, Engine, Start, heavy_side
from .physics import EDGE_X_M, EDGE_Y_M, GRAVITY, RADIUS_M, Array, Physics

#: Coulomb friction of the board and of the rim, and friction against spins about the normal [radii].
_SLIDING, _SPINNING = 0.25, 1e-4
#: Time constant of a contact [s], and damping ratio of a rim that throws nothing back.
_CONTACT_S, _DEAD = 4.0 * STEP_S, 3.0
#: Time that the plate takes from one tilt to the next [s]; less jolts the marble off.
_TURN_S = 0.05
#: Inertia of the plate about its hinges [marbles radii^2]: its drive yields to no marble.
_PLATE = 1e7


class _Ball:
    """The marble in its model: a `Body`."""

    def __init__(self, base: Base, start: Start, hidden: Sequence[Physics]) -> None:
        import mujoco  # noqa: PLC0415

        heavy = heavy_side(hidden) / RADIUS_M
        self._mujoco: Any = mujoco
        self._model = mujoco.MjModel.from_xml_string(_xml(base.rolling_friction, heavy))
        self._data = mujoco.MjData(self._model)
        self._friction = base.rolling_friction
        self._tilt, self._rates, self._board = np.array(start.tilt), np.zeros(2), _turned(start.tilt)
        self._data.qpos[2:5] = self._board @ [*np.divide(start.place_m, RADIUS_M), 1.0]

    def step(self, tilt: Sequence[float]) -> list[float]:
        """Go on by a step in which the board comes to tilts (2,) [rad]; return the marble's centre [m]."""
        self._rates = (np.array(tilt) - self._tilt) / STEP_S
        self._data.qpos[:2], self._data.qvel[:2] = self._tilt, self._rates
        self._mujoco.mj_step(self._model, self._data)
        self._tilt, self._board = np.array(tilt), _turned(tilt)
        place: list[float] = (RADIUS_M * self._board.T @ self._data.qpos[2:5]).tolist()
        return place

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step."""
        self._data.xfrc_applied[3, :3] = self._board @ force / RADIUS_M
        self._data.xfrc_applied[3, 3:] = self._board @ torque / RADIUS_M**2
        self._model.geom_friction[0, 2] = self._friction * factor

    def velocity(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return velocity [m/s] and spin [rad/s] in the board's frame."""
        turning, carried = self._carried()
        moves = self._board.T @ (self._data.qvel[2:5] - carried)
        spin = self._board.T @ (self._rotation() @ self._data.qvel[5:8] - turning)
        return (RADIUS_M * moves).tolist(), spin.tolist()

    def set_velocity(self, moves: Sequence[float], turns: Sequence[float]) -> None:
        """Set velocity [m/s] and spin [rad/s] in the board's frame."""
        turning, carried = self._carried()
        self._data.qvel[2:5] = self._board @ np.divide(moves, RADIUS_M) + carried
        self._data.qvel[5:8] = self._rotation().T @ (self._board @ np.array(turns) + turning)

    def _carried(self) -> tuple[Array, Array]:
        """Return the board's spin [rad/s], and the velocity [radii/s] with which it carries the marble."""
        about_x, about_y = self._rates
        turning = np.array([about_x, *(about_y * np.array([np.cos(self._tilt[0]), np.sin(self._tilt[0])]))])
        return turning, np.cross(turning, self._data.qpos[2:5])

    def _rotation(self) -> Array:
        found = np.empty(9)
        self._mujoco.mju_quat2Mat(found, self._data.qpos[5:9])
        return found.reshape(3, 3)


def _turned(tilt: Sequence[float]) -> Array:
    """Return the rotation (3, 3) about x, then about the y that has turned with it."""
    (cos_x, cos_y), (sin_x, sin_y) = np.cos(tilt), np.sin(tilt)
    return np.array(
        [
            [cos_y, 0.0, sin_y],
            [sin_x * sin_y, cos_x, -sin_x * cos_y],
            [-cos_x * sin_y, sin_x, cos_x * cos_y],
        ]
    )


def _xml(rolling_friction: float, heavy: Array) -> str:
    """Return the model: a board, four rims, and a marble with its centre of mass at `heavy` [radii]."""
    half_x, half_y, thick, high = 0.5 * EDGE_X_M / RADIUS_M, 0.5 * EDGE_Y_M / RADIUS_M, 2.0, 3.0
    friction = f'friction="{_SLIDING} {_SPINNING} {rolling_friction}"'
    rims = "".join(
        f'<geom type="box" pos="{x * (half_x + thick)} {y * (half_y + thick)} {high}" '
        f'size="{thick if x else half_x + 2 * thick} {thick if y else half_y + 2 * thick} {high}" '
        f'{friction} solref="{_CONTACT_S} {_DEAD}"/>'
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    hinge = f'armature="{_PLATE}"'
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    return f"""
    <mujoco>
      <option timestep="{STEP_S}" gravity="0 0 {-GRAVITY / RADIUS_M}" integrator="Euler" solver="Newton"
        cone="elliptic" impratio="1000" iterations="50" tolerance="1e-8"/>
      <default>
        <geom condim="6" contype="1" conaffinity="2" solref="{_CONTACT_S} 1" solimp="0.99 0.99 0.001"/>
      </default>
      <worldbody>
        <body><joint type="hinge" axis="1 0 0" {hinge}/>{inertia}
          <body><joint type="hinge" axis="0 1 0" {hinge}/>{inertia}
            <geom type="box" pos="0 0 {-thick}" size="{half_x + 9} {half_y + 9} {thick}" {friction}/>{rims}
          </body>
        </body>
        <body><freejoint/>
          <inertial pos="{heavy[0]} {heavy[1]} {heavy[2]}" mass="1" diaginertia="0.4 0.4 0.4"/>
          <geom type="sphere" size="1" contype="2" conaffinity="1" priority="-1"/>
        </body>
      </worldbody>
    </mujoco>"""


MUJOCO = Engine(lambda base, start, hidden: nullcontext(_Ball(base, start, hidden)), _TURN_S)
