"""Effects of a misplaced camera on tracked positions [board edges from the centre]."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import EDGE_X_M, Array, Physics, between, either


@dataclass(frozen=True)
class Parallax(Physics):
    """A board above its axes: the picture shifts with the tilt [m per rad]."""

    name: ClassVar[str] = "parallax"
    height_m_per_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(either(random) * between(0.03, 0.6, strength))

    def see(self, seen: Array, tilts: Array) -> Array:
        aside = self.height_m_per_rad / EDGE_X_M
        return seen + aside * np.stack([tilts[:, 1], -tilts[:, 0]], axis=1)


@dataclass(frozen=True)
class Perspective(Physics):
    """A tilted camera: relative growth of the distance per edge along x and y."""

    name: ClassVar[str] = "perspective"
    slope_x: float
    slope_y: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size, angle = between(0.02, 0.3, strength), random.uniform(0.0, 2.0 * np.pi)
        return cls(float(size * np.cos(angle)), float(size * np.sin(angle)))

    def see(self, seen: Array, tilts: Array) -> Array:
        return np.asarray(seen / (1.0 + seen @ np.array([self.slope_x, self.slope_y]))[:, None])


@dataclass(frozen=True)
class LensDistortion(Physics):
    """A lens with relative magnification k r^2, r in board edges from the centre; negative k for a barrel."""

    name: ClassVar[str] = "lens_distortion"
    k_per_edge2: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(either(random) * between(0.03, 0.5, strength))

    def see(self, seen: Array, tilts: Array) -> Array:
        return np.asarray(seen * (1.0 + self.k_per_edge2 * (seen**2).sum(axis=1, keepdims=True)))


@dataclass(frozen=True)
class CameraRotation(Physics):
    """A camera rotated about its line of sight: pictures turn by this angle [rad] from x towards y."""

    name: ClassVar[str] = "camera_rotation"
    angle_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(either(random) * between(0.005, 0.1745, strength))

    def see(self, seen: Array, tilts: Array) -> Array:
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return np.asarray(seen @ np.array([[cos, sin], [-sin, cos]]))


@dataclass(frozen=True)
class CameraOffset(Physics):
    """A shifted zero of the tracker: tracked position of the board's centre [board edges]."""

    name: ClassVar[str] = "camera_offset"
    x_edges: float
    y_edges: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size, angle = between(0.005, 0.1, strength), random.uniform(0.0, 2.0 * np.pi)
        return cls(float(size * np.cos(angle)), float(size * np.sin(angle)))

    def see(self, seen: Array, tilts: Array) -> Array:
        return np.asarray(seen + np.array([self.x_edges, self.y_edges]))
