"""A mapping of columns by their names and units, to be suggested for a table of no known lab."""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.importing.units import STEEPEST
from irt.recording import CMD, MARBLE, STAMP, TILT
from irt.rig import Board

Array = NDArray[np.float64]

#: Parts of names, in lower case: runs of letters, and numbers.
_PARTS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|\d+")
#: Parts of two names that are alike but for them, and belong to the axes x and y.
_AXES = (("x", "y"), ("xb", "yb"), ("alpha", "beta"), ("roll", "pitch"), ("0", "1"), ("1", "2"))
#: Parts by which a column is recognised.
_TIME = {"t", "time", "stamp", "timestamp", "seconds", "secs"}
_EPISODE = {"episode", "ep", "run", "trial"}
_COMMAND = {"action", "cmd", "command", "desired", "goal", "motor", "ref", "servo", "set", "setpoint", "u"}
_TILT = {"alpha", "angle", "beta", "board", "pitch", "plate", "roll", "theta", "tilt"}
_BALL = {"ball", "marble", "pos", "position", "xb", "yb"}
#: Parts of names of quantities that are not imported.
_OTHER = {
    "acc",
    "accel",
    "current",
    "dot",
    "err",
    "error",
    "gyro",
    "rate",
    "speed",
    "std",
    "v",
    "vel",
    "velocity",
}
#: Divisors of units of time, in seconds, and of length, in metres.
_TIMES = {"s": 1, "ms": 1000, "us": 1_000_000, "ns": 1_000_000_000}
_LENGTHS = {"m": 1, "cm": 100, "mm": 1000}
_DEGREES = {"deg", "degree", "degrees"}
_UNITS = {*_TIMES, *_LENGTHS, *_DEGREES, "mrad", "rad", "px"}
#: Smallest position beyond which the origin is a corner of the board, as a share of the board's edge.
_CORNER = -0.05


def suggested_command(path: Path, columns: Mapping[str, Array]) -> str | None:
    """Return the command that imports columns by their names, as a trial; None if no marble is among them.

    Parameters
    ----------
    path : Path
        The table.
    columns : dict of (n,) arrays
        Its columns.
    """
    mapping = likely_mapping(columns)
    if not set(MARBLE) <= set(mapping):
        return None
    words = ["irt", "import", str(path), "--from", "csv"]
    for target, text in mapping.items():
        words += ["--map", f"{target}={text}"]
    episode = next((name for name in columns if _is(name, _EPISODE, but=_TIME)), None)
    if episode is not None:
        words += ["--episode", episode]
    return shlex.join([*words, "--dry-run"])


def likely_mapping(columns: Mapping[str, Array]) -> dict[str, str]:
    """Return expressions by target, as far as names and units of the columns show them.

    Signs and exchanged axes do not matter: the import finds them from the motion.
    """
    columns = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    found: dict[str, str] = {}
    time = next((name for name in columns if _is(name, _TIME, but=_COMMAND)), None)
    if time is not None:
        found[STAMP] = _seconds(time, columns[time])
    for names in _pairs(columns):
        targets = _targets(*names)
        if targets is None or targets[0] in found:
            continue
        if targets == MARBLE:
            texts = _places(names, columns)
        elif targets == TILT:
            texts = [_angle(name, columns[name]) for name in names]
        else:
            texts = list(names)
        if texts is not None:
            found |= dict(zip(targets, texts, strict=True))
    return found


def _parts(name: str) -> list[str]:
    return [one.lower() for one in _PARTS.findall(name)]


def _is(name: str, parts: set[str], *, but: set[str]) -> bool:
    """Whether a name has one of these parts, and none of others."""
    own = set(_parts(name))
    return bool(own & parts) and not own & but


def _pairs(columns: Mapping[str, Array]) -> Iterator[tuple[str, str]]:
    """Yield names that differ in the axis only, x first."""
    parts = {name: _parts(name) for name in columns}
    for one, other in itertools.permutations(columns, 2):
        if len(parts[one]) == len(parts[other]):
            differ = [pair for pair in zip(parts[one], parts[other], strict=True) if pair[0] != pair[1]]
            if len(differ) == 1 and differ[0] in _AXES:
                yield one, other


def _targets(x: str, y: str) -> tuple[str, str] | None:
    """Return the targets of two columns; None if they are recognised as nothing that is imported."""
    parts = {*_parts(x), *_parts(y)}
    if parts & _COMMAND or ("a" in parts and "0" in parts):
        return CMD
    if parts & _OTHER:
        return None
    if parts & _TILT:
        return TILT
    if parts & _BALL or parts - _UNITS == {"x", "y"}:
        return MARBLE
    return None


def _seconds(name: str, values: Array) -> str:
    """Return a time in seconds: by its unit, or by its size if it counts from 1970."""
    unit = next((one for one in _TIMES if one in _parts(name)), None)
    largest = float(np.nanmax(np.abs(values)))
    if unit is None:
        unit = next(
            (one for one, least in (("ns", 1e17), ("us", 1e14), ("ms", 1e11)) if largest > least), "s"
        )
    return name if _TIMES[unit] == 1 else f"{name}/{_TIMES[unit]}"


def _angle(name: str, values: Array) -> str:
    """Return an angle in radians: by its unit, or by its size if it is too large for a tilt in radians."""
    parts = set(_parts(name))
    if "mrad" in parts:
        return f"{name}/1000"
    is_large = float(np.nanquantile(np.abs(values), 0.95)) > STEEPEST
    is_degrees = parts & _DEGREES or (is_large and "rad" not in parts)
    return f"rad({name})" if is_degrees else name


def _places(names: tuple[str, str], columns: Mapping[str, Array]) -> list[str] | None:
    """Return positions in long edges from the board's centre; None in pixels or other units.

    Without a unit, it is that in which the marble uses most of the board and does not leave it.
    """
    board = Board()
    values = [columns[name] for name in names]
    spans = [float(np.ptp(one[np.isfinite(one)])) for one in values]
    parts = {*_parts(names[0]), *_parts(names[1])}
    edges = {unit: count * board.edge_x_m for unit, count in _LENGTHS.items()} | {"": 1.0}
    known = [unit for unit in _LENGTHS if unit in parts]
    fitting = known or [unit for unit, edge in edges.items() if max(spans) <= 1.05 * edge < 4.0 * max(spans)]
    if len(fitting) != 1 or "px" in parts:
        return None
    (unit,) = fitting
    divided = {"": "", "m": "/edge_x_m"}.get(unit, f"/{_LENGTHS.get(unit)}/edge_x_m")
    is_corner = all(float(np.nanmin(one)) > _CORNER * edges[unit] for one in values)
    centre = (0.5, round(0.5 * board.edge_y_m / board.edge_x_m, 3)) if is_corner else (0.0, 0.0)
    return [f"{name}{divided}" + (f"-{at:g}" if at else "") for name, at in zip(names, centre, strict=True)]
