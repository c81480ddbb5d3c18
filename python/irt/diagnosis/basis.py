"""Basis functions of learned corrections: the engine's profiles, and grids of them over each variable."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Shapes in the order of the engine's codes: functions of a phase s; spots and saddles have two phases.
SHAPES = ("wave", "step", "bell", "ridge", "spot", "line", "bowl", "saddle")
#: Shapes with a width, tried across lines: tanh s, exp(-s^2/2), and its derivative.
LOCAL = ("step", "bell", "ridge")
#: Shapes without a width: s and s^2.
POLYNOMIALS = ("line", "bowl")
#: Shapes with a second phase, perpendicular to the first.
ROUND = ("spot", "saddle")
#: Shapes bounded by one.
BOUNDED = ("wave", *LOCAL, "spot")
#: Number of directions of lines, and widths as shares of the observed span of a variable.
DIRECTIONS = 12
WIDTHS = (0.025, 0.05, 0.1, 0.2)
#: Number of zeros of polynomials over the observed span.
OFFSETS = 9
#: Radii of spots, as shares of the longer side of the visited region.
RADII = (0.07, 0.1, 0.15, 0.22)


@dataclass(frozen=True, eq=False)
class Grid:
    """Profiles of one shape over one variable.

    Attributes
    ----------
    variable, shape : str
        Names of the variable and of the shape.
    vectors : (k, c) array
        Phase per unit of each of the c components of the variable.
    phases, across : (k,) arrays
        Offset of the phase, and of the second phase of spots and saddles [rad].
    """

    variable: str
    shape: str
    vectors: Array
    phases: Array
    across: Array

    def of(self, values: Array) -> Array:
        """Return the profiles, (n, k), at (n, c) values of the variable."""
        phases = values @ self.vectors.T + self.phases
        if self.shape not in ROUND:
            return shaped(self.shape, phases)
        turned = np.column_stack([-self.vectors[:, 1], self.vectors[:, 0]])
        return shaped(self.shape, phases, values @ turned.T + self.across)


def shaped(shape: str, phase: Array, across: Array | float = 0.0) -> Array:
    """Return the profile at these phases, as in the engine."""
    if shape == "wave":
        return np.cos(phase)
    if shape in POLYNOMIALS:
        return phase if shape == "line" else phase**2
    if shape == "step":
        return np.tanh(phase)
    if shape == "saddle":
        return np.asarray(phase * across)
    if shape == "spot":
        return np.asarray(np.exp(-0.5 * (phase**2 + across**2)))
    bell = np.exp(-0.5 * phase**2)
    return bell if shape == "bell" else np.asarray(-phase * bell * np.exp(0.5))


def lines(variable: str, values: Array, shapes: Sequence[str]) -> Iterator[Grid]:
    """Yield profiles across lines over (n, c) values, in all directions and widths.

    The phase is zero on the line. Lines cover the observed span from end to end.
    """
    if values.shape[1] == 1:
        directions = np.ones((1, 1))
    else:
        angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
        # The observed spans of x and y may differ.
        directions = np.column_stack([np.cos(angles), np.sin(angles)]) / np.ptp(values, axis=0)
    for shape in shapes:
        widths = [(1.0, OFFSETS)] if shape in POLYNOMIALS else [(one, round(1.0 / one) + 1) for one in WIDTHS]
        vectors, phases = [], []
        for direction, (width, count) in itertools.product(directions, widths):
            along = values @ direction
            span = float(np.ptp(along))
            places = along.min() + span * np.linspace(0.0, 1.0, count)
            vectors += [direction / (width * span)] * count
            phases += (-places / (width * span)).tolist()
        yield Grid(variable, shape, np.array(vectors), np.array(phases), np.zeros(len(phases)))


def spots(places: Array) -> Iterator[Grid]:
    """Yield spots of each radius, with centres a radius apart, over the region of (n, 2) positions."""
    low, high = places.min(axis=0), places.max(axis=0)
    for share in RADII:
        radius = share * float((high - low).max())
        axes = [np.arange(a, b + radius, radius) for a, b in zip(low, high, strict=True)]
        centres = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        near = np.linalg.norm(places[:, None] - centres, axis=-1) < radius
        # Centres that the marble never came near are dropped.
        centres = centres[near.any(axis=0)] / radius
        vectors = np.tile([1.0 / radius, 0.0], (len(centres), 1))
        yield Grid("position", "spot", vectors, -centres[:, 0], -centres[:, 1])


def saddles(variable: str, values: Array) -> Grid:
    """Return saddles over (n, 2) values in all directions, centred at zero."""
    angles = np.arange(DIRECTIONS) * 0.5 * np.pi / DIRECTIONS
    vectors = np.column_stack([np.cos(angles), np.sin(angles)]) / np.abs(values).max()
    return Grid(variable, "saddle", vectors, np.zeros(DIRECTIONS), np.zeros(DIRECTIONS))


def waves(variable: str, vectors: Array, phase: float = 0.0) -> Grid:
    """Return waves with a common phase."""
    return Grid(variable, "wave", vectors, np.full(len(vectors), phase), np.zeros(len(vectors)))


def half_plane(steps: Array, reach: int) -> Array:
    """Return a grid of vectors (k, 2) up to `reach` steps long, one of each two opposite vectors."""
    grid = np.array([(x, y) for x in range(reach + 1) for y in range(-reach, reach + 1) if (x, y) > (0, 0)])
    return np.asarray(grid[np.linalg.norm(grid, axis=1) <= reach] * steps)
