"""Times of commands and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from ..physics import Array, Physics, between, either


@dataclass(frozen=True)
class Delay(Physics):
    """Delay in networks and controllers: every command reaches the knob late by this time [s]."""

    name: ClassVar[str] = "delay"
    delay_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.02, 0.6, strength))

    def arrive(self, times: Array, random: np.random.Generator) -> Array:
        return times + self.delay_s


@dataclass(frozen=True)
class DelayJitter(Physics):
    """Delay jitter: each command has its own normal delay with this spread [s], never early."""

    name: ClassVar[str] = "delay_jitter"
    sd_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.01, 0.2, strength))

    def arrive(self, times: Array, random: np.random.Generator) -> Array:
        return times + np.maximum(0.0, self.sd_s * random.normal(size=len(times)))


@dataclass(frozen=True)
class ClockDrift(Physics):
    """A camera clock that drifts against the clock of the commands; on average they agree.

    The last row is longer than the first by `drift` times the mean.
    """

    name: ClassVar[str] = "clock_drift"
    drift: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(either(random) * between(0.02, 0.2, strength))

    def expose(self, times: Array) -> Array:
        lengths = np.diff(times)
        part = (np.arange(len(lengths)) + 0.5) / len(lengths) - 0.5
        passed = np.cumsum(lengths * (1.0 + self.drift * part))
        return np.asarray(times[0] + np.concatenate([[0.0], passed]))


@dataclass(frozen=True)
class Latency(Physics):
    """Age of a picture [s] when its row is written: exposure, transfer and detection."""

    name: ClassVar[str] = "latency"
    latency_s: float

    @classmethod
    def draw(cls, random: np.random.Generator, strength: float) -> Self:
        return cls(between(0.01, 0.3, strength))

    def expose(self, times: Array) -> Array:
        return times - self.latency_s
