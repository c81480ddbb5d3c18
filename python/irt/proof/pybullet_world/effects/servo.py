"""The motor and its controller, between the received command and the knob's angle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from typing import ClassVar, Self

import numpy as np

from ..physics import Array, Physics, between


@dataclass(frozen=True)
class CommandQuantisation(Physics):
    """Quantisation: the motor stops only at multiples of a smallest turn [rad]."""

    name: ClassVar[str] = "command_quantisation"
    step_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.0005, 0.02, strength))

    def turn(self, knobs: Array, step_s: float) -> Array:
        return np.asarray(self.step_rad * np.rint(knobs / self.step_rad))


@dataclass(frozen=True)
class DeadBand(Physics):
    """Dead band: the cord is slack within this angle of zero [rad], which the board also lacks beyond."""

    name: ClassVar[str] = "dead_band"
    half_width_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.005, 0.15, strength))

    def turn(self, knobs: Array, step_s: float) -> Array:
        return np.asarray(np.sign(knobs) * np.maximum(np.abs(knobs) - self.half_width_rad, 0.0))


@dataclass(frozen=True)
class SlewLimit(Physics):
    """Slew limit: maximum rate of the motor [rad/s]."""

    name: ClassVar[str] = "slew_limit"
    rate_rad_per_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(2.0, 0.02, strength))

    def turn(self, knobs: Array, step_s: float) -> Array:
        most = self.rate_rad_per_s * step_s
        return along(knobs, lambda at, goal: at + min(max(goal - at, -most), most))


@dataclass(frozen=True)
class Lag(Physics):
    """Lag of a soft position loop: the knob covers 63 % of a step in this time [s]."""

    name: ClassVar[str] = "lag"
    time_constant_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.02, 1.0, strength))

    def turn(self, knobs: Array, step_s: float) -> Array:
        left = math.exp(-step_s / self.time_constant_s)
        return along(knobs, lambda at, goal: goal + (at - goal) * left)


def along(knobs: Array, follow: Callable[[float, float], float]) -> Array:
    """Return the path (n, k) of knobs that start at zero and follow by `follow(angle, goal)`."""
    paths = [list(accumulate(goals, follow, initial=0.0))[1:] for goals in knobs.T.tolist()]
    return np.array(paths).T
