"""Recordings: commands, observed positions and measured tilt of a run, one CSV row per timestep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irt import arguments
from irt.columns import Columns, is_table
from irt.errors import IrtError
from irt.files import PathLike, write_atomic
from irt.path_length import rolled
from irt.validity import (
    CMD,
    KNOBS,
    MARBLE,
    MOST_EDGES,
    STAMP,
    STEP,
    TILT,
    check_commands,
    check_header,
    check_marble,
    check_steepness,
    check_tilt,
    first_row,
)

__all__ = [
    "CMD",
    "KNOBS",
    "MARBLE",
    "STAMP",
    "STEP",
    "TILT",
    "Commands",
    "Hold",
    "Recording",
    "as_commands",
    "as_recording",
    "durations",
    "load_commands",
    "load_recording",
    "save_recording",
]

Array = NDArray[np.float64]
#: Hold of a command until the next row: zero-order, or first-order (linear interpolation).
Hold = Literal["zero", "first"]


@dataclass(frozen=True, eq=False)
class Recording:
    """A run of the rig.

    Row i is the position observed at the moment command i is issued; command i holds until row i + 1. The
    arrays are read-only copies.

    Attributes
    ----------
    name : str
        The file's name without suffix.
    path : Path
        The file.
    knobs : (n, 2) array
        Commands: knob angles [rad], or numbers in the rig's own unit (`columns`).
    marble : (n, 2) array
        Observed positions [board edges], NaN in rows where the tracker lost the marble. Row 0, where every
        prediction starts, is never NaN. All rows are NaN in a run without a marble, which must have a tilt.
    stamps : (n,) array or None
        Time of each row [s], strictly increasing.
    tilt : (n, 2) array or None
        Measured angles of the board about x and y [rad], by the right-hand rule; NaN where not measured.
    columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
        Names of the columns of the commands.
    hold : {"zero", "first"}
        Hold of a command until the next row: zero-order, as in files, or first-order, as for a measured tilt
        that replaces the commands.
    before : (2,) array or None
        The commands before row 0, if known; files do not contain them.

    Raises
    ------
    IrtError
        If the arrays are not a recording: wrong shapes, fewer than two rows, or impossible values.
    """

    name: str
    path: Path
    knobs: Array
    marble: Array
    stamps: Array | None = None
    tilt: Array | None = None
    columns: tuple[str, str] = KNOBS
    hold: Hold = "zero"
    before: Array | None = None

    def __post_init__(self) -> None:
        arguments.text("name", self.name)
        object.__setattr__(self, "path", arguments.path("path", self.path))
        rows = len(np.atleast_1d(_owned(self.name, "knobs", self.knobs)))
        shapes = {"knobs": (rows, 2), "marble": (rows, 2), "stamps": (rows,), "tilt": (rows, 2)}
        for field, shape in shapes.items():
            if getattr(self, field) is None:
                continue
            array = _owned(self.name, field, getattr(self, field))
            object.__setattr__(self, field, array)
            if array.shape != shape:
                expected = "(n, 2)" if field == "knobs" else shape
                raise IrtError(f"{self.name}: {field} must have shape {expected}, not {array.shape}")
        if self.columns not in (KNOBS, CMD):
            raise IrtError(f"{self.name}: columns must be {KNOBS} or {CMD}, not {self.columns}")
        check_commands(self.name, self.knobs, self.stamps, self.where, self.columns)
        if self.tilt is not None:
            check_tilt(self.tilt, self.where)
        check_marble(self.name, self.marble, self.where, alone=self.has_tilt)

    def where(self, row: int, column: str) -> str:
        """Return the location of a value, for messages."""
        return f"{self.name}, row {row}, column {column}"

    @classmethod
    @arguments.entry
    def from_arrays(
        cls,
        *,
        commands: ArrayLike,
        marble: ArrayLike | None = None,
        tilt: ArrayLike | None = None,
        t: ArrayLike | None = None,
        name: str = "run",
        columns: tuple[str, str] = KNOBS,
    ) -> Recording:
        """Return a recording from arrays, without a file.

        Parameters
        ----------
        commands : (n, 2) array
            Knob angles [rad], or numbers in the rig's own unit (then `columns` are ``cmd_x``, ``cmd_y``).
        marble : (n, 2) array, optional
            Observed positions [board edges], NaN in rows where the tracker lost the marble. Optional if the
            tilt was measured.
        tilt : (n, 2) array, optional
            Measured angles of the board [rad]; NaN where not measured.
        t : (n,) array, optional
            Time of each row [s], strictly increasing.
        name : str
            Name of the recording.
        columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
            Kind of the commands.

        Raises
        ------
        IrtError
            If the arrays are not a recording.
        """
        name = arguments.text("name", name)
        owned = _owned(name, "commands", commands)
        if marble is None:
            marble = np.full(owned.shape, np.nan)
        # The class copies and checks the arrays.
        found = cls(name, Path(name), owned, marble, t, tilt, columns)  # type: ignore[arg-type]
        if found.tilt is not None:
            check_steepness(found.tilt, found.where)
        return found

    @property
    def durations(self) -> Array | None:
        """Duration of each command, (n,) [s]; None without stamps (see `durations`)."""
        return durations(self.stamps)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Whether the marble was observed in each row, (n,)."""
        return ~np.isnan(self.marble[:, 0])

    @property
    def has_marble(self) -> bool:
        """Whether the marble was observed in any row."""
        return bool(self.seen.any())

    @property
    def has_tilt(self) -> bool:
        """Whether the board's tilt was measured in any row, about either axis."""
        return self.tilt is not None and bool(np.isfinite(self.tilt).any())

    @property
    def rolled_path(self) -> Array:
        """Smoothed path of the marble, (n, 2) [board edges]."""
        return self._rolled[0]

    @property
    def way(self) -> Array:
        """Path length of the marble up to each row, (n,) [board edges]."""
        return self._rolled[1]

    @cached_property
    def _rolled(self) -> tuple[Array, Array]:
        return rolled(self.marble)

    def cut(self, rows: int) -> Recording:
        """Return the recording cut to its first rows."""
        arrays = {name: getattr(self, name) for name in ("knobs", "marble", "stamps", "tilt")}
        return replace(self, **{name: one[:rows] for name, one in arrays.items() if one is not None})

    def to_csv(self) -> str:
        """Return the recording as CSV text from which it can be read back exactly."""
        table = dict(zip((*self.columns, *MARBLE), (*self.knobs.T, *self.marble.T), strict=True))
        if self.stamps is not None:
            table = {STAMP: self.stamps, **table}
        if self.tilt is not None:
            table.update(zip(TILT, self.tilt.T, strict=True))
        lines = [",".join((STEP, *table))]
        for row, values in enumerate(np.stack(list(table.values()), axis=1).tolist()):
            # repr is the shortest text that parses to the same number.
            lines.append(
                ",".join([str(row), *("" if math.isnan(value) else repr(value) for value in values)])
            )
        return "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False)
class Commands:
    """Commands to simulate, and the start of the marble if known.

    Attributes
    ----------
    knobs : (n, 2) array
        Commands, as in `Recording`.
    start : (2,) array or None
        Marble position at row 0 [board edges].
    stamps : (n,) array or None
        Time of each row [s], strictly increasing.
    columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
        Names of the columns of the commands.
    """

    knobs: Array
    start: Array | None
    stamps: Array | None
    columns: tuple[str, str] = KNOBS

    @property
    def durations(self) -> Array | None:
        """Duration of each command, (n,) [s]; None without stamps (see `durations`)."""
        return durations(self.stamps)


def durations(stamps: Array | None) -> Array | None:
    """Return the duration of each command, (n,) [s]; the last command lasts as long as the one before."""
    if stamps is None:
        return None
    steps = np.diff(stamps)
    return np.append(steps, steps[-1])


def load_recording(path: PathLike, *, begun: Array | None = None) -> Recording:
    """Read a recording from a CSV file.

    Columns are found by name, in any order; other columns are ignored. A byte order mark, Windows line ends
    and blank lines are accepted.

    Parameters
    ----------
    path : path
        A CSV with the columns ``step``, ``knob_x_rad``, ``knob_y_rad`` (or ``cmd_x``, ``cmd_y``),
        ``marble_x``, ``marble_y``; with ``t_s`` if the rows have stamps, and with ``tilt_x_rad`` and
        ``tilt_y_rad`` if the tilt was measured (then the marble's columns are optional).
    begun : (k, 2) array, optional
        Positions [board edges] that replace those of the first rows, where the tracker may have lost the
        marble.

    Raises
    ------
    IrtError
        If the file is not a recording; the message contains line and column.
    """
    path = arguments.path("path", path)
    table = Columns.read(path, _check_recording)
    return _recording(table, path.stem, path, begun)


def as_recording(value: Recording | PathLike | Any, name: str = "run") -> Recording:
    """Return a recording from a recording, the path of a CSV file, or a table.

    A table is a data frame, a mapping or a structured array with the column names of a recording; ``step`` is
    optional.

    Parameters
    ----------
    value : Recording, path or table
        The recording.
    name : str
        Name of a table.

    Raises
    ------
    IrtError
        If the value is none of these, or not a recording.
    """
    if isinstance(value, Recording):
        return value
    if isinstance(value, str | Path):
        return load_recording(value)
    if is_table(value):
        return _recording(Columns.of(value, name, _check_frame), name, Path(name), None)
    raise IrtError(
        f"{name}: expected irt.Recording, the path of a CSV file or a table with the columns of one, "
        f"got {arguments.shown(value)}"
    )


def _recording(table: Columns, name: str, path: Path, begun: Array | None) -> Recording:
    knobs, stamps, columns = _read_commands(table)
    tilt = _read_pair(table, TILT) if TILT[0] in table else None
    if tilt is not None:
        check_tilt(tilt, table.where)
        check_steepness(tilt, table.where)
    marble = _read_pair(table, MARBLE) if MARBLE[0] in table else np.full_like(knobs, np.nan)
    if begun is not None:
        marble[: len(begun)] = begun
    is_measured = tilt is not None and bool(np.isfinite(tilt).any())
    check_marble(table.source, marble, table.where, alone=is_measured)
    return Recording(name, path, knobs, marble, stamps, tilt, columns)


def load_commands(path: PathLike) -> Commands:
    """Read the commands of a CSV file; the marble's columns may be absent or empty.

    Raises
    ------
    IrtError
        If the file contains no commands; the message contains line and column.
    """

    def check(where: str, header: list[str]) -> None:
        check_header(where, header, (STEP, *_columns_of_commands(header)))

    expected = "a CSV file of commands, as `irt drive` writes them, or a recording"
    return _commands(Columns.read(arguments.path("path", path), check, expected))


def as_commands(value: Any) -> Commands:
    """Return commands from an array, a recording, the path of a CSV file, or a table as in `as_recording`.

    Parameters
    ----------
    value : (n, 2) or (r, n, 2) array, Recording, path or table
        The commands. The start is the marble's first position in a recording or table, if any.

    Raises
    ------
    IrtError
        If the value is none of these.
    """
    if isinstance(value, Commands):
        return value
    if isinstance(value, str | Path):
        return load_commands(value)
    if isinstance(value, Recording):
        start = value.marble[0] if value.has_marble else None
        return Commands(value.knobs, start, value.stamps, value.columns)
    if is_table(value):

        def check(where: str, header: list[str]) -> None:
            check_header(where, header, _columns_of_commands(header))

        return _commands(Columns.of(value, "commands", check))
    knobs = arguments.array("commands", value)
    if knobs.ndim not in (2, 3) or knobs.shape[-1] != 2 or 0 in knobs.shape:
        raise IrtError(f"commands: expected shape (steps, 2) or (n, steps, 2), got {knobs.shape}")
    return Commands(knobs, None, None)


def as_start(value: Any) -> Array:
    """Return the marble's place in row 0 [board edges]; raise if it is in another unit."""
    start = arguments.array("start", value)
    if len(far := start[np.abs(start) > MOST_EDGES]):
        raise IrtError(f"start: {far[0]:g} is not on the board; places are in edges from its centre")
    return start


def _commands(table: Columns) -> Commands:
    knobs, stamps, columns = _read_commands(table)
    there = [column for column in MARBLE if column in table]
    if len(there) == 1:
        raise IrtError(
            f"{table.source}: a start needs both {' and '.join(MARBLE)}; the header has only {there[0]}"
        )
    start = None
    if there and not np.isnan(marble := _read_pair(table, MARBLE)).all():
        check_marble(table.source, marble, table.where)
        start = marble[0]
    return Commands(knobs, start, stamps, columns)


def save_recording(
    path: PathLike,
    knobs: ArrayLike,
    marble: ArrayLike,
    stamps: ArrayLike | None = None,
    *,
    tilt: ArrayLike | None = None,
    columns: tuple[str, str] = KNOBS,
) -> None:
    """Write a recording as CSV, from which `load_recording` returns exactly the same numbers.

    Parameters
    ----------
    path : path
        The file to write; an existing file is replaced atomically.
    knobs : (n, 2) array
        Commands: knob angles [rad], or numbers in the rig's own unit.
    marble : (n, 2) array
        Observed positions [board edges]; a NaN row is written as empty cells.
    stamps : (n,) array, optional
        Time of each row [s].
    tilt : (n, 2) array, optional
        Measured angles of the board [rad]; NaN is written as an empty cell.
    columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
        Names of the columns of the commands.

    Raises
    ------
    IrtError
        If the arrays are not a recording, or the file cannot be written.
    """
    path = arguments.path("path", path)
    name = path.stem
    owned_knobs, owned_marble = _owned(name, "knobs", knobs), _owned(name, "marble", marble)
    owned_stamps = None if stamps is None else _owned(name, "stamps", stamps)
    owned_tilt = None if tilt is None else _owned(name, "tilt", tilt)
    recording = Recording(name, path, owned_knobs, owned_marble, owned_stamps, owned_tilt, columns)
    write_atomic(path, recording.to_csv())


def _columns_of_commands(header: Sequence[str]) -> tuple[str, str]:
    return CMD if set(CMD) & set(header) else KNOBS


def _columns_of_recording(header: Sequence[str]) -> tuple[str, ...]:
    """Return the required columns of a recording; the marble's are optional if the tilt was measured."""
    tilt = TILT if set(TILT) & set(header) else ()
    marble = MARBLE if set(MARBLE) & set(header) or not tilt else ()
    return (*_columns_of_commands(header), *marble, *tilt)


def _check_recording(where: str, header: list[str]) -> None:
    check_header(where, header, (STEP, *_columns_of_recording(header)))


def _check_frame(where: str, header: list[str]) -> None:
    """Check the header of a table in memory, where ``step`` is optional."""
    check_header(where, header, _columns_of_recording(header))


def _read_commands(table: Columns) -> tuple[Array, Array | None, tuple[str, str]]:
    """Return commands, stamps, and the names of the columns of the commands."""
    columns = _columns_of_commands(table.names)
    if STEP in table:
        _check_steps(table)
    knobs = _read_pair(table, columns, empty="")
    stamps = table.numbers(STAMP) if STAMP in table else None
    check_commands(table.source, knobs, stamps, table.where, columns)
    return knobs, stamps, columns


def _read_pair(table: Columns, columns: tuple[str, str], empty: str = "nan") -> Array:
    return np.stack([table.numbers(column, empty=empty) for column in columns], axis=1)


def _check_steps(table: Columns) -> None:
    steps = table.numbers(STEP)
    wrong = first_row(steps != np.arange(len(steps)))
    if wrong is None:
        return
    where = f"{table.where(wrong, STEP)}: expected {wrong}, found {table.cells[STEP][wrong]}"
    if steps[wrong] in steps[:wrong]:
        first = int(steps[wrong])
        place = f"row {first}" if table.lines is None else f"line {table.lines[first]}"
        raise IrtError(f"{where}, which {place} has already; no step may repeat")
    hint = " (keep rows in which the marble was lost; only their positions stay empty)"
    raise IrtError(f"{where}; steps count 0, 1, 2, ...{hint if steps[wrong] > wrong else ''}")


def _owned(name: str, field: str, values: ArrayLike) -> Array:
    """Return a read-only copy, so that a recording stays valid after its check."""
    array = arguments.array(f"{name}: {field}", values)
    array.flags.writeable = False
    return array
