"""The same board, rim, marble and hidden physics in MuJoCo.

Lengths are in marble radii and masses in marbles, because MuJoCo takes a coefficient of rolling friction, a
length, for at least 1e-5. As in PyBullet the board is fixed and gravity turns, and the rim's restitution is
an impulse: in MuJoCo it would follow from stiffness and damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .engine import STEP_S, Base, follow, heavy_side
from .physics import EDGE_X_M, EDGE_Y_M, RADIUS_M, Array, Physics

#: Coulomb friction of the board and of the rim, and friction against spins about the normal [radii].
_SLIDING, _SPINNING = 0.25, 1e-4
#: Time constant of a contact [s], and damping ratio of a rim that throws nothing back.
_CONTACT_S, _DEAD = 4.0 * STEP_S, 3.0


def roll(base: Base, tilts: Array, start_m: tuple[float, float], hidden: Sequence[Physics]) -> Array:
    """Return the marble's centre (steps + 1, 2) [m]; arguments as for `engine.roll`."""
    import mujoco  # noqa: PLC0415

    return follow(_Body(mujoco, base, start_m, hidden), base, tilts, start_m, hidden)


class _Body:
    """The marble in its model: a `Body`."""

    def __init__(
        self, mujoco: Any, base: Base, start_m: tuple[float, float], hidden: Sequence[Physics]
    ) -> None:
        heavy = heavy_side(hidden) / RADIUS_M
        self._mujoco = mujoco
        self._model = mujoco.MjModel.from_xml_string(_xml(base.rolling_friction, heavy))
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:2] = np.divide(start_m, RADIUS_M)
        self._friction = base.rolling_friction

    def step(self, pull: Sequence[float]) -> list[float]:
        """Go on by a step under gravity (3,) [m/s^2]; return the marble's centre [m]."""
        self._model.opt.gravity[:] = np.divide(pull, RADIUS_M)
        self._mujoco.mj_step(self._model, self._data)
        place: list[float] = (RADIUS_M * self._data.qpos[:3]).tolist()
        return place

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step."""
        self._data.xfrc_applied[1, :3] = force / RADIUS_M
        self._data.xfrc_applied[1, 3:] = torque / RADIUS_M**2
        self._model.geom_friction[0, 2] = self._friction * factor

    def velocity(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return velocity [m/s] and spin [rad/s] in the board's frame."""
        return (RADIUS_M * self._data.qvel[:3]).tolist(), (self._rotation() @ self._data.qvel[3:]).tolist()

    def set_velocity(self, moves: Sequence[float], turns: Sequence[float]) -> None:
        """Set velocity [m/s] and spin [rad/s] in the board's frame."""
        self._data.qvel[:3] = np.divide(moves, RADIUS_M)
        self._data.qvel[3:] = self._rotation().T @ np.array(turns)

    def _rotation(self) -> Array:
        found = np.empty(9)
        self._mujoco.mju_quat2Mat(found, self._data.qpos[3:])
        return found.reshape(3, 3)


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
    return f"""
    <mujoco>
      <option timestep="{STEP_S}" integrator="Euler" solver="Newton" cone="elliptic" impratio="1000"
        iterations="50" tolerance="1e-8"/>
      <default>
        <geom condim="6" contype="1" conaffinity="2" solref="{_CONTACT_S} 1" solimp="0.99 0.99 0.001"/>
      </default>
      <worldbody>
        <geom type="plane" size="{half_x + 9} {half_y + 9} 1" {friction}/>{rims}
        <body pos="0 0 1"><freejoint/>
          <inertial pos="{heavy[0]} {heavy[1]} {heavy[2]}" mass="1" diaginertia="0.4 0.4 0.4"/>
          <geom type="sphere" size="1" contype="2" conaffinity="1" priority="-1"/>
        </body>
      </worldbody>
    </mujoco>"""
