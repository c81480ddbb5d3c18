"""A board that is not flat, and attraction to a point.

For slopes of some thousandths the acceleration along the board is -g grad(height).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import GRAVITY, Marble, Physics, between, either, on_board


@dataclass(frozen=True)
class BoardWarp(Physics):
    """A bent board: height = (xx x^2 + 2 xy x y + yy y^2)/2, curvatures in 1/m, positive for a bowl."""

    name: ClassVar[str] = "board_warp"
    curvature_xx_per_m: float
    curvature_xy_per_m: float
    curvature_yy_per_m: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        size = between(0.004, 0.15, strength)
        shape = random.normal(size=3)
        xx, xy, yy = size * shape / np.abs(shape).max()
        return cls(float(xx), float(xy), float(yy))

    def force(self, marble: Marble) -> tuple[float, float]:
        slope_x = self.curvature_xx_per_m * marble.x + self.curvature_xy_per_m * marble.y
        slope_y = self.curvature_xy_per_m * marble.x + self.curvature_yy_per_m * marble.y
        return -GRAVITY * slope_x, -GRAVITY * slope_y


@dataclass(frozen=True)
class Bump(Physics):
    """A round bump or dent of Gaussian profile [m]; its width is the standard deviation."""

    name: ClassVar[str] = "bump"
    x_m: float
    y_m: float
    height_m: float
    width_m: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        height = either(random) * between(2e-5, 5e-4, strength)
        width = float(np.exp(random.uniform(np.log(0.012), np.log(0.04))))
        return cls(*on_board(random, 0.7), height, width)

    def force(self, marble: Marble) -> tuple[float, float]:
        dx, dy = marble.x - self.x_m, marble.y - self.y_m
        variance = self.width_m**2
        fall = self.height_m * math.exp(-(dx * dx + dy * dy) / (2.0 * variance))
        return GRAVITY * fall * dx / variance, GRAVITY * fall * dy / variance


@dataclass(frozen=True)
class PointField(Physics):
    """A magnet or charge three centimetres below a point on or beside the board, with an inverse square law.

    `strength_m3_per_s2` is its force per mass times the squared distance; positive attracts.
    """

    name: ClassVar[str] = "point_field"
    x_m: float
    y_m: float
    strength_m3_per_s2: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(*on_board(random, 1.4), either(random) * between(1e-5, 3e-3, strength))

    def force(self, marble: Marble) -> tuple[float, float]:
        below = 0.03
        dx, dy = self.x_m - marble.x, self.y_m - marble.y
        distance = math.sqrt(dx * dx + dy * dy + below * below)
        pull = self.strength_m3_per_s2 / distance**3
        return pull * dx, pull * dy
