"""One rig: what is measured with a ruler and a scale, what is searched for, and the recordings beside it."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from irt.errors import IrtError, located, unknown_name
from irt.files import PathLike, TomlTable, read_toml
from irt.recording import CMD, Recording, load_recording

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

#: Lowest and highest value that a parameter may have at all, far beyond any rig.
_BOUNDS = {
    "gear_x": (-100.0, 100.0),
    "gear_y": (-100.0, 100.0),
    "rolling_friction": (0.0, 100.0),
    "time_scale": (0.0, 5000.0),
    "observation_scale": (0.01, 100.0),
}

#: Where the zero of a measured tilt is looked for [rad]: real rigs were 20 to 50 mrad off.
_TILT_OFFSET_RAD = (-0.06, 0.06)

#: Least that a length [m] or a mass [kg] can be: below, divisions by it overflow.
_TINY = 1e-9


@dataclass(frozen=True)
class Board:
    """The board and its rim walls; the defaults are the paper's BRIO labyrinth.

    Attributes
    ----------
    edge_x_m, edge_y_m : float
        Edges [m]; positions are told in units of `edge_x_m`, the long one.
    wall_restitution : float
        Normal speed after an impact on the rim over the speed before it, 0 to 1.
    wall_friction : float
        Coulomb coefficient between marble and rim.
    sliding_friction : float
        Coulomb coefficient between marble and board; it matters only while the marble slips, for some
        milliseconds after it has met the rim.

    Raises
    ------
    IrtError
        If a value is none that a board can have.
    """

    edge_x_m: float = 0.276
    edge_y_m: float = 0.231
    wall_restitution: float = 0.0
    wall_friction: float = 0.25
    sliding_friction: float = 0.25

    def __post_init__(self) -> None:
        # No table is ten metres long, but a board given in millimetres is 276.
        _check("edge_x_m", self.edge_x_m, _TINY, 10.0, " m")
        _check("edge_y_m", self.edge_y_m, _TINY, 10.0, " m")
        _check("wall_restitution", self.wall_restitution, 0.0, 1.0)
        _check("wall_friction", self.wall_friction, 0.0, 1000.0)
        _check("sliding_friction", self.sliding_friction, 0.0, 1000.0)


@dataclass(frozen=True)
class Marble:
    """The marble; the defaults are the paper's, 13.7 mm across.

    Attributes
    ----------
    radius_m : float
        Radius [m].
    mass_kg : float
        Mass [kg].
    damping_per_s : float
        Rate at which speed and spin decay [1/s].

    Raises
    ------
    IrtError
        If a value is none that a marble can have.
    """

    radius_m: float = 0.00685
    mass_kg: float = 0.0105
    damping_per_s: float = 0.0

    def __post_init__(self) -> None:
        _check("radius_m", self.radius_m, _TINY, 10.0, " m")
        _check("mass_kg", self.mass_kg, _TINY, 1000.0, " kg")
        _check("damping_per_s", self.damping_per_s, 0.0, 1000.0, " per second")


@dataclass(frozen=True)
class Commands:
    """What the commands of a rig are.

    Attributes
    ----------
    unit : str
        "rad" for knob angles; else a name for the reader, such as "mA": gears are in rad per unit.
    matrix : bool
        Whether each command may tilt the board about both axes.
    """

    unit: str = "rad"
    matrix: bool = False


@dataclass(frozen=True)
class TiltSensor:
    """What is known of the measured tilt.

    Attributes
    ----------
    noise_rad : float or None
        Standard deviation of a measured tilt [rad]; None where it is estimated from the recordings.
    offset : (float, float)
        Range of its reading when the board is level [rad].

    Raises
    ------
    IrtError
        If the noise is not positive, or the range is upside down.
    """

    noise_rad: float | None = None
    offset: tuple[float, float] = _TILT_OFFSET_RAD

    def __post_init__(self) -> None:
        if self.noise_rad is not None:
            _check("noise_rad", self.noise_rad, _TINY, 1.0, " rad")
        low, high = self.offset
        if low >= high:
            raise IrtError(f"offset: the range [{low}, {high}] is upside down; expected [low, high]")
        for end in self.offset:
            _check("offset", end, -1.0, 1.0, " rad")


@dataclass(frozen=True, eq=False)
class Rig:
    """A folder of recordings of one rig.

    Attributes
    ----------
    path : Path
        The folder.
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
    """

    path: Path
    board: Board
    marble: Marble
    start: Start
    ranges: dict[str, tuple[float, float]]
    recordings: tuple[Recording, ...]
    commands: Commands = field(default_factory=Commands)
    tilt: TiltSensor = field(default_factory=TiltSensor)

    @property
    def has_tilt(self) -> bool:
        """Whether the board's tilt was measured in any recording."""
        return any(recording.has_tilt for recording in self.recordings)

    def of_marbles(self) -> Rig:
        """Return the rig of the recordings with a marble, without the tilt: for what looks at places alone.

        Raises
        ------
        IrtError
            If no recording has a marble.
        """
        kept = tuple(
            one if one.tilt is None else replace(one, tilt=None) for one in self.recordings if one.has_marble
        )
        if kept == self.recordings:
            return self
        if not kept:
            raise IrtError(
                f"{self.path}: no recording has a marble, which this needs; 'irt tune' fits the tilt alone"
            )
        return replace(self, recordings=kept)

    @cached_property
    def digest(self) -> str:
        """Hash (SHA-256) of all that is read from the folder, names of recordings included."""
        known: tuple[object, ...] = (self.board, self.marble, self.start, sorted(self.ranges.items()))
        # What a rig of the paper's kind does not say leaves the hash as it was before it could be said.
        known += tuple(one for one in (self.commands, self.tilt) if one not in (Commands(), TiltSensor()))
        sha = hashlib.sha256(repr(known).encode())
        for one in self.recordings:
            measured = () if one.tilt is None else (one.tilt,)
            for array in (one.knobs, one.marble, one.stamps, *measured):
                told = np.zeros(0) if array is None else array
                sha.update(f"{one.name} {told.shape}".encode() + told.astype("<f8").tobytes())
        return sha.hexdigest()


def load_rig(folder: PathLike) -> Rig:
    """Read a rig: ``rig.toml``, where it is absent the paper's labyrinth, and every ``*.csv`` beside it.

    Raises
    ------
    IrtError
        If the folder holds no recording, or a file in it is not as it must be.
    """
    folder = Path(folder)
    if not folder.is_dir():
        problem = "a rig is a folder, and this is a file" if folder.exists() else "no such folder"
        raise IrtError(f"{folder}: {problem}; give a folder with recordings (*.csv)")
    settings = folder / "rig.toml"
    table = read_toml(settings) if settings.exists() else TomlTable(f"{settings}", {})
    table.only("section", ("board", "marble", "recordings", "commands", "tilt", "parameters"))
    board, marble = read_dimensions(table)
    commands, tilt = read_signals(table)
    # Hidden files are no recordings: half-written ones and what some systems leave beside a copy.
    files = folder.glob("*.[cC][sS][vV]")
    paths = [path for path in files if not path.name.startswith(".") and not path.is_dir()]
    if not paths:
        raise IrtError(f"{folder}: the rig holds no recording; put at least one *.csv into this folder")
    recordings = tuple(load_recording(path) for path in sorted(paths, key=_natural))
    _check_columns(recordings, settings, commands)
    return Rig(
        path=folder,
        board=board,
        marble=marble,
        start=read_start(table),
        ranges=_read_ranges(table.section("parameters")),
        recordings=recordings,
        commands=commands,
        tilt=tilt,
    )


def _check_columns(recordings: tuple[Recording, ...], settings: Path, commands: Commands) -> None:
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
            f"{settings}: recordings have {', '.join(CMD)}, commands in the rig's own unit; name it: "
            '[commands] unit = "mA", say; or call the columns knob_x_rad, knob_y_rad if they are radians'
        )


def read_signals(table: TomlTable) -> tuple[Commands, TiltSensor]:
    """Return what the sections ``[commands]`` and ``[tilt]`` say, the defaults where they say nothing."""
    section = table.section("commands")
    section.only("key", ("unit", "matrix"))
    unit = section.word("unit") if "unit" in section else "rad"
    matrix = section.flag("matrix") if "matrix" in section else False
    section = table.section("tilt")
    section.only("key", ("noise_rad", "offset"))
    offset = _TILT_OFFSET_RAD
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
    if 2.0 * marble.radius_m >= min(board.edge_x_m, board.edge_y_m):
        raise marble_table.error("radius_m", f"{marble.radius_m} m does not fit between the walls")
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
    if low >= high:
        raise IrtError(f"{name}: the range [{low}, {high}] is upside down; expected [low, high]")
    check_value(name, low)
    check_value(name, high)


def check_value(name: str, value: float) -> None:
    """Raise `IrtError` unless the parameter ``name`` exists and may have this value."""
    if name not in _BOUNDS:
        raise unknown_name("parameter", name, PARAMETERS)
    low, high = _BOUNDS[name]
    _check(name, value, low, high)


def _read_ranges(section: TomlTable) -> dict[str, tuple[float, float]]:
    """Return the range of every parameter: the paper's, unless ``[parameters]`` gives another."""
    section.only("parameter", PARAMETERS)
    ranges = dict(RANGES)
    for name in section.content:
        table = section.inline(name, "{ range = [low, high] }")
        table.only("key", ("range",))
        ranges[name] = table.pair("range")
        with located(section.where):
            check_range(name, *ranges[name])
    return ranges


def _check(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    if not low <= value <= high:
        raise IrtError(f"{name}: expected a number from {low:g} to {high:g}{unit}, found {value:g}")


def _natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a key that sorts numbers in a name by value: run-2 before run-10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name
