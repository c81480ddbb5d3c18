"""Base class of hidden physics: the places of a rig in which it can act."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81
EDGE_X_M, EDGE_Y_M = 0.276, 0.231
RADIUS_M = 0.00685
MASS_KG = 0.0105


@dataclass(slots=True)
class Marble:
    """State for forces on the marble, at the beginning of a step.

    Attributes
    ----------
    time, length : float
        Time since the release, and length of the step [s].
    x, y, vx, vy : float
        The marble's centre in the board's frame [m, m/s].
    spin : tuple
        Angular velocity about x, y, z [rad/s].
    way : float
        Path length since the release [m].
    pull_x, pull_y : float
        Acceleration of a freely sliding marble by gravity along the board [m/s^2].
    friction : float
        Rolling friction of the base: the tilt up to which the marble rests.
    """

    x: float
    y: float
    length: float
    time: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    way: float = 0.0
    pull_x: float = 0.0
    pull_y: float = 0.0
    friction: float = 0.0

    @property
    def speed(self) -> float:
        """Speed of the centre [m/s]."""
        return math.hypot(self.vx, self.vy)


@dataclass(frozen=True)
class Physics:
    """Physics beyond the five parameters. A subclass overrides the methods of the places where it acts.

    The fields of a subclass are its parameters. Times are in seconds since the release at row 0. Arrays of
    knobs and tilts have one row for each step of the engine, with angles in radians about x and about y.
    """

    name: ClassVar[str] = ""

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        """Draw parameters; `strength` from 0 to 1 goes from the smallest plausible size to the largest."""
        raise NotImplementedError

    def parameters(self) -> dict[str, Any]:
        """Return its name and the values of its parameters."""
        return {"name": self.name, **asdict(self)}

    def arrive(self, times: Array, random: np.random.Generator) -> Array:
        """Return the arrival times at the knob (n,) of commands issued for `times`."""
        return times

    def expose(self, times: Array) -> Array:
        """Return the times of the pictures (n,) of rows at `times`."""
        return times

    def turn(self, knobs: Array, step_s: float) -> Array:
        """Return the actual angles (n, 2) of knobs commanded to `knobs`, at rest at zero before."""
        return knobs

    def lean(self, tilts: Array) -> Array:
        """Return the actual tilts (n, 2) of a board that its knobs alone would tilt by `tilts`."""
        return tilts

    def force(self, marble: Marble) -> tuple[float, float]:
        """Return a force through the marble's centre, divided by its mass [m/s^2]."""
        return 0.0, 0.0

    def torque(self, marble: Marble) -> tuple[float, float, float]:
        """Return a torque on the marble, divided by its mass [m^2/s^2]."""
        return 0.0, 0.0, 0.0

    def resist(self, marble: Marble) -> float:
        """Return the factor on the rolling resistance in this state."""
        return 1.0

    def bounce(self, restitution: float) -> float:
        """Return the restitution of the rim."""
        return restitution

    def heavy_side(self) -> tuple[float, float, float]:
        """Return the centre of mass at the release, relative to the marble's centre [radii]."""
        return 0.0, 0.0, 0.0

    def see(self, seen: Array, tilts: Array) -> Array:
        """Return the tracked positions (n, 2) [board edges] for errorless positions `seen`."""
        return seen


def acts(one: Physics, place: str) -> bool:
    """Return whether a kind of physics overrides that method."""
    return getattr(type(one), place) is not getattr(Physics, place)


def between(least: float, most: float, strength: float) -> float:
    """Return the magnitude at `strength` from 0 to 1 on a logarithmic scale from `least` to `most`."""
    return float(least * (most / least) ** strength)


def either(random: np.random.Generator) -> float:
    """Return plus or minus one."""
    return 1.0 if random.random() < 0.5 else -1.0


def on_board(random: np.random.Generator, share: float) -> tuple[float, float]:
    """Return a point [m] within that share of the board about its centre."""
    x, y = random.uniform(-0.5, 0.5, 2) * share
    return float(x * EDGE_X_M), float(y * EDGE_Y_M)
