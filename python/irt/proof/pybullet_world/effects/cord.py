"""The cord between knob and lever, its pulley and its spring."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import Array, Physics, between
from .servo import along


@dataclass(frozen=True)
class Backlash(Physics):
    """Backlash: the cord slips on its pulley through a gap [rad of knob] at each reversal, first by half."""

    name: ClassVar[str] = "backlash"
    width_x_rad: float
    width_y_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        width = between(0.004, 0.15, strength)
        x, y = width * np.exp(random.uniform(-0.5, 0.5, 2))
        return cls(float(x), float(y))

    def turn(self, knobs: Array, step_s: float) -> Array:
        def slip(half: float, commanded: Array) -> Array:
            return along(commanded, lambda at, knob: min(max(at, knob - half), knob + half))

        widths = (self.width_x_rad, self.width_y_rad)
        return np.hstack([slip(0.5 * width, knobs[:, [axis]]) for axis, width in enumerate(widths)])


@dataclass(frozen=True)
class SpringHysteresis(Physics):
    """Hysteresis: the spring adds `strength` times a stretch z, which yields at `width_rad`.

    Bouc and Wen's law dz = dθ - (|dθ| z + dθ |z|)/(2 width) depends on angles and not on time, and the knob
    passes through all angles of a turn, so the law is solved exactly along the turn. While dθ
    and z have one sign that is z → ±width + (z ∓ width) exp(-|dθ|/width), else z → z + dθ. A simulator
    that takes each command as one step of the law agrees where commands change by much less than the
    width, and stretches farther on jumps.
    """

    name: ClassVar[str] = "spring_hysteresis"
    strength: float
    width_rad: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        adds = random.random() < 0.75
        size = between(0.1, 1.5, strength) if adds else -between(0.1, 0.5, strength)
        return cls(size, float(np.exp(random.uniform(np.log(0.02), np.log(0.2)))))

    def turn(self, knobs: Array, step_s: float) -> Array:
        ways = np.diff(knobs, axis=0, prepend=np.zeros((1, 2)))
        return knobs + self.strength * along(ways, self._stretch)

    def _stretch(self, held: float, way: float) -> float:
        """Return the stretch after the knob has turned by `way`."""
        if way * held < 0.0:
            let_off = math.copysign(min(abs(way), abs(held)), way)
            held, way = held + let_off, way - let_off
        if way == 0.0:
            return held
        end = math.copysign(self.width_rad, way)
        return end + (held - end) * math.exp(-abs(way) / self.width_rad)
