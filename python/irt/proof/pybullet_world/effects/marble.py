"""The marble and the rim."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import Marble, Physics, between, either

#: Smallest rolling friction of a rig, as a tilt [rad].
LEAST_FRICTION = 1.5e-4


@dataclass(frozen=True)
class SideForce(Physics):
    """A side force on a spinning marble: its velocity turns left by this angle per second [1/s].

    The force acts on the centre, so a rolling sphere needs 7/5 of it.
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
    """A centre of mass off the marble's centre, which turns with the rigid body in three dimensions.

    `offset` is in radii. At the release the heavy side lies `phase_rad` from the top towards +x in the
    board's x-z plane, and from there `lean_rad` towards +y. Since the marble rests on a level board, it is at
    the bottom, up to the angle that friction holds.
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
    """A rim whose restitution exceeds that of rig.toml, which is zero."""

    name: ClassVar[str] = "wall_restitution"
    increase: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.1, 0.9, strength))

    def bounce(self, restitution: float) -> float:
        return min(max(restitution + self.increase, 0.0), 0.95)
