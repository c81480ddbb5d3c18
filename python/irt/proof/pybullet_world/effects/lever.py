"""Levers, gimbal and table, between the knob's and the board's angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import Array, Physics, between, either


@dataclass(frozen=True)
class GearNonlinearity(Physics):
    """A lever that turns away from the cord: relative change of the gear per squared angle [1/rad^2]."""

    name: ClassVar[str] = "gear_nonlinearity"
    cubic_per_rad2: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size = between(3.0, 60.0, strength)
        # A gear that falls by more than a third over the knob's range would turn the board back.
        return cls(size if random.random() < 0.5 else -min(size, 20.0))

    def turn(self, knobs: Array, step_s: float) -> Array:
        return knobs * (1.0 + self.cubic_per_rad2 * knobs**2)


@dataclass(frozen=True)
class GearAsymmetry(Physics):
    """Springs of unequal tension: positive turns tilt more by this part, negative ones less."""

    name: ClassVar[str] = "gear_asymmetry"
    asymmetry_x: float
    asymmetry_y: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size = between(0.02, 0.3, strength)
        x, y = size * either(random), size * random.uniform(-1.0, 1.0)
        return cls(x, float(y)) if random.random() < 0.5 else cls(float(y), x)

    def turn(self, knobs: Array, step_s: float) -> Array:
        return knobs + np.abs(knobs) * (self.asymmetry_x, self.asymmetry_y)


@dataclass(frozen=True)
class CrossCoupling(Physics):
    """Axes that are not perpendicular: each also gets this part of the other's tilt."""

    name: ClassVar[str] = "cross_coupling"
    x_from_y: float
    y_from_x: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size = between(0.02, 0.3, strength)
        x, y = size * either(random), size * random.uniform(-1.0, 1.0)
        return cls(x, float(y)) if random.random() < 0.5 else cls(float(y), x)

    def lean(self, tilts: Array) -> Array:
        return tilts + tilts[:, ::-1] * (self.x_from_y, self.y_from_x)


@dataclass(frozen=True)
class TiltBias(Physics):
    """A table that is not level: tilt of the board [rad] while its knobs are level."""

    name: ClassVar[str] = "tilt_bias"
    bias_x_rad: float
    bias_y_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size, angle = between(0.0002, 0.005, strength), random.uniform(0.0, 2.0 * np.pi)
        return cls(float(size * np.cos(angle)), float(size * np.sin(angle)))

    def lean(self, tilts: Array) -> Array:
        return np.asarray(tilts + np.array([self.bias_x_rad, self.bias_y_rad]))
