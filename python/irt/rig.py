"""One rig: what is measured with a ruler and a scale, what is searched for, and the recordings beside it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from irt import arguments
from irt.dimensions import TILT_OFFSET_RAD, Board, Commands, Marble, TiltSensor, check_number, check_room
from irt.errors import IrtError, located, unknown_name
from irt.files import PathLike, TomlTable, read_toml
from irt.maze import Maze, read_maze
from irt.recording import CMD, Recording, as_recording, load_recording

__all__ = [
    "MOST_ROWS",
    "PARAMETERS",
    "RANGES",
    "Board",
    "Commands",
    "Marble",
    "Rig",
    "Start",
    "TiltSensor",
    "as_recordings",
    "as_rig",
    "check_range",
    "check_value",
    "load_rig",
    "read_dimensions",
    "read_signals",
    "read_start",
]

#: The tuned parameters, in the order in which arrays hold them (paper, section 5.2).
PARAMETERS = ("gear_x", "gear_y", "rolling_friction", "time_scale", "observation_scale")
#: The paper's ranges (section 5.2).
RANGES = {
    "gear_x": (0.0, 0.1),
    "gear_y": (0.0, 0.1),
    "rolling_friction": (0.0, 0.001),
    "time_scale": (0.0, 50.0),
    "observation_scale": (0.8, 1.2),
}
Start = Literal["rest", "moving"]

#: Rows of all recordings that a fit takes: a minute or two of a processor's time, and at 30 rows a second
#: more than five minutes of motion. Errors of parameters fall with the root of the rows; beyond these, what a
#: model lacks counts for more.
MOST_ROWS = 10_000

#: Tilt at which a labyrinth's board meets its stops [rad]: 8 degrees.
STOPS_RAD = 0.14
#: Largest angle of the knob in recordings for which the catalogue's ranges are made [rad]. A command in
#: another unit counts as this angle if the largest gear brings the board to its stops by it.
KNOB_RAD = 0.2

#: Lowest and highest value that a parameter may have at all, far beyond any rig.
_BOUNDS = {
    "gear_x": (-100.0, 100.0),
    "gear_y": (-100.0, 100.0),
    "rolling_friction": (0.0, 100.0),
    "time_scale": (0.0, 5000.0),
    "observation_scale": (0.01, 100.0),
}


@dataclass(frozen=True, eq=False)
class Rig:
    """Recordings of one rig, and what is known of it: from a folder (`load_rig`), or `from_recordings`.

    Attributes
    ----------
    path : Path
        The folder; without one the rig's name.
    board, marble : Board, Marble
        What was measured directly.
    start : {"rest", "moving"}
        Whether the marble rests on a level board before row 0 of each recording.
    ranges : dict
        Lowest and highest value to search, for each of `PARAMETERS`.
    recordings : tuple of Recording
        By name, ``run-2`` before ``run-10``; at least one.
    commands : Commands
        What the commands are.
    tilt : TiltSensor
        What is known of the measured tilt, where recordings have one.
    maze : Maze or None
        Inner walls and holes; None on a bare board.

    Raises
    ------
    IrtError
        If a field is of another type, a range is missing or none, or recordings differ in their commands.
    """

    path: Path
    board: Board
    marble: Marble
    start: Start
    ranges: dict[str, tuple[float, float]]
    recordings: tuple[Recording, ...]
    commands: Commands = field(default_factory=Commands)
    tilt: TiltSensor = field(default_factory=TiltSensor)
    maze: Maze | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", arguments.path("path", self.path))
        for name, kind in (
            ("board", Board),
            ("marble", Marble),
            ("commands", Commands),
            ("tilt", TiltSensor),
        ):
            arguments.instance(name, getattr(self, name), kind)
        arguments.word("start", self.start, get_args(Start))
        object.__setattr__(self, "ranges", _checked_ranges(self.ranges))
        recordings = arguments.listed("recordings", self.recordings, Recording)
        object.__setattr__(self, "recordings", recordings)
        check_room(self.board, self.marble)
        if self.maze is not None:
            arguments.instance("maze", self.maze, Maze).check(self.board, self.marble)
        if recordings:
            _check_columns(recordings, self.path, self.commands)

    @classmethod
    @arguments.entry
    def from_recordings(
        cls,
        recordings: Sequence[Any],
        *,
        board: Board | None = None,
        marble: Marble | None = None,
        start: Start = "rest",
        ranges: Mapping[str, tuple[float, float]] | None = None,
        commands: Commands | None = None,
        tilt: TiltSensor | None = None,
        maze: Maze | None = None,
        name: str = "rig",
    ) -> Rig:
        """Return a rig of recordings in memory; the default is the paper's labyrinth.

        Parameters
        ----------
        recordings : sequence of Recording, path or table
            At least one; tables are data frames or mappings with the columns of a recording's file. Of
            recordings with the same name each gets a number.
        board, marble, start, commands, tilt, maze : optional
            As in `Rig`.
        ranges : mapping, optional
            Of the parameters that are not searched over the paper's ranges.
        name : str
            What the rig is called.

        Raises
        ------
        IrtError
            If the recordings are none, or do not belong together.
        """
        if isinstance(recordings, str | bytes | Mapping) or not isinstance(recordings, Sequence):
            raise IrtError(
                f"recordings: expected a sequence of recordings or tables, got {arguments.shown(recordings)}"
            )
        if not recordings:
            raise IrtError("recordings: expected at least one, got none")
        given: Any = {} if ranges is None else ranges
        runs = _with_own_names([as_recording(one) for one in recordings])
        return cls(
            path=Path(arguments.text("name", name)),
            board=Board() if board is None else board,
            marble=Marble() if marble is None else marble,
            start=start,
            ranges={**default_ranges(runs), **arguments.mapping("ranges", given)},
            recordings=runs,
            commands=Commands() if commands is None else commands,
            tilt=TiltSensor() if tilt is None else tilt,
            maze=maze,
        )

    @property
    def has_tilt(self) -> bool:
        """Whether the board's tilt was measured in any recording."""
        return any(recording.has_tilt for recording in self.recordings)

    def of_marbles(self, *, with_tilt: bool = False) -> Rig:
        """Return the rig of the recordings with a marble, by default without the tilt.

        Raises
        ------
        IrtError
            If no recording has a marble.
        """
        kept = tuple(
            one if one.tilt is None or with_tilt else replace(one, tilt=None)
            for one in self.recordings
            if one.has_marble
        )
        if kept == self.recordings:
            return self
        if not kept:
            raise IrtError(
                f"{self.path}: no recording has a marble, which this needs; 'irt tune' fits the tilt alone"
            )
        return replace(self, recordings=kept)

    def on_bare_board(self) -> Rig:
        """Return this rig if it has neither inner walls nor holes: fits know the bare board alone.

        Raises
        ------
        IrtError
            If it has.
        """
        if self.maze is None or self.maze.is_bare:
            return self
        raise IrtError(
            f"{self.path}: its [maze] has walls or holes, and fits know the bare board alone; fit recordings "
            "in which the marble meets neither, without [maze], and put [maze] into the model.toml found"
        )

    @property
    def rows(self) -> int:
        """Rows of all recordings."""
        return sum(len(one.knobs) for one in self.recordings)

    def first_rows(self, count: int) -> Rig:
        """Return the rig of the first rows of its recordings, at most so many in all.

        Recordings that are shorter than their share stay whole.

        Raises
        ------
        IrtError
            If the count is less than two rows for each recording.
        """
        arguments.whole("count", count, 2 * len(self.recordings))
        if self.rows <= count:
            return self
        lengths = sorted(len(one.knobs) for one in self.recordings)
        share, left = 0, count
        for index, length in enumerate(lengths):
            share = left // (len(lengths) - index)
            if length > share:
                break
            left, share = left - length, length
        kept = tuple(one.cut(share) if len(one.knobs) > share else one for one in self.recordings)
        return replace(self, recordings=kept)

    @cached_property
    def digest(self) -> str:
        """Hash (SHA-256) of all that is read from the folder, names of recordings included."""
        known: tuple[object, ...] = (self.board, self.marble, self.start, sorted(self.ranges.items()))
        # What a rig of the paper's kind does not say leaves the hash as it was before it could be said.
        known += tuple(one for one in (self.commands, self.tilt) if one not in (Commands(), TiltSensor()))
        known += () if self.maze is None else (self.maze,)
        sha = hashlib.sha256(repr(known).encode())
        for one in self.recordings:
            measured = () if one.tilt is None else (one.tilt,)
            for array in (one.knobs, one.marble, one.stamps, *measured):
                values = np.zeros(0) if array is None else array
                sha.update(f"{one.name} {values.shape}".encode() + values.astype("<f8").tobytes())
        return sha.hexdigest()


def load_rig(folder: PathLike) -> Rig:
    """Read a rig: ``rig.toml``, where it is absent the paper's labyrinth, and every ``*.csv`` beside it.

    Raises
    ------
    IrtError
        If the folder holds no recording, or a file in it is not as it must be.
    """
    folder = arguments.path("rig", folder)
    if not folder.is_dir():
        if not folder.exists():
            raise IrtError(f"{folder}: no such folder; give a folder with recordings (*.csv)")
        raise IrtError(
            f"{folder}: a rig is a folder, and this is a file; give a folder with recordings (*.csv), which "
            "`irt import` makes of a log"
        )
    settings = folder / "rig.toml"
    table = read_toml(settings) if settings.exists() else TomlTable(f"{settings}", {})
    table.only("section", ("board", "marble", "recordings", "commands", "tilt", "parameters", "maze"))
    board, marble = read_dimensions(table)
    maze = read_maze(table, board, marble)
    commands, tilt = read_signals(table)
    # Hidden files are no recordings: half-written ones and what some systems leave beside a copy.
    files = folder.glob("*.[cC][sS][vV]")
    paths = [path for path in files if not path.name.startswith(".") and not path.is_dir()]
    if not paths:
        raise IrtError(f"{folder}: the rig holds no recording; put at least one *.csv into this folder")
    recordings = tuple(load_recording(path) for path in sorted(paths, key=_natural))
    return Rig(
        path=folder,
        board=board,
        marble=marble,
        start=read_start(table),
        ranges=default_ranges(recordings) | _read_ranges(table.section("parameters")),
        recordings=recordings,
        commands=commands,
        tilt=tilt,
        maze=maze,
    )


def as_rig(value: Rig | PathLike) -> Rig:
    """Return a rig, or the one in the folder named.

    Raises
    ------
    IrtError
        If it is neither, or the folder is no rig.
    """
    if isinstance(value, Rig):
        if not value.recordings:
            raise IrtError(f"{value.path}: the rig holds no recording")
        return value
    if isinstance(value, str | Path):
        return load_rig(value)
    raise IrtError(
        f"rig: expected irt.Rig or the path of its folder, got {arguments.shown(value)}; "
        "irt.Rig.from_recordings([...]) makes a rig of recordings and data frames"
    )


def as_recordings(value: Any) -> tuple[Recording, ...]:
    """Return the recordings of a rig or its folder, or those of a sequence (see `Rig.from_recordings`).

    Raises
    ------
    IrtError
        If there is none.
    """
    if isinstance(value, Rig | str | Path):
        return as_rig(value).recordings
    if isinstance(value, Recording) or not isinstance(value, Sequence) or isinstance(value, bytes):
        raise IrtError(
            "recordings: expected a sequence of recordings, a rig or the path of its folder, got "
            f"{arguments.shown(value)}"
        )
    if not value:
        raise IrtError("recordings: expected at least one, got none")
    return _with_own_names([as_recording(one) for one in value])


def _with_own_names(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return recordings of which those with one name are numbered: run-1, run-2."""
    names = [one.name for one in recordings]
    return tuple(
        replace(one, name=f"{one.name}-{names[: index + 1].count(one.name)}")
        if names.count(one.name) > 1
        else one
        for index, one in enumerate(recordings)
    )


def _check_columns(recordings: tuple[Recording, ...], path: Path, commands: Commands) -> None:
    """Raise unless all recordings have the same kind of commands, and the rig names the unit of its own."""
    first = recordings[0]
    for one in recordings:
        if one.columns != first.columns:
            raise IrtError(
                f"{one.path}: its commands are {', '.join(one.columns)}, those of {first.path.name} "
                f"{', '.join(first.columns)}; all recordings of a rig need the same"
            )
    if first.columns == CMD and commands.unit == "rad":
        raise IrtError(
            f"{path / 'rig.toml'}: recordings have {', '.join(CMD)}, commands in the rig's own unit; name "
            'it: [commands] unit = "mA", say; or call the columns knob_x_rad, knob_y_rad if they are radians'
        )


def read_signals(table: TomlTable) -> tuple[Commands, TiltSensor]:
    """Return what the sections ``[commands]`` and ``[tilt]`` say, the defaults where they say nothing."""
    section = table.section("commands")
    section.only("key", ("unit", "matrix"))
    unit = section.word("unit") if "unit" in section else "rad"
    matrix = section.flag("matrix") if "matrix" in section else False
    section = table.section("tilt")
    section.only("key", ("noise_rad", "offset"))
    offset = TILT_OFFSET_RAD
    if "offset" in section:
        inner = section.inline("offset", "{ range = [low, high] }")
        inner.only("key", ("range",))
        offset = inner.pair("range")
    with located(section.where):
        return Commands(unit, matrix), TiltSensor(section.numbers("noise_rad").get("noise_rad"), offset)


def read_dimensions(table: TomlTable) -> tuple[Board, Marble]:
    """Return what the sections ``[board]`` and ``[marble]`` say, the defaults where they say nothing."""
    board_table, marble_table = table.section("board"), table.section("marble")
    board_keys, marble_keys = tuple(Board.__annotations__), tuple(Marble.__annotations__)
    board_table.only("key", board_keys)
    marble_table.only("key", marble_keys)
    with located(board_table.where):
        board = Board(**board_table.numbers(*board_keys))
    with located(marble_table.where):
        marble = Marble(**marble_table.numbers(*marble_keys))
        check_room(board, marble)
    return board, marble


def read_start(table: TomlTable) -> Start:
    """Return what ``[recordings] start`` says, ``"rest"`` where it says nothing."""
    section = table.section("recordings")
    section.only("key", ("start",))
    if "start" not in section:
        return "rest"
    word = section.word("start")
    for start in get_args(Start):
        if word == start:
            return start  # type: ignore[no-any-return]
    raise section.error("start", str(unknown_name("start", word, get_args(Start))))


def check_range(name: str, low: float, high: float) -> None:
    """Raise `IrtError` unless the range of the parameter ``name`` runs upwards, between possible values."""
    arguments.upwards(name, low, high)
    check_value(name, low)
    check_value(name, high)


def _checked_ranges(ranges: object) -> dict[str, tuple[float, float]]:
    """Return the range of each of `PARAMETERS`, in this order.

    Raises
    ------
    IrtError
        If one is missing, unknown or none.
    """
    given = arguments.mapping("ranges", ranges)
    for name in given:
        if name not in PARAMETERS:
            raise unknown_name("parameter", str(name), PARAMETERS)
    missing = [name for name in PARAMETERS if name not in given]
    if missing:
        raise IrtError(
            f"ranges: {', '.join(missing)} missing; all of {', '.join(PARAMETERS)} are needed "
            "(irt.Rig.from_recordings fills in the paper's)"
        )
    found = {name: arguments.pair(name, given[name]) for name in PARAMETERS}
    for name, (low, high) in found.items():
        check_range(name, low, high)
    return found


def check_value(name: str, value: float) -> None:
    """Raise `IrtError` unless the parameter ``name`` exists and may have this value."""
    if name not in _BOUNDS:
        raise unknown_name("parameter", name, PARAMETERS)
    low, high = _BOUNDS[name]
    check_number(name, value, low, high)


def _read_ranges(section: TomlTable) -> dict[str, tuple[float, float]]:
    """Return the ranges that ``[parameters]`` gives."""
    section.only("parameter", PARAMETERS)
    ranges = {}
    for name in section.content:
        table = section.inline(name, "{ range = [low, high] }")
        table.only("key", ("range",))
        ranges[name] = table.pair("range")
        with located(section.where):
            check_range(name, *ranges[name])
    return ranges


def default_ranges(recordings: Sequence[Recording]) -> dict[str, tuple[float, float]]:
    """Return the paper's ranges; for commands in the rig's own unit gears of either sign, up to the stops.

    Rolling friction then has as large a range, compared with the largest tilt, as for knob angles.
    """
    ranges = dict(RANGES)
    if recordings[0].columns == CMD:
        largest = max(float(np.abs(one.knobs).max()) for one in recordings)
        # Of commands that hardly move, any gear that a parameter may have.
        _, highest = _BOUNDS["gear_x"]
        steepest = min(STOPS_RAD / largest, highest) if largest > 0.0 else highest
        ranges["gear_x"] = ranges["gear_y"] = (-steepest, steepest)
        low, high = RANGES["rolling_friction"]
        ranges["rolling_friction"] = (low, high * STOPS_RAD / (RANGES["gear_x"][1] * KNOB_RAD))
    return ranges


def _natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a key that sorts numbers in a name by value: run-2 before run-10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name
