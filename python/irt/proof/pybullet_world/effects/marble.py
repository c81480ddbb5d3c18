"""The marble itself, and the rim that sends it back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import Marble, Physics, between, either

#: Rolling friction that every rig has: a tilt at which a marble on level ground stays [rad].
LEAST_FRICTION = 1.5e-4


@dataclass(frozen=True)
class SideForce(Physics):
    """A spinning marble is turned aside: its velocity turns left by this angle each second [1/s].

    The force takes hold of its middle, so 7/5 of it goes to the turn of a rolling sphere.
    """

    name: ClassVar[str] = "side_force"
    rate_per_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(either(random) * between(0.03, 1.0, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        return -1.4 * self.rate_per_s * marble.vy, 1.4 * self.rate_per_s * marble.vx


@dataclass(frozen=True)
class EccentricMarble(Physics):
    """A centre of mass beside the marble's middle: it turns with the rigid body in three dimensions.

    `offset` is in radii. When the marble is let go, the heavy side lies `phase_rad` from the top towards +x
    in the board's x-z plane, and from there `lean_rad` towards +y; as the marble rests on a level board, that
    is below, as near as friction holds it.
    """

    name: ClassVar[str] = "eccentric_marble"
    offset: float
    phase_rad: float
    lean_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        offset = between(2e-4, 0.004, strength)
        held = min(1.0, LEAST_FRICTION / offset) * math.sqrt(random.random())
        towards = random.uniform(0.0, 2.0 * np.pi)
        lean = math.asin(held * math.sin(towards))
        return cls(offset, math.pi - math.asin(held * math.cos(towards) / math.cos(lean)), lean)

    def heavy_side(self) -> tuple[float, float, float]:
        level = self.offset * math.cos(self.lean_rad)
        aside = self.offset * math.sin(self.lean_rad)
        return level * math.sin(self.phase_rad), aside, level * math.cos(self.phase_rad)


@dataclass(frozen=True)
class WallRestitution(Physics):
    """A rim that returns this part of the normal speed more than the dead one that rig.toml tells of."""

    name: ClassVar[str] = "wall_restitution"
    increase: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.1, 0.9, strength))

    def bounce(self, restitution: float) -> float:
        return min(max(restitution + self.increase, 0.0), 0.95)
