"""The board from above: a picture of the maze, and the marble in it."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from irt.engine import Array
from irt.environment.task import Task
from irt.model import Model

#: Pixels to a metre, and samples of a pixel along each axis.
PER_M, SAMPLES = 1000.0, 3
WOOD, WALL, HOLE, PATH, GOAL, STEEL = (
    np.array(one, dtype=np.float64)
    for one in (
        (206, 169, 120),
        (110, 74, 44),
        (24, 20, 18),
        (176, 138, 92),
        (70, 130, 80),
        (190, 196, 204),
    )
)


def picture(scene: Array, radius_m: float, place: Array) -> NDArray[np.uint8]:
    """Return a board (h, w, 3) with a marble at a place [m]."""
    height, width = scene.shape[:2]
    half = np.array([width, height]) / 2.0 / PER_M
    if np.isfinite(place).all():
        x, y = _grid(width, height, half)
        inside = (np.hypot(x - place[0], y - place[1]) < radius_m).mean(axis=(1, 3))
        scene = scene + inside[..., None] * (STEEL - scene)
    return np.asarray(np.round(scene), dtype=np.uint8)


def board(task: Task, model: Model) -> Array:
    """Return a board without its marble, (h, w, 3) from 0 to 255: a pixel a millimetre, y upwards."""
    width, height = (max(1, round(PER_M * edge)) for edge in (model.board.edge_x_m, model.board.edge_y_m))
    half = np.array([width, height]) / 2.0 / PER_M
    x, y = _grid(width, height, half)
    scene = np.tile(WOOD, (height, width, 1))
    maze = task.maze

    def cover(inside: NDArray[np.bool_], colour: Array) -> None:
        nonlocal scene
        scene = scene + inside.mean(axis=(1, 3))[..., None] * (colour - scene)

    cover(_along(x, y, task.points[:: max(1, len(task.points) // 400)]) < _LINE_M, PATH)
    cover(np.hypot(x - task.points[-1, 0], y - task.points[-1, 1]) < _GOAL_M, GOAL)
    for hole in maze.holes:
        cover(np.hypot(x - hole[0], y - hole[1]) < maze.hole_radius_m, HOLE)
    for x0, y0, x1, y1 in maze.walls:
        cover(_from_line(x, y, (x0, y0), (x1, y1)) < maze.wall_thickness_m / 2.0, WALL)
    return scene


#: Half the width of the line of the path, and the goal's radius [m].
_LINE_M, _GOAL_M = 0.001, 0.006


def _grid(width: int, height: int, half: Array) -> tuple[Array, Array]:
    """Return the places of the samples of all pixels [m], (height, samples, width, samples)."""
    x = (np.arange(width * SAMPLES) + 0.5) / SAMPLES / PER_M - half[0]
    y = half[1] - (np.arange(height * SAMPLES) + 0.5) / SAMPLES / PER_M
    shape = (height, SAMPLES, width, SAMPLES)
    across, up = np.meshgrid(x, y)
    return across.reshape(shape), up.reshape(shape)


def _along(x: Array, y: Array, points: Array) -> Array:
    distance = np.full(x.shape, np.inf)
    for a, b in itertools.pairwise(points):
        near = (np.abs(x - (a[0] + b[0]) / 2.0) < 0.01) & (np.abs(y - (a[1] + b[1]) / 2.0) < 0.01)
        distance[near] = np.minimum(distance[near], _from_line(x[near], y[near], a, b))
    return distance


def _from_line(
    x: Array, y: Array, begin: Array | tuple[float, float], end: Array | tuple[float, float]
) -> Array:
    """Return the distance of places from a line between two points [m]."""
    along = np.subtract(end, begin)
    square = float(along @ along)
    part = (
        ((x - begin[0]) * along[0] + (y - begin[1]) * along[1]) / square if square > 0.0 else np.zeros_like(x)
    )
    part = np.clip(part, 0.0, 1.0)
    return np.asarray(np.hypot(x - begin[0] - part * along[0], y - begin[1] - part * along[1]))
