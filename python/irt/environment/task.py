"""What a marble is to do: follow a path through a maze, and what it is paid for it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import cast

import numpy as np
from numpy.typing import NDArray

from irt import arguments
from irt.engine import Array
from irt.errors import IrtError
from irt.maze import Maze

#: Distance of the points by which progress along a path is measured [m].
SPACING_M = 0.001
#: Points ahead that a learner sees, and how far they are from each other [m].
AHEAD, AHEAD_M = 5, 0.02
#: How near to the end of its path a marble has arrived [m].
ARRIVED_M = 0.008


@dataclass(frozen=True)
class Reward:
    """What is paid for what.

    Attributes
    ----------
    progress : float
        For the whole path, in proportion to the part that a step adds; going back costs as much.
    hole, goal : float
        Once, for a fall and for arriving.
    time : float
        For each step.
    """

    progress: float = 10.0
    hole: float = -1.0
    goal: float = 5.0
    time: float = -0.002

    def __post_init__(self) -> None:
        for one in fields(self):
            arguments.number(one.name, getattr(self, one.name))


@dataclass(frozen=True, eq=False)
class Task:
    """A maze and the path through it, in points.

    Attributes
    ----------
    maze : Maze
        Walls, holes, start and path.
    points : (p, 2) array
        The path [m], a point every millimetre; the last one is the goal.
    """

    maze: Maze
    points: Array

    @classmethod
    def of(cls, maze: Maze | str) -> Task:
        """Return the task of a maze, or of a layout by its name.

        Raises
        ------
        IrtError
            If no layout has the name, or the maze has no path.
        """
        if isinstance(maze, str):
            maze = Maze.of_layout(maze)
        arguments.instance("maze", maze, Maze)
        if not maze.path:
            raise IrtError("maze: it has no path to follow; add path = [[x, y], ...] to [maze]")
        corners = np.array(maze.path)
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        places = np.linspace(0.0, along[-1], max(2, round(along[-1] / SPACING_M) + 1))
        points = np.stack([np.interp(places, along, corners[:, axis]) for axis in range(2)], axis=1)
        return cls(maze, points)

    @property
    def start(self) -> Array:
        """Where marbles begin [m], (2,)."""
        return self.points[0] if self.maze.start is None else np.array(self.maze.start)

    def ahead(self, passed: NDArray[np.int64]) -> Array:
        """Return the points ahead of those that are passed [m], (n, 5, 2); at the end the goal."""
        steps = round(AHEAD_M / SPACING_M) * np.arange(1, AHEAD + 1)
        return cast(Array, self.points[np.minimum(passed[:, None] + steps, len(self.points) - 1)])

    def share(self, passed: NDArray[np.int64]) -> Array:
        """Return the share of the path that is passed, (n,)."""
        return np.asarray(passed / (len(self.points) - 1))

    def arrived(self, passed: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which marbles are at the end, (n,)."""
        return np.asarray(passed >= len(self.points) - 1 - round(ARRIVED_M / SPACING_M))
