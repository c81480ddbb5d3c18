"""Shapes that a push or a drag may have over something: the engine's profiles, and grids of them to try."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: The engine's codes of the shapes: each is a function of a phase s, a spot of two.
SHAPES = ("wave", "step", "bell", "ridge", "spot", "line", "bowl", "saddle")
#: Those of a width, tried across lines: tanh s, exp(-s^2/2), and its slope.
LOCAL = ("step", "bell", "ridge")
#: Those without: s and s^2.
POLYNOMIALS = ("line", "bowl")
#: Those of two phases, the second one across.
ROUND = ("spot", "saddle")
#: Those that are never more than one.
BOUNDED = ("wave", *LOCAL, "spot")
#: Directions of lines, and widths as shares of what was seen of a variable.
DIRECTIONS = 12
WIDTHS = (0.025, 0.05, 0.1, 0.2)
#: Places from end to end at which polynomials are zero.
OFFSETS = 9
#: Radii of spots as shares of the longer side of where the marble was.
RADII = (0.07, 0.1, 0.15, 0.22)


@dataclass(frozen=True, eq=False)
class Grid:
    """Profiles of one shape over one variable.

    Attributes
    ----------
    variable, shape : str
        Which.
    vectors : (k, c) array
        By which the c values of the variable are multiplied.
    phases, across : (k,) arrays
        What is added, and for spots in the direction across.
    """

    variable: str
    shape: str
    vectors: Array
    phases: Array
    across: Array

    def of(self, values: Array) -> Array:
        """Return the profiles where the variable has (n, c) values, (n, k)."""
        phases = values @ self.vectors.T + self.phases
        if self.shape not in ROUND:
            return shaped(self.shape, phases)
        turned = np.column_stack([-self.vectors[:, 1], self.vectors[:, 0]])
        return shaped(self.shape, phases, values @ turned.T + self.across)


def shaped(shape: str, phase: Array, across: Array | float = 0.0) -> Array:
    """Return the profile at these phases, as the engine has it."""
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
    """Yield profiles across lines through (n, c) values, of all directions and of all their widths.

    A line lies where the phase is zero; both ends of what was seen have some.
    """
    if values.shape[1] == 1:
        directions = np.ones((1, 1))
    else:
        angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
        # Along x and along y there may have been seen more or less.
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
    """Yield spots of each radius, with centres a radius apart, over where (n, 2) places are."""
    low, high = places.min(axis=0), places.max(axis=0)
    for share in RADII:
        radius = share * float((high - low).max())
        axes = [np.arange(a, b + radius, radius) for a, b in zip(low, high, strict=True)]
        centres = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        near = np.linalg.norm(places[:, None] - centres, axis=-1) < radius
        # Where the marble never was nothing can be said.
        centres = centres[near.any(axis=0)] / radius
        vectors = np.tile([1.0 / radius, 0.0], (len(centres), 1))
        yield Grid("position", "spot", vectors, -centres[:, 0], -centres[:, 1])


def saddles(variable: str, values: Array) -> Grid:
    """Return saddles over (n, 2) values, of all directions, level where they are zero."""
    angles = np.arange(DIRECTIONS) * 0.5 * np.pi / DIRECTIONS
    vectors = np.column_stack([np.cos(angles), np.sin(angles)]) / np.abs(values).max()
    return Grid(variable, "saddle", vectors, np.zeros(DIRECTIONS), np.zeros(DIRECTIONS))


def waves(variable: str, vectors: Array, phase: float = 0.0) -> Grid:
    """Return waves of one phase."""
    return Grid(variable, "wave", vectors, np.full(len(vectors), phase), np.zeros(len(vectors)))


def half_plane(steps: Array, reach: int) -> Array:
    """Return a grid of vectors (k, 2), of each two opposite ones one, no longer than so many steps."""
    grid = np.array([(x, y) for x in range(reach + 1) for y in range(-reach, reach + 1) if (x, y) > (0, 0)])
    return np.asarray(grid[np.linalg.norm(grid, axis=1) <= reach] * steps)
