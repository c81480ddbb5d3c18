"""The inside of a labyrinth: inner walls, holes, the path between them; `[maze]` of `rig.toml`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt import arguments
from irt.dimensions import Board, Marble, check_number
from irt.errors import IrtError, located
from irt.files import TomlTable, read_toml

__all__ = ["Maze", "layouts", "read_maze"]

Array = NDArray[np.float64]
Point = tuple[float, float]
Wall = tuple[float, float, float, float]

_LAYOUTS = Path(__file__).parent / "data" / "layouts"
_LENGTHS = ("wall_thickness_m", "wall_height_m", "hole_radius_m")
#: Coordinates of a layout are rounded: so much further than the rim is still at the rim.
_ROUNDING = 1.0 + 1e-9
_KEYS = ("layout", "walls", "holes", "start", "path", *_LENGTHS)


@dataclass(frozen=True)
class Maze:
    """Inner walls, holes, and the path that leads between them; lengths in metres from the board's centre.

    Attributes
    ----------
    walls : tuple of (x0, y0, x1, y1)
        The middle lines of walls with rounded ends [m].
    holes : tuple of (x, y)
        Centres of the holes [m].
    start : (x, y) or None
        Where the marble begins [m].
    path : tuple of (x, y)
        The corners of the way from start to goal [m]; the last one is the goal.
    wall_thickness_m, wall_height_m : float
        Of every inner wall [m]. A marble does not pass over a wall, so the height counts for pictures and
        other simulators alone; it must reach up to the marble's centre.
    hole_radius_m : float
        Of every hole [m]; larger than the marble's.

    Raises
    ------
    IrtError
        If a value is none that a maze can have. What depends on board and marble is checked by `check`.
    """

    walls: tuple[Wall, ...] = ()
    holes: tuple[Point, ...] = ()
    start: Point | None = None
    path: tuple[Point, ...] = ()
    wall_thickness_m: float = 0.005
    wall_height_m: float = 0.012
    hole_radius_m: float = 0.0075

    def __post_init__(self) -> None:
        for name, width in (("walls", 4), ("holes", 2), ("path", 2)):
            object.__setattr__(self, name, _rows(name, getattr(self, name), width))
        if self.start is not None:
            object.__setattr__(self, "start", _rows("start", [self.start], 2)[0])
        if len(self.path) == 1:
            raise IrtError("path: expected at least two points, the start and the goal, got one")
        for name in _LENGTHS:
            check_number(name, getattr(self, name), 1e-6, 10.0, " m")

    @classmethod
    @arguments.entry
    def of_layout(cls, name: str) -> Maze:
        """Return a maze that is shipped with the package; `layouts` lists their names.

        Raises
        ------
        IrtError
            If no layout has this name.
        """
        name = arguments.word("layout", name, layouts())
        return _of_table(read_toml(_LAYOUTS / f"{name}.toml"))

    @property
    def is_bare(self) -> bool:
        """Whether there is neither wall nor hole, so that a marble rolls as on the bare board."""
        return not self.walls and not self.holes

    def arrays(self) -> tuple[Array, float, Array, float]:
        """Return what the engine takes: walls (n, 4), their thickness, holes (m, 2), their radius [m]."""
        walls, holes = np.reshape(self.walls, (-1, 4)), np.reshape(self.holes, (-1, 2))
        return walls.astype(np.float64), self.wall_thickness_m, holes.astype(np.float64), self.hole_radius_m

    def check(self, board: Board, marble: Marble) -> None:
        """Raise unless the maze fits on a board and lets a marble through.

        Raises
        ------
        IrtError
            For a wall or hole off the board, a hole that is smaller than the marble or overlaps a wall or
            another hole, walls below the marble's centre, a start or a path where no marble can be.
        """
        half = np.array([board.edge_x_m, board.edge_y_m]) / 2.0
        self._check_walls(half, marble)
        self._check_holes(half, marble)
        if self.start is not None:
            self._check_start(half, marble)
        for index, (a, b) in enumerate(zip(self.path, self.path[1:], strict=False), start=1):
            self._check_step(f"path: its step {index}, {_shown((*a, *b))},", np.array([a, b]), half)

    def _check_walls(self, half: Array, marble: Marble) -> None:
        for index, wall in enumerate(self.walls, start=1):
            if (np.abs(np.reshape(wall, (2, 2))) > half * _ROUNDING).any():
                raise IrtError(
                    f"walls: wall {index}, {_shown(wall)}, leaves the board, which reaches {_reach(half)}"
                )
        if self.walls and self.wall_height_m < marble.radius_m:
            raise IrtError(
                f"wall_height_m: {self.wall_height_m:g} is below the marble's centre, {marble.radius_m:g} m; "
                "a marble would climb such a wall, which is not simulated"
            )

    def _check_holes(self, half: Array, marble: Marble) -> None:
        if self.holes and self.hole_radius_m <= marble.radius_m:
            raise IrtError(
                f"hole_radius_m: {self.hole_radius_m:g} m is no more than the marble's radius, "
                f"{marble.radius_m:g} m; the marble would not fall through"
            )
        for index, hole in enumerate(self.holes, start=1):
            what = f"holes: hole {index} at {_shown(hole)}"
            if (np.abs(hole) + self.hole_radius_m > half * _ROUNDING).any():
                raise IrtError(f"{what} leaves the board, which reaches {_reach(half)}")
            if wall := self._wall_within(hole, self.hole_radius_m):
                raise IrtError(f"{what} overlaps {wall}; move one of them")
            for number, other in enumerate(self.holes[: index - 1], start=1):
                if math.dist(hole, other) < 2.0 * self.hole_radius_m:
                    raise IrtError(f"{what} overlaps hole {number}; move one of them")

    def _check_start(self, half: Array, marble: Marble) -> None:
        start = np.array(self.start)
        what = f"start: {_shown(start)}"
        if (np.abs(start) > half - marble.radius_m).any():
            raise IrtError(f"{what} is off the board for a marble of radius {marble.radius_m:g} m")
        if wall := self._wall_within(start, marble.radius_m):
            raise IrtError(f"{what} is no place for a marble of radius {marble.radius_m:g} m beside {wall}")
        if hole := self._hole_within(start[None]):
            raise IrtError(f"{what} lies over {hole}")

    def _check_step(self, what: str, step: Array, half: Array) -> None:
        if (np.abs(step) > half).any():
            raise IrtError(f"{what} leaves the board, which reaches {_reach(half)}")
        for index, wall in enumerate(self.walls, start=1):
            if _between(step, np.reshape(wall, (2, 2))) < self.wall_thickness_m / 2.0:
                raise IrtError(f"{what} leads through wall {index}, {_shown(wall)}")
        if hole := self._hole_within(step):
            raise IrtError(f"{what} leads over {hole}")

    def _wall_within(self, place: Sequence[float] | Array, radius: float) -> str:
        """Return the wall whose side is closer to a place than a radius, in words; empty where none is."""
        near = radius + self.wall_thickness_m / 2.0
        for index, wall in enumerate(self.walls, start=1):
            if _distance(np.reshape(wall, (2, 2)), place) < near:
                return f"wall {index}, {_shown(wall)}"
        return ""

    def _hole_within(self, line: Array) -> str:
        """Return the hole over which a line leads, in words; empty where none is."""
        for index, hole in enumerate(self.holes, start=1):
            if _distance(line, hole) < self.hole_radius_m:
                return f"hole {index} at {_shown(hole)}"
        return ""

    def lines(self) -> Iterator[str]:
        """Yield the lines of its TOML, so that `read_maze` returns the same numbers bit for bit."""
        for name in _LENGTHS:
            yield f"{name} = {float(getattr(self, name))!r}"
        if self.start is not None:
            yield f"start = {_toml(self.start)}"
        for name in ("walls", "holes", "path"):
            if rows := getattr(self, name):
                yield f"{name} = ["
                yield from (f"    {_toml(row)}," for row in rows)
                yield "]"


def layouts() -> tuple[str, ...]:
    """Return the names of the layouts that are shipped, the bare board first."""
    return tuple(sorted(path.stem for path in _LAYOUTS.glob("*.toml")))


def read_maze(table: TomlTable, board: Board, marble: Marble) -> Maze | None:
    """Return what the section ``[maze]`` says, checked against the board; None where there is none."""
    if "maze" not in table:
        return None
    section = table.section("maze")
    section.only("key", _KEYS)
    others = [key for key in section.content if key != "layout"]
    if "layout" in section and others:
        raise section.error("layout", f"a layout brings its own {others[0]}; give one or the other")
    with located(section.where):
        maze = Maze.of_layout(section.word("layout")) if "layout" in section else _of_table(section)
        maze.check(board, marble)
    return maze


def _of_table(table: TomlTable) -> Maze:
    given: dict[str, Any] = dict(table.numbers(*_LENGTHS))
    given |= {key: table.content[key] for key in ("walls", "holes", "start", "path") if key in table}
    with located(table.where):
        return Maze(**given)


def _rows(name: str, given: Any, width: int) -> tuple[Any, ...]:
    """Return rows of so many finite numbers."""
    form = "[" + ", ".join(["x", "y"] if width == 2 else ["x0", "y0", "x1", "y1"]) + "]"
    if isinstance(given, str | bytes) or not isinstance(given, Sequence | np.ndarray):
        raise IrtError(f"{name}: expected a list of {form}, got {arguments.shown(given)}")
    rows = []
    for index, row in enumerate(given, start=1):
        what = name if name == "start" else f"{name}: number {index}"
        numbers = row if isinstance(row, Sequence | np.ndarray) and not isinstance(row, str | bytes) else ()
        right = all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers)
        if len(numbers) != width or not right:
            raise IrtError(f"{what}: expected {form} in metres, got {arguments.shown(row)}")
        floats = tuple(arguments.number(what, number) for number in numbers)
        if not all(map(math.isfinite, floats)):
            raise IrtError(f"{what}: expected finite numbers, got {arguments.shown(row)}")
        rows.append(floats)
    return tuple(rows)


def _distance(line: Array, place: Sequence[float] | Array) -> float:
    """Return the distance of a place from a line, (2, 2) its ends; of a point (1, 2) from that."""
    (x0, y0), (x1, y1) = line[0].tolist(), line[-1].tolist()
    x, y = place
    square = (x1 - x0) ** 2 + (y1 - y0) ** 2
    part = 0.0
    if square > 0.0:
        part = min(max(((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / square, 0.0), 1.0)
    return math.hypot(x - x0 - part * (x1 - x0), y - y0 - part * (y1 - y0))


def _between(a: Array, b: Array) -> float:
    """Return the distance between two lines, each (2, 2) its ends; 0 where they cross."""

    def sides(line: Array, ends: Array) -> float:
        """Return a negative number where the ends lie on different sides of the line."""
        (ux, uy), (px, py), (qx, qy) = line[1] - line[0], ends[0] - line[0], ends[1] - line[0]
        return float((ux * py - uy * px) * (ux * qy - uy * qx))

    if sides(a, b) < 0.0 and sides(b, a) < 0.0:
        return 0.0
    return min(_distance(a, b[0]), _distance(a, b[1]), _distance(b, a[0]), _distance(b, a[1]))


def _shown(numbers: Sequence[float] | Array) -> str:
    return "[" + ", ".join(f"{number:g}" for number in numbers) + "]"


def _reach(half: Array) -> str:
    return f"{half[0]:g} m from its centre along x and {half[1]:g} m along y"


def _toml(numbers: Sequence[float]) -> str:
    return "[" + ", ".join(repr(float(number)) for number in numbers) + "]"
