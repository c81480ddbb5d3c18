"""Physics outside the catalogue: repeatable, plausible, and different from all of its effects."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import ClassVar, Self

import numpy as np

from .physics import EDGE_X_M, EDGE_Y_M, GRAVITY, RADIUS_M, Array, Marble, Physics, between, either

#: Distance from the rim at which a marble leans on it [m]; contacts yield.
LEANS_M = 3e-4


@dataclass(frozen=True)
class Washboard(Physics):
    """Saw marks: a standing wave of the board, height sin(2 pi d/length + phase) along a direction."""

    name: ClassVar[str] = "washboard"
    height_m: float
    length_m: float
    angle_rad: float
    phase_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        length = float(random.uniform(0.03, 0.09))
        slope = between(8e-4, 4e-3, strength)
        angle, phase = random.uniform(0.0, [np.pi, 2.0 * np.pi])
        return cls(slope * length / (2.0 * np.pi), length, float(angle), float(phase))

    def force(self, marble: Marble) -> tuple[float, float]:
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        wave = 2.0 * math.pi / self.length_m
        at = wave * (marble.x * cos + marble.y * sin) + self.phase_rad
        push = -GRAVITY * self.height_m * wave * math.cos(at)
        return push * cos, push * sin


@dataclass(frozen=True)
class Draught(Physics):
    """An oscillating fan: wind along one direction, a sine of the time since the release."""

    name: ClassVar[str] = "draught"
    push_m_per_s2: float
    frequency_hz: float
    angle_rad: float
    phase_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        angle, phase = random.uniform(0.0, 2.0 * np.pi, 2)
        push = between(0.006, 0.05, strength)
        return cls(push, float(random.uniform(0.15, 0.8)), float(angle), float(phase))

    def force(self, marble: Marble) -> tuple[float, float]:
        push = self.push_m_per_s2 * math.sin(2.0 * math.pi * self.frequency_hz * marble.time + self.phase_rad)
        return push * math.cos(self.angle_rad), push * math.sin(self.angle_rad)


@dataclass(frozen=True)
class Swirl(Physics):
    """A fan above the board: air that circulates about a point, a force that no slope can cause."""

    name: ClassVar[str] = "swirl"
    x_m: float
    y_m: float
    turn_per_s2: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        x, y = random.uniform(-0.04, 0.04, 2)
        return cls(float(x), float(y), either(random) * between(0.04, 0.4, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        return -self.turn_per_s2 * (marble.y - self.y_m), self.turn_per_s2 * (marble.x - self.x_m)


@dataclass(frozen=True)
class Groove(Physics):
    """A long scratch, or the ridge of a glued joint: a Gaussian profile across a line, the same along it."""

    name: ClassVar[str] = "groove"
    depth_m: float
    width_m: float
    distance_m: float
    angle_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        width = float(random.uniform(0.006, 0.02))
        depth = either(random) * between(0.001, 0.006, strength) * width
        distance, angle = random.uniform([-0.03, 0.0], [0.03, np.pi])
        return cls(depth, width, float(distance), float(angle))

    def force(self, marble: Marble) -> tuple[float, float]:
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        across = (marble.x * cos + marble.y * sin - self.distance_m) / self.width_m
        push = -GRAVITY * self.depth_m / self.width_m * across * math.exp(-0.5 * across * across)
        return push * cos, push * sin


@dataclass(frozen=True)
class Crease(Physics):
    """A board of two halves at an angle: a push that changes its sign at their joint."""

    name: ClassVar[str] = "crease"
    slope_rad: float
    distance_m: float
    angle_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        distance, angle = random.uniform([-0.02, 0.0], [0.02, np.pi])
        return cls(either(random) * between(3e-4, 2e-3, strength), float(distance), float(angle))

    def force(self, marble: Marble) -> tuple[float, float]:
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        # A joint is some millimetres wide.
        side = math.tanh((marble.x * cos + marble.y * sin - self.distance_m) / 0.003)
        push = -GRAVITY * self.slope_rad * side
        return push * cos, push * sin


@dataclass(frozen=True)
class Resonance(Physics):
    """A board on soft springs that oscillates about its commanded angle, with a natural frequency [rad/s]."""

    name: ClassVar[str] = "resonance"
    rate_rad_per_s: float
    damping: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(9.0, 2.5, strength), float(random.uniform(0.05, 0.2)))

    def turn(self, knobs: Array, step_s: float) -> Array:
        # The exact step of a state (angle - goal, speed): decay times a rotation, which never grows.
        natural, fade = self.rate_rad_per_s, self.damping * self.rate_rad_per_s
        ringing = math.sqrt(natural**2 - fade**2)
        cos, sin = math.cos(ringing * step_s), math.sin(ringing * step_s) / ringing
        left = math.exp(-fade * step_s)

        def swing(goals: list[float]) -> Iterator[float]:
            at, speed = 0.0, 0.0
            for goal in goals:
                away = at - goal
                at = goal + left * (away * (cos + fade * sin) + speed * sin)
                speed = left * (speed * (cos - fade * sin) - away * natural**2 * sin)
                yield at

        return np.array([list(swing(goals)) for goals in knobs.T.tolist()]).T


@dataclass(frozen=True)
class SoftCord(Physics):
    """A cord that yields at speed: the faster the knob turns, the less of its angle reaches the board.

    The knob follows its command in a quarter of a second; its angle is scaled by 1/(1 + (speed/soft)^2).
    """

    name: ClassVar[str] = "soft_cord"
    soft_rad_per_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.2, 0.02, strength))

    def turn(self, knobs: Array, step_s: float) -> Array:
        left = math.exp(-step_s / 0.25)
        paths = [
            list(accumulate(goals, lambda at, goal: goal + (at - goal) * left, initial=0.0))[1:]
            for goals in knobs.T.tolist()
        ]
        angles = np.array(paths).T
        speeds = np.diff(angles, axis=0, prepend=np.zeros((1, 2))) / step_s
        return np.asarray(angles / (1.0 + (speeds / self.soft_rad_per_s) ** 2))


@dataclass(frozen=True)
class WarmMotors(Physics):
    """Motors that weaken as they warm up: the knobs' turns shrink, each by its own share."""

    name: ClassVar[str] = "warm_motors"
    x_share: float
    y_share: float
    warm_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size, angle = between(0.05, 0.6, strength), random.uniform(0.0, 0.5 * np.pi)
        return cls(float(size * np.cos(angle)), float(size * np.sin(angle)), float(random.uniform(2.0, 8.0)))

    def turn(self, knobs: Array, step_s: float) -> Array:
        warm = -np.expm1(-step_s / self.warm_s * np.arange(len(knobs)))[:, None]
        return np.asarray(knobs * (1.0 - (self.x_share, self.y_share) * warm))


@dataclass(frozen=True)
class SwayingTable(Physics):
    """A player who turns both knobs leans on the table: their product adds to each angle [rad/rad^2]."""

    name: ClassVar[str] = "swaying_table"
    x_per_rad: float
    y_per_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size, angle = between(2.0, 15.0, strength), random.uniform(0.0, 2.0 * np.pi)
        return cls(float(size * np.cos(angle)), float(size * np.sin(angle)))

    def turn(self, knobs: Array, step_s: float) -> Array:
        return knobs + knobs[:, :1] * knobs[:, 1:] * (self.x_per_rad, self.y_per_rad)


@dataclass(frozen=True)
class Dust(Physics):
    """A marble that picks up dust: its resistance grows with the path length and doubles after `way_m`."""

    name: ClassVar[str] = "dust"
    way_m: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.3, 0.03, strength))

    def resist(self, marble: Marble) -> float:
        return 1.0 + marble.way / self.way_m


@dataclass(frozen=True)
class EddyBrake(Physics):
    """A magnet under the board brakes a marble that passes over it in proportion to its speed."""

    name: ClassVar[str] = "eddy_brake"
    x_m: float
    y_m: float
    radius_m: float
    rate_per_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        x, y = random.uniform(-0.03, 0.03, 2)
        return cls(float(x), float(y), float(random.uniform(0.02, 0.035)), between(0.4, 4.0, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        dx, dy = (marble.x - self.x_m) / self.radius_m, (marble.y - self.y_m) / self.radius_m
        rate = self.rate_per_s * math.exp(-0.5 * (dx * dx + dy * dy))
        return -rate * marble.vx, -rate * marble.vy


@dataclass(frozen=True)
class Nap(Physics):
    """Felt with a nap: rolling against it resists more than rolling with it, by `share` both ways."""

    name: ClassVar[str] = "nap"
    share: float
    angle_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.25, 1.0, strength), float(random.uniform(0.0, 2.0 * np.pi)))

    def resist(self, marble: Marble) -> float:
        x = marble.vx + marble.pull_x * marble.length
        y = marble.vy + marble.pull_y * marble.length
        return 1.0 - self.share * math.cos(math.atan2(y, x) - self.angle_rad)


@dataclass(frozen=True)
class Yaw(Physics):
    """A slack gimbal: each tilt also turns the board about the vertical, and so its picture [rad/rad]."""

    name: ClassVar[str] = "yaw"
    from_x: float
    from_y: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size, angle = between(15.0, 100.0, strength), random.uniform(0.0, 2.0 * np.pi)
        return cls(float(size * np.cos(angle)), float(size * np.sin(angle)))

    def see(self, seen: Array, tilts: Array) -> Array:
        turn = tilts @ np.array([self.from_x, self.from_y])
        turned = (seen[:, 0] + 1j * seen[:, 1]) * np.exp(1j * turn)
        return np.stack([turned.real, turned.imag], axis=1)


@dataclass(frozen=True)
class MagneticLine(Physics):
    """A steel strip 2 cm below the board: attraction to a line with the inverse of the distance."""

    name: ClassVar[str] = "magnetic_line"
    distance_m: float
    angle_rad: float
    strength_m2_per_s2: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        distance, angle = random.uniform([-0.25, 0.0], [0.25, np.pi])
        pull = between(5e-5, 8e-4, strength)
        return cls(float(distance * EDGE_X_M), float(angle), either(random) * pull)

    def force(self, marble: Marble) -> tuple[float, float]:
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        away = marble.x * cos + marble.y * sin - self.distance_m
        push = -self.strength_m2_per_s2 * away / (away * away + 0.02**2)
        return push * cos, push * sin


@dataclass(frozen=True)
class StickyRim(Physics):
    """A rim that holds a marble which leans on it against a pull away from it [m/s^2]."""

    name: ClassVar[str] = "sticky_rim"
    hold_m_per_s2: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.03, 0.5, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        pulls = zip(_leaning(marble), (marble.pull_x, marble.pull_y), strict=True)
        x, y = (side * max(0.0, min(self.hold_m_per_s2, -side * pull)) for side, pull in pulls)
        return x, y


@dataclass(frozen=True)
class FeltRim(Physics):
    """A rim of felt, which drags on a marble that rolls along it."""

    name: ClassVar[str] = "felt_rim"
    rate_per_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(1.0, 30.0, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        along_y, along_x = _leaning(marble)
        rate = self.rate_per_s
        return -rate * marble.vx * abs(along_x), -rate * marble.vy * abs(along_y)


def _leaning(marble: Marble) -> tuple[float, float]:
    """Return the sides of the rim along x and along y on which a marble leans: -1, 1, or 0 for none."""
    places = (marble.x, EDGE_X_M), (marble.y, EDGE_Y_M)
    x, y = (
        math.copysign(float(0.5 * edge - RADIUS_M - abs(place) < LEANS_M), place) for place, edge in places
    )
    return x, y


BEYOND: tuple[type[Physics], ...] = (
    Washboard,
    Draught,
    Swirl,
    Groove,
    Crease,
    Resonance,
    SoftCord,
    WarmMotors,
    SwayingTable,
    Dust,
    EddyBrake,
    Nap,
    Yaw,
    MagneticLine,
    StickyRim,
    FeltRim,
)
