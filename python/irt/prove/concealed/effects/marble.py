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

    `offset` is in radii. When the marble is let go, the heavy side lies in the board's x-z plane,
    `phase_rad` from the top towards +x; as the marble rests on a level board, that is below, as near as
    friction holds it. A marble that then rolls along +x is pushed on by 5/7 g offset sin(x/radius +
    phase). Whoever takes the heavy side to turn with the way so far, always in the plane of the motion,
    agrees until the marble turns back or aside: a true one turns its heavy side back too, which no law of
    the way alone does.
    """

    name: ClassVar[str] = "eccentric_marble"
    offset: float
    phase_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        offset = between(2e-4, 0.004, strength)
        held = math.asin(min(1.0, LEAST_FRICTION / offset))
        return cls(offset, float(np.pi + random.uniform(-held, held)))

    def heavy_side(self) -> tuple[float, float, float]:
        return self.offset * math.sin(self.phase_rad), 0.0, self.offset * math.cos(self.phase_rad)


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
