"""A marble that an engine moves step by step on a board that turns, pushed by hidden physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .physics import GRAVITY, RADIUS_M, Array, Marble, Physics, acts
from .rim import Moving, Rim

STEP_S = 1 / 960
#: A unit of `time_scale`: the paper's physics update.
UPDATE_S = 1 / 240


@dataclass(frozen=True)
class Base:
    """The five parameters that every simulator of the board has, in the units of the recordings' format."""

    gear_x: float
    gear_y: float
    rolling_friction: float
    time_scale: float
    observation_scale: float

    @property
    def row_s(self) -> float:
        """Seconds from one row to the next."""
        return self.time_scale * UPDATE_S


@dataclass(frozen=True)
class Start:
    """A marble at rest on its board.

    Attributes
    ----------
    place_m : tuple
        The marble's centre in the board's frame [m].
    tilt : tuple
        Tilts of the board [rad].
    """

    place_m: tuple[float, float]
    tilt: tuple[float, float] = (0.0, 0.0)


class Body(Moving, Protocol):
    """A marble in an engine, in SI units and the board's frame."""

    def step(self, tilt: Sequence[float]) -> Sequence[float]:
        """Go on by a step in which the board comes to tilts (2,) [rad]; return the marble's centre [m]."""

    def push(self, force: Array, torque: Array, factor: float) -> None:
        """Push the marble in the next step.

        Parameters
        ----------
        force, torque : (3,) array
            At the centre of mass, divided by the mass [m/s^2], [m^2/s^2].
        factor : float
            Factor on the rolling friction.
        """


@dataclass(frozen=True)
class Engine:
    """An engine.

    Attributes
    ----------
    body : callable
        Makes a marble at rest, in a context that ends with it.
    turn_s : float
        Time that its board takes from one tilt to the next [s]: it passes the middle when it should turn, so
        that this is no delay. A board whose gravity turns instead needs none.
    """

    body: Callable[[Base, Start, Sequence[Physics]], AbstractContextManager[Body]]
    turn_s: float = 0.0


class Rolling:
    """A marble on its way: its engine, its rim, and the hidden physics that pushes it."""

    def __init__(self, body: Body, base: Base, start: Start, hidden: Sequence[Physics]) -> None:
        self._body, self._rim = body, Rim(body, bounced(hidden))
        self._forces = [one.force for one in hidden if acts(one, "force")]
        self._torques = [one.torque for one in hidden if acts(one, "torque")]
        self._resistances = [one.resist for one in hidden if acts(one, "resist")]
        self._marble = Marble(*start.place_m, STEP_S, friction=base.rolling_friction)
        self._places = [start.place_m]

    @property
    def steps(self) -> int:
        """The number of steps so far."""
        return len(self._places) - 1

    def path(self) -> Array:
        """Return the marble's centre (steps + 1, 2) [m] so far."""
        return np.array(self._places)

    def go(self, tilts: Array) -> None:
        """Go on by as many steps as there are tilts (n, 2) [rad], which the board comes to in each."""
        marble = self._marble
        for tilt in tilts.tolist():
            if self._forces or self._torques or self._resistances:
                self._push(tilt)
            x, y, _ = place = self._body.step(tilt)
            self._places.append((x, y))
            if self._rim.acts:
                self._rim.apply(place)
            marble.way += math.hypot(marble.x - x, marble.y - y)
            marble.x, marble.y = x, y

    def _push(self, tilt: Sequence[float]) -> None:
        marble = self._marble
        (marble.vx, marble.vy, _), (spin_x, spin_y, spin_z) = self._body.velocity()
        marble.spin = spin_x, spin_y, spin_z
        marble.time = self.steps * STEP_S
        marble.pull_x, marble.pull_y, _ = gravity(tilt)
        pushed, turned = np.zeros(3), np.zeros(3)
        for force in self._forces:
            x, y = force(marble)
            marble.pull_x += x
            marble.pull_y += y
            pushed[:2] += (x, y)
        for torque in self._torques:
            turned += torque(marble)
        self._body.push(pushed, turned, math.prod(resistance(marble) for resistance in self._resistances))


def gravity(tilt: Sequence[float]) -> tuple[float, float, float]:
    """Return gravity [m/s^2] as a board sees it that is turned about x, then about its y [rad]."""
    x, y = tilt
    return (
        GRAVITY * math.cos(x) * math.sin(y),
        -GRAVITY * math.sin(x),
        -GRAVITY * math.cos(x) * math.cos(y),
    )


def bounced(hidden: Sequence[Physics]) -> float:
    """Return the restitution of the rim."""
    restitution = 0.0
    for one in hidden:
        restitution = one.bounce(restitution)
    return restitution


def heavy_side(hidden: Sequence[Physics]) -> Array:
    """Return the centre of mass at the release (3,) [m], relative to the marble's centre."""
    found: Array = RADIUS_M * np.sum([(0.0, 0.0, 0.0), *(one.heavy_side() for one in hidden)], axis=0)
    return found
