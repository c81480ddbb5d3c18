"""Friction and drag of the marble."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import GRAVITY, RADIUS_M, Marble, Physics, between, on_board

#: Speed [m/s] below which the marble rests: in Bullet a held one creeps by some micrometres per second.
REST_M_PER_S = 2e-5


@dataclass(frozen=True)
class StaticFriction(Physics):
    """Static friction: a resting marble needs `ratio` times the tilt that keeps it rolling."""

    name: ClassVar[str] = "static_friction"
    ratio: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(1.0 + between(0.2, 4.0, strength))

    def resist(self, marble: Marble) -> float:
        ahead_x = marble.vx + 5.0 / 7.0 * marble.pull_x * marble.length
        ahead_y = marble.vy + 5.0 / 7.0 * marble.pull_y * marble.length
        turns_back = marble.vx * ahead_x + marble.vy * ahead_y <= 0.0
        holds = math.hypot(marble.pull_x, marble.pull_y) <= self.ratio * marble.friction * GRAVITY
        return self.ratio if holds and (turns_back or marble.speed < REST_M_PER_S) else 1.0


@dataclass(frozen=True)
class Stribeck(Physics):
    """Resistance is higher by `strength` near rest; 37 % of the excess remain at `speed_m_per_s`."""

    name: ClassVar[str] = "stribeck"
    strength: float
    speed_m_per_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.2, 3.0, strength), float(np.exp(random.uniform(np.log(0.005), np.log(0.05)))))

    def resist(self, marble: Marble) -> float:
        return 1.0 + self.strength * math.exp(-marble.speed / self.speed_m_per_s)


@dataclass(frozen=True)
class ViscousDrag(Physics):
    """Viscous drag of felt or oil: velocity and spin lose this part per second [1/s]."""

    name: ClassVar[str] = "viscous_drag"
    rate_per_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.03, 2.0, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        return -self.rate_per_s * marble.vx, -self.rate_per_s * marble.vy

    def torque(self, marble: Marble) -> tuple[float, float, float]:
        part = -self.rate_per_s * 0.4 * RADIUS_M**2
        return part * marble.spin[0], part * marble.spin[1], part * marble.spin[2]


@dataclass(frozen=True)
class QuadraticDrag(Physics):
    """Air drag: a rolling marble loses this part of its speed per metre [1/m].

    The force acts on the centre, so a rolling sphere needs 7/5 of the force that slows a sliding body
    equally.
    """

    name: ClassVar[str] = "quadratic_drag"
    coefficient_per_m: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.3, 20.0, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        part = -1.4 * self.coefficient_per_m * marble.speed
        return part * marble.vx, part * marble.vy


@dataclass(frozen=True)
class AnisotropicFriction(Physics):
    """Wood grain: resistance across it is `ratio` times that along it; the grain's angle is from x.

    It acts against the motion, or at rest against the driving force.
    """

    name: ClassVar[str] = "anisotropic_friction"
    ratio: float
    grain_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(1.0 + between(0.2, 4.0, strength), float(random.uniform(0.0, np.pi)))

    def resist(self, marble: Marble) -> float:
        x = marble.vx + marble.pull_x * marble.length
        y = marble.vy + marble.pull_y * marble.length
        angle = math.atan2(y, x) - self.grain_rad
        return math.hypot(math.cos(angle), self.ratio * math.sin(angle))


@dataclass(frozen=True)
class FrictionPatch(Physics):
    """A disc [m] with `factor` times the rolling resistance: dust, polish, a dried drop.

    Its edge is two millimetres wide.
    """

    name: ClassVar[str] = "friction_patch"
    x_m: float
    y_m: float
    radius_m: float
    factor: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        rough = random.random() < 0.8
        factor = 1.0 + between(0.5, 7.0, strength) if rough else 1.0 - between(0.2, 0.8, strength)
        return cls(*on_board(random, 0.7), float(random.uniform(0.02, 0.08)), factor)

    def resist(self, marble: Marble) -> float:
        inside = self.radius_m + 0.001 - math.hypot(marble.x - self.x_m, marble.y - self.y_m)
        return 1.0 + (self.factor - 1.0) * min(max(inside / 0.002, 0.0), 1.0)
