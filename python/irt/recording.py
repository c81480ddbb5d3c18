"""One recording: commands, where the marble was seen and how the board tilted, one CSV row a timestep."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irt.errors import IrtError
from irt.files import PathLike, read_text, write_atomic
from irt.path_length import rolled

Array = NDArray[np.float64]
#: What a command does from its row to the next: it holds, or runs evenly to the next command.
Hold = Literal["zero", "first"]
#: Names the place of a value in a message, from its row (from 0) and its column.
Where = Callable[[int, str], str]

STEP = "step"
STAMP = "t_s"
KNOBS = ("knob_x_rad", "knob_y_rad")
#: Commands that are no angles (motor currents, servo units): the rig's ``[commands] unit`` names the unit.
CMD = ("cmd_x", "cmd_y")
MARBLE = ("marble_x", "marble_y")
TILT = ("tilt_x_rad", "tilt_y_rad")

#: Half of all positions beyond this many board edges: no marble on a board, but another unit.
_MOST_EDGES = 2.0
#: No slip of a tracker and no knob goes this far (board edges, rad); squares of larger numbers may overflow.
_LARGEST = 1e6
#: No board of a labyrinth tilts this far (rad): half a radian is 29 degrees.
_STEEPEST_RAD = 0.5
#: Longest time that one command may hold (s): 5000 physics updates, as many as the engine allows.
_LONGEST_STEP_S = 5000 / 240


@dataclass(frozen=True, eq=False)
class Recording:
    """One run of the rig.

    Row i is the position seen at the moment command i is issued; command i holds until row i + 1. The arrays
    are copies, and read-only.

    Attributes
    ----------
    name : str
        The file's name without its ending.
    path : Path
        The file.
    knobs : (n, 2) array
        Commands: knob angles [rad], or numbers in the rig's own unit (`columns`).
    marble : (n, 2) array
        Observed positions [board edges], NaN rows where the tracker lost the marble; never in row 0, where
        every prediction starts. All rows are NaN in a run without a marble, which then has a tilt.
    stamps : (n,) array or None
        Time of each row [s], rising.
    tilt : (n, 2) array or None
        Measured angles of the board about x and y [rad], by the right-hand rule; NaN where not measured.
    columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
        The columns that the commands stand in.
    hold : {"zero", "first"}
        What a command does from its row to the next: a zero-order hold, as files have it; or a first-order
        hold, as where a measured tilt is played in the place of the commands.
    before : (2,) array or None
        The commands before row 0, where they are known; files do not hold them.

    Raises
    ------
    IrtError
        If the arrays are no recording: other shapes, fewer than two rows, values that cannot be.
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
        def where(row: int, column: str) -> str:
            return f"{self.name}, row {row}, column {column}"

        rows = len(np.atleast_1d(_owned(self.name, "knobs", self.knobs)))
        shapes = {"knobs": (rows, 2), "marble": (rows, 2), "stamps": (rows,), "tilt": (rows, 2)}
        for field, shape in shapes.items():
            if getattr(self, field) is None:
                continue
            array = _owned(self.name, field, getattr(self, field))
            object.__setattr__(self, field, array)
            if array.shape != shape:
                raise IrtError(f"{self.name}: {field} must have shape {shape}, not {array.shape}")
        if self.columns not in (KNOBS, CMD):
            raise IrtError(f"{self.name}: columns must be {KNOBS} or {CMD}, not {self.columns}")
        _check_commands(self.name, self.knobs, self.stamps, where, self.columns)
        if self.tilt is not None:
            _check_tilt(self.tilt, where)
        _check_marble(self.name, self.marble, where, alone=self.has_tilt)

    @property
    def durations(self) -> Array | None:
        """How long each command holds, (n,) [s], where there are stamps (see `durations`)."""
        return durations(self.stamps)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Rows in which the tracker saw the marble, (n,)."""
        return ~np.isnan(self.marble[:, 0])

    @property
    def has_marble(self) -> bool:
        """Whether the tracker saw the marble in any row."""
        return bool(self.seen.any())

    @property
    def has_tilt(self) -> bool:
        """Whether the board's tilt was measured in any row, about either axis."""
        return self.tilt is not None and bool(np.isfinite(self.tilt).any())

    @property
    def rolled_path(self) -> Array:
        """Where the marble has rolled, without noise, (n, 2) [board edges]."""
        return self._rolled[0]

    @property
    def way(self) -> Array:
        """How far the marble has rolled up to each row, (n,) [board edges]."""
        return self._rolled[1]

    @cached_property
    def _rolled(self) -> tuple[Array, Array]:
        return rolled(self.marble)

    def to_csv(self) -> str:
        """Return the recording as CSV text that reads back bit for bit."""
        table = dict(zip((*self.columns, *MARBLE), (*self.knobs.T, *self.marble.T), strict=True))
        if self.stamps is not None:
            table = {STAMP: self.stamps, **table}
        if self.tilt is not None:
            table.update(zip(TILT, self.tilt.T, strict=True))
        lines = [",".join((STEP, *table))]
        for row, values in enumerate(np.stack(list(table.values()), axis=1).tolist()):
            # repr gives the shortest text that reads back as the same number.
            lines.append(
                ",".join([str(row), *("" if math.isnan(value) else repr(value) for value in values)])
            )
        return "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False)
class Commands:
    """What to simulate: commands, and where the marble starts if the file says so.

    Attributes
    ----------
    knobs : (n, 2) array
        Commands, as those of a `Recording`.
    start : (2,) array or None
        Marble position at row 0 [board edges].
    stamps : (n,) array or None
        Time of each row [s], rising.
    columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
        The columns that the commands stand in.
    """

    knobs: Array
    start: Array | None
    stamps: Array | None
    columns: tuple[str, str] = KNOBS

    @property
    def durations(self) -> Array | None:
        """How long each command holds, (n,) [s], where there are stamps (see `durations`)."""
        return durations(self.stamps)


def durations(stamps: Array | None) -> Array | None:
    """Return how long each command holds, (n,) [s]; the last, of unknown end, as long as the one before."""
    if stamps is None:
        return None
    steps = np.diff(stamps)
    return np.append(steps, steps[-1])


def load_recording(path: PathLike, *, begun: Array | None = None) -> Recording:
    """Read a recording from a CSV file.

    Columns are found by name, in any order; others are ignored. A byte order mark, Windows line ends and
    blank lines are accepted.

    Parameters
    ----------
    path : path
        A CSV with the columns ``step``, ``knob_x_rad``, ``knob_y_rad`` (or ``cmd_x``, ``cmd_y``),
        ``marble_x``, ``marble_y``; with ``t_s`` if the rows carry stamps, ``tilt_x_rad`` and ``tilt_y_rad``
        if the board's tilt was measured (then the marble's columns may be absent).
    begun : (k, 2) array, optional
        Positions of the first rows [board edges] in the place of the file's, where a tracker may have lost
        the marble.

    Raises
    ------
    IrtError
        If the file is no recording; the message names line and column.
    """
    table = _Table.read(path, _columns_of_recording)
    knobs, stamps, columns = _read_commands(table)
    tilt = _read_pair(table, TILT) if TILT[0] in table.columns else None
    if tilt is not None:
        _check_tilt(tilt, table.where)
        _check_steepness(tilt, table.where)
    marble = _read_pair(table, MARBLE) if MARBLE[0] in table.columns else np.full_like(knobs, np.nan)
    if begun is not None:
        marble[: len(begun)] = begun
    is_measured = tilt is not None and bool(np.isfinite(tilt).any())
    _check_marble(f"{path}", marble, table.where, alone=is_measured)
    return Recording(Path(path).stem, Path(path), knobs, marble, stamps, tilt, columns)


def load_commands(path: PathLike) -> Commands:
    """Read the commands of a CSV file; the marble's columns may be absent, or empty throughout.

    Raises
    ------
    IrtError
        If the file holds no commands; the message names line and column.
    """
    table = _Table.read(path, lambda header: (STEP, *_columns_of_commands(header)))
    knobs, stamps, columns = _read_commands(table)
    there = [column for column in MARBLE if column in table.columns]
    if len(there) == 1:
        raise IrtError(f"{path}: a start needs both {' and '.join(MARBLE)}; the header has only {there[0]}")
    start = None
    if there and not np.isnan(marble := _read_pair(table, MARBLE)).all():
        _check_marble(f"{path}", marble, table.where)
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
    """Write a recording as CSV, so that `load_recording` returns the same numbers bit for bit.

    Parameters
    ----------
    path : path
        The file to write; an old one is replaced only by the whole new one.
    knobs : (n, 2) array
        Commands: knob angles [rad], or numbers in the rig's own unit.
    marble : (n, 2) array
        Observed positions [board edges]; a NaN row is written as empty cells.
    stamps : (n,) array, optional
        Time of each row [s].
    tilt : (n, 2) array, optional
        Measured angles of the board [rad]; NaN is written as an empty cell.
    columns : {("knob_x_rad", "knob_y_rad"), ("cmd_x", "cmd_y")}
        The columns for the commands.

    Raises
    ------
    IrtError
        If the arrays are no recording, or the file cannot be written.
    """
    path = Path(path)
    name = path.stem
    owned_knobs, owned_marble = _owned(name, "knobs", knobs), _owned(name, "marble", marble)
    owned_stamps = None if stamps is None else _owned(name, "stamps", stamps)
    owned_tilt = None if tilt is None else _owned(name, "tilt", tilt)
    recording = Recording(name, path, owned_knobs, owned_marble, owned_stamps, owned_tilt, columns)
    write_atomic(path, recording.to_csv())


@dataclass(frozen=True)
class _Table:
    """The cells of a CSV file by column, and the line of the file on which each row ends."""

    path: PathLike
    columns: dict[str, tuple[str, ...]]
    lines: list[int]

    @classmethod
    def read(cls, path: PathLike, required: Callable[[Sequence[str]], Sequence[str]]) -> _Table:
        """Read a file; `required` returns which columns must be there, given those that are."""
        reader = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
        rows: list[list[str]] = []
        lines: list[int] = []
        try:
            for cells in reader:
                stripped = [cell.strip() for cell in cells]
                if any(stripped):
                    rows.append(stripped)
                    lines.append(reader.line_num)
        except csv.Error as error:
            raise IrtError(f"{path}, line {reader.line_num}: broken CSV: {error}") from error
        if not rows:
            raise IrtError(f"{path}: the file is empty")
        header = rows.pop(0)
        _check_header(f"{path}, line {lines[0]}", header, required(header))
        for cells, line in zip(rows, lines[1:], strict=True):
            if len(cells) != len(header):
                raise IrtError(f"{path}, line {line}: {len(cells)} cells, but the header has {len(header)}")
        if not rows:
            raise IrtError(f"{path}: the file has a header, but no rows")
        return cls(path, dict(zip(header, zip(*rows, strict=True), strict=True)), lines[1:])

    def where(self, row: int, column: str) -> str:
        return f"{self.path}, line {self.lines[row]}, column {column}"

    def numbers(self, column: str, *, empty: str = "") -> Array:
        """Return a column as numbers; ``empty`` is read where a cell is."""
        values = np.empty(len(self.lines))
        for row, cell in enumerate(self.columns[column]):
            try:
                values[row] = _number(cell or empty)
            except ValueError:
                found = f'found "{cell[:40]}"' if cell else "found an empty cell"
                raise IrtError(f"{self.where(row, column)}: expected a number, {found}") from None
        return values


def _number(text: str) -> float:
    # Python groups digits as in 1_000, other programs do not: there it is a slip.
    if "_" in text:
        raise ValueError(text)
    return float(text)


def _check_header(where: str, header: list[str], required: Sequence[str]) -> None:
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise IrtError(f"{where}: cells must be separated by commas")
    if set(CMD) & set(header) and set(KNOBS) & set(header):
        raise IrtError(
            f"{where}: commands stand in both {', '.join(KNOBS)} and {', '.join(CMD)}; keep one pair"
        )
    for name in required:
        if name not in header:
            raise IrtError(f"{where}: column {name} is missing; the header has {', '.join(header)}")
    for name in (STEP, STAMP, *KNOBS, *CMD, *MARBLE, *TILT):
        if header.count(name) > 1:
            raise IrtError(f"{where}: column {name} stands there {header.count(name)} times; keep one")


def _columns_of_commands(header: Sequence[str]) -> tuple[str, str]:
    return CMD if set(CMD) & set(header) else KNOBS


def _columns_of_recording(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns that a recording needs: the marble's may be absent where the tilt was measured."""
    tilt = TILT if set(TILT) & set(header) else ()
    marble = MARBLE if set(MARBLE) & set(header) or not tilt else ()
    return (STEP, *_columns_of_commands(header), *marble, *tilt)


def _read_commands(table: _Table) -> tuple[Array, Array | None, tuple[str, str]]:
    """Return commands, stamps, and the columns that the commands stand in."""
    columns = _columns_of_commands(list(table.columns))
    _check_steps(table)
    knobs = _read_pair(table, columns, empty="")
    stamps = table.numbers(STAMP) if STAMP in table.columns else None
    _check_commands(f"{table.path}", knobs, stamps, table.where, columns)
    return knobs, stamps, columns


def _read_pair(table: _Table, columns: tuple[str, str], empty: str = "nan") -> Array:
    return np.stack([table.numbers(column, empty=empty) for column in columns], axis=1)


def _check_steps(table: _Table) -> None:
    steps = table.numbers(STEP)
    wrong = _first(steps != np.arange(len(steps)))
    if wrong is None:
        return
    where = f"{table.where(wrong, STEP)}: expected {wrong}, found {table.columns[STEP][wrong]}"
    if steps[wrong] in steps[:wrong]:
        raise IrtError(
            f"{where}, which line {table.lines[int(steps[wrong])]} has already; no step may repeat"
        )
    hint = " (keep rows in which the marble was lost; only their positions stay empty)"
    raise IrtError(f"{where}; steps count 0, 1, 2, ...{hint if steps[wrong] > wrong else ''}")


def _check_commands(
    name: str, knobs: Array, stamps: Array | None, where: Where, columns: tuple[str, str]
) -> None:
    if len(knobs) < 2:
        raise IrtError(f"{name}: one row only; at least two are needed, a start and what came of it")
    expected = "a knob angle in radians" if columns == KNOBS else "a command"
    for axis, column in enumerate(columns):
        if (row := _first(~(np.abs(knobs[:, axis]) <= _LARGEST))) is not None:
            place, found = where(row, column), knobs[row, axis]
            raise IrtError(f"{place}: expected {expected}, found {found}; no command may be lost")
    if stamps is None:
        return
    if (row := _first(~np.isfinite(stamps))) is not None:
        raise IrtError(f"{where(row, STAMP)}: a stamp must be a finite number, found {stamps[row]}")
    steps = np.diff(stamps)
    if (row := _first(steps <= 0)) is not None:
        found = f"{stamps[row + 1]} follows {stamps[row]}"
        raise IrtError(f"{where(row + 1, STAMP)}: stamps must rise from row to row, but {found}")
    if (row := _first(steps > _LONGEST_STEP_S)) is not None:
        raise IrtError(
            f"{where(row + 1, STAMP)}: {steps[row]:.6g} s after the row before; are the stamps in seconds? "
            "Otherwise split the recording at this pause"
        )


def _check_tilt(tilt: Array, where: Where) -> None:
    for axis, column in enumerate(TILT):
        values = np.abs(tilt[:, axis])
        if (row := _first(np.isinf(values))) is not None:
            raise IrtError(
                f"{where(row, column)}: {tilt[row, axis]} is no angle; leave the cell empty where the tilt "
                "was not measured"
            )


def _check_steepness(tilt: Array, where: Where) -> None:
    """Raise where a measured tilt is none of a labyrinth's in most rows."""
    for axis, column in enumerate(TILT):
        values = np.abs(tilt[:, axis])
        measured = values[np.isfinite(values)]
        if len(measured) and np.median(measured) > _STEEPEST_RAD:
            raise IrtError(
                f"{where(int(np.argmax(values > _STEEPEST_RAD)), column)}: most tilts exceed "
                f"{_STEEPEST_RAD:g} rad (29 degrees), which no board does; tilts are in radians: "
                "divide degrees by 57.2958"
            )


def _check_marble(name: str, marble: Array, where: Where, *, alone: bool = False) -> None:
    """Raise unless positions are possible; a run in which the tilt `alone` was measured needs none."""
    for axis, column in enumerate(MARBLE):
        values = np.abs(marble[:, axis])
        if (row := _first(values > _LARGEST)) is not None:
            raise IrtError(
                f"{where(row, column)}: {marble[row, axis]} is no position [board edges]; "
                "leave both cells empty where the marble was lost"
            )
    lost = np.isnan(marble)
    if (row := _first(lost[:, 0] != lost[:, 1])) is not None:
        column, other = MARBLE if lost[row, 0] else MARBLE[::-1]
        raise IrtError(f"{where(row, column)}: empty, but {other} is not; leave both empty or fill both")
    seen = ~lost[:, 0]
    if alone and not seen.any():
        return
    if not seen.any():
        raise IrtError(f"{name}: the marble is lost in every row; there is nothing to compare with")
    if lost[0, 0]:
        first = int(np.argmax(seen))
        raise IrtError(
            f"{where(0, MARBLE[0])}: the marble is lost in the first row, where every prediction starts; "
            f"cut the rows until it is seen ({first}) and count the steps from 0 again"
        )
    if np.median(np.abs(marble[seen]).max(axis=1)) > _MOST_EDGES:
        raise IrtError(
            f"{where(0, MARBLE[0])}: most positions lie more than {_MOST_EDGES:g} edges off the centre; "
            "positions are in units of the long edge: divide millimetres by the edge in millimetres"
        )


def _owned(name: str, field: str, values: ArrayLike) -> Array:
    """Return a read-only copy, so that a recording stays what it was checked to be."""
    try:
        array = np.array(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise IrtError(f"{name}: {field} must be an array of numbers") from error
    array.flags.writeable = False
    return array


def _first(wrong: NDArray[np.bool_]) -> int | None:
    """Return the first row that is wrong."""
    rows = np.flatnonzero(wrong)
    return int(rows[0]) if len(rows) else None
