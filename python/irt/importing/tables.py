"""Logs in CSV and NPZ files: columns of numbers, and the specifics of each lab."""

from __future__ import annotations

import csv
import io
import re
from datetime import UTC, datetime, time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.columns import is_number
from irt.errors import IrtError
from irt.files import read_text
from irt.importing.clocks import steady_offset

Array = NDArray[np.float64]
Columns = dict[str, Array]

#: Columns that identify the CSV of a CyberRunner without ROS.
WITHOUT_ROS = frozenset({"t", "episode", "step", "xb", "yb", "alpha", "beta", "a0", "a1"})
#: First bytes of pickles (protocols 2 to 5), including PyTorch's old files.
_PICKLES = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
#: Cells of a lost value.
_EMPTY = {"", "nan"}
#: Characters that no name in an expression may have, and a digit at its beginning.
_NO_NAME = re.compile(r"\W+|^(?=\d)")
#: Separators of cells, and a number with a decimal comma, as spreadsheets of many countries write it beside
#: the other two.
_SEPARATORS = ",;\t"
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
#: First bytes of files that hold other files, packed: gzip, ZIP (and spreadsheets), bzip2, xz, Zstandard.
_PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd")
_PICKLE_NAMES = {".pkl", ".pickle", ".pk", ".p", ".pt", ".pth", ".joblib"}
#: Largest age of a picture when its state is logged [s].
_OLDEST_S = 1.0
#: Board in the replay's units [m], and unit of its angles [rad].
_REPLAY_SIZE = (0.276, 0.231)
_REPLAY_ANGLE = np.deg2rad(10.0)
#: Largest difference of two clocks that are read in succession [s].
_SAME_CLOCK_S = 0.005


def begins_with(path: Path, beginnings: tuple[bytes, ...]) -> bool:
    """Return whether the first bytes of a file are one of these."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(max(map(len, beginnings))).startswith(beginnings)


def refuse_pickle(path: Path) -> None:
    """Raise `IrtError` if a file is a pickle, which runs code when it is opened."""
    if path.suffix.lower() in _PICKLE_NAMES or begins_with(path, _PICKLES):
        raise IrtError(
            f"{path}: a pickle is never opened, since it may run any code; save the arrays as CSV or as NPZ "
            "without objects"
        )


def refuse_packed(path: Path) -> None:
    """Raise `IrtError` if a file is an archive or a spreadsheet."""
    if begins_with(path, _PACKED):
        raise IrtError(f"{path}: a packed file; unpack it first, or export a spreadsheet as CSV")


def read_columns(path: Path) -> Columns:
    """Return the columns of a CSV file; empty and non-numeric cells are NaN.

    What may not be in a name of `--map` becomes an underscore: "Ball X (mm)" is ``Ball_X_mm``.

    Cells are separated by commas, or by semicolons or tabs, beside which all numbers may have decimal commas.
    Dates with a time, and times of the day, by ISO 8601, are seconds since 1970 (UTC unless they name another
    zone), or since midnight. A column without any of these (such as a status text) is left out.

    Raises
    ------
    IrtError
        If the file is no CSV with a header and rows of equal length.
    """
    refuse_packed(path)
    text = read_text(path)
    separator = _separator(text)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    rows: list[list[str]] = []
    try:
        names = [cell.strip() for cell in next(reader, [])]
        if names and all(map(is_number, names)):
            raise IrtError(
                f"{path}, line 1: the columns have no names; add a line with them above the numbers"
            )
        header = [_NO_NAME.sub("_", name).rstrip("_") for name in names]
        for cells in reader:
            if not any(cells):
                continue
            if len(cells) != len(header):
                raise IrtError(
                    f"{path}, line {reader.line_num}: {len(cells)} cells, but the header has {len(header)}"
                )
            rows.append(cells)
    except csv.Error as error:
        raise IrtError(f"{path}, line {reader.line_num}: broken CSV: {error}") from error
    if not rows:
        raise IrtError(f"{path}: no rows below a header; expected a CSV")
    if len(set(header)) < len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise IrtError(f'{path}, line 1: duplicate column "{twice}"; rename one')
    columns = {}
    if separator != "," and not any(
        "." in cell and not np.isnan(_number(cell)) for row in rows for cell in row
    ):
        rows = [[_with_point(cell) for cell in row] for row in rows]
    for name, column in zip(header, zip(*rows, strict=True), strict=True):
        values = _numbers(column)
        if not np.isfinite(values).any():
            values = np.array([_seconds(cell) for cell in column])
        if np.isfinite(values).any() or all(cell.strip().lower() in _EMPTY for cell in column):
            columns[name] = values
    return columns


def read_without_ros(path: Path, columns: Columns) -> tuple[Columns, Array]:
    """Return the columns of a CyberRunner without ROS, and where its episodes change.

    Its row i was observed after action i. In a recording command i is issued when row i is observed, so the
    action of the next row is used; the last row of each episode has none.
    """
    episodes = np.nan_to_num(columns["episode"], nan=-1.0)
    last = np.append(np.diff(episodes) != 0, True)
    shifted = dict(columns)
    for name in ("a0", "a1"):
        values = np.append(columns[name][1:], np.nan)
        shifted[name] = np.where(last, np.nan, values)
    return shifted, episodes


def read_tag_folder(folder: Path) -> tuple[Columns, Columns, tuple[str, ...]]:
    """Return columns of states and commands from a TAG recorder's folder, with ``t_s``, and notes.

    The recorder stamps both files by one monotonic clock, which is used; if these stamps are missing or do
    not overlap, the ROS clock is used. States are shifted back by the age of their picture.

    Raises
    ------
    IrtError
        If a file or its stamps are missing.
    """
    paths = folder / "states.csv", folder / "commands.csv"
    for path in paths:
        if not path.is_file():
            raise IrtError(f"{path}: no such file; a TAG folder has states.csv and commands.csv")
    tables = [read_columns(path) for path in paths]
    notes: list[str] = []
    clock = _common_clock(folder, tables, notes)
    for table in tables:
        table["t_s"] = table[clock] / 1e9
    states = _renamed(tables[0])
    age = states.get("source_age_ns")
    if age is not None and np.isfinite(age).any():
        age = age / 1e9
        usable = np.isfinite(age) & (age >= 0.0) & (age <= _OLDEST_S)
        if usable.mean() > 0.9:
            states["t_s"] = states["t_s"] - np.where(usable, age, np.median(age[usable]))
            notes.append(
                f"states are shifted back by the age of their picture, {1e3 * np.median(age[usable]):.1f} ms"
            )
    return states, tables[1], tuple(notes)


def read_replay(path: Path) -> tuple[Columns, Array]:
    """Return the columns of a CyberRunner replay, and where its episodes change; nothing is unpickled.

    ``states`` hold alpha and beta in units of 10 degrees and the place from the lower left in units of the
    board's edges. The first of mirrored streams is used.

    Raises
    ------
    IrtError
        If arrays are missing, hold objects, or differ in length.
    """
    try:
        # A stream of its own, since numpy leaves a file open in which it finds no archive.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = {
                name: np.asarray(archive[name])
                for name in ("states", "action", "is_first")
                if name in archive.files
            }
    except FileNotFoundError as error:
        raise IrtError(f"{path}: no such file") from error
    # A broken archive raises errors of any kind: of its format, its compression, its lengths.
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise IrtError(f"{path}: no NPZ of plain numbers, or one that was cut short ({reason})") from error
    if "states" not in arrays:
        raise IrtError(f'{path}: no array "states" in it; expected a replay of CyberRunner')
    states = _first_stream(path, arrays["states"], 4)
    rows = len(states)
    action = _first_stream(path, arrays["action"], 2) if "action" in arrays else np.full((rows, 2), np.nan)
    first = np.asarray(arrays.get("is_first", np.zeros(rows)))
    if first.dtype.kind not in "biuf" or first.shape[:1] != (rows,) or first.size < rows:
        raise IrtError(
            f"{path}: {rows} rows of states, but is_first is {first.shape} of {first.dtype}; it must "
            "hold a number for each row"
        )
    first = first.reshape(rows, -1)[:, 0] if rows else np.zeros(0)
    if len(action) != rows:
        raise IrtError(
            f"{path}: {rows} rows of states, but {len(action)} of actions; they must be of one length"
        )
    width, height = _REPLAY_SIZE
    columns = {
        "alpha": states[:, 0] * _REPLAY_ANGLE,
        "beta": states[:, 1] * _REPLAY_ANGLE,
        "x_b": (states[:, 2] - 0.5) * width,
        "y_b": (states[:, 3] - 0.5) * height,
        "action_1": action[:, 0],
        "action_2": action[:, 1],
    }
    return columns, np.cumsum(first.astype(bool)).astype(np.float64)


def _first_stream(path: Path, array: NDArray[np.generic], width: int) -> Array:
    """Return (n, width) of an array that may hold four mirrored streams, side by side or as an axis."""
    if not np.issubdtype(array.dtype, np.number):
        raise IrtError(f"{path}: an array of {array.dtype}, where numbers were expected")
    values = array.astype(np.float64)
    if values.ndim == 3 and values.shape[-1] == width:
        values = values[0] if values.shape[0] <= 4 < values.shape[1] else values[:, 0]
    if values.ndim != 2 or values.shape[1] % width:
        raise IrtError(f"{path}: an array of shape {array.shape}; expected (rows, {width})")
    return values[:, :width]


def _common_clock(folder: Path, tables: list[Columns], notes: list[str]) -> str:
    """Return the column of the clock that stamped both files."""
    overlapping = []
    for name in ("monotonic_ns", "ros_time_ns"):
        if all(name in table and np.isfinite(table[name]).any() for table in tables):
            low = max(np.nanmin(table[name]) for table in tables)
            high = min(np.nanmax(table[name]) for table in tables)
            if low < high:
                overlapping.append(name)
    if not overlapping:
        raise IrtError(
            f"{folder}: commands and states do not overlap in time, by monotonic_ns nor by ros_time_ns"
        )
    if overlapping[0] == "ros_time_ns":
        notes.append("stamped by the ROS clock: monotonic clocks of the two files do not overlap")
    elif len(overlapping) == 2:
        found = [steady_offset(one["monotonic_ns"] / 1e9, one["ros_time_ns"] / 1e9) for one in tables]
        ahead, error = found[1][0] - found[0][0], float(np.hypot(found[0][1], found[1][1]))
        notes.append("stamped by the monotonic clock, which both files share")
        if abs(ahead) > max(_SAME_CLOCK_S, 5.0 * error):
            notes.append(
                f"the ROS clock of the commands is {ahead:+.4f} +- {error:.4f} s ahead of the states', unused"
            )
    return overlapping[0]


def _renamed(columns: Columns) -> Columns:
    """Return columns without the unit in their name, as messages have them: ``x_b_m`` is ``x_b``."""
    names = {"x_b_m": "x_b", "y_b_m": "y_b", "alpha_rad": "alpha", "beta_rad": "beta"}
    return {names.get(name, name): values for name, values in columns.items()}


def _separator(text: str) -> str:
    """Return the separator of cells: the most frequent of the possible ones in the header."""
    header = next((line for line in text.splitlines() if line.strip()), "")
    # Of equally frequent ones the first.
    return max(_SEPARATORS, key=header.count)


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def _seconds(cell: str) -> float:
    """Return the seconds of a date with a time since 1970, or of a time since midnight; else NaN."""
    text = cell.strip()
    if ":" not in text:
        return float("nan")
    try:
        if "-" in text or "T" in text:
            date = datetime.fromisoformat(text)
            return (date if date.tzinfo is not None else date.replace(tzinfo=UTC)).timestamp()
        moment = time.fromisoformat(text)
    except ValueError:
        return float("nan")
    return 3600.0 * moment.hour + 60.0 * moment.minute + moment.second + 1e-6 * moment.microsecond


def _numbers(cells: tuple[str, ...]) -> Array:
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        return np.array([_number(cell) for cell in cells])


def _number(cell: str) -> float:
    text = cell.strip()
    if text.lower() in {"true", "false"}:
        return float(text.lower() == "true")
    try:
        return float("nan") if "_" in text else float(text)
    except ValueError:
        return float("nan")
