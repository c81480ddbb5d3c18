"""The columns of a recording, and checks of their values."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.columns import is_number
from irt.errors import IrtError

Array = NDArray[np.float64]
#: Function from row (from 0) and column to the location of a value, for messages.
Where = Callable[[int, str], str]

STEP = "step"
STAMP = "t_s"
KNOBS = ("knob_x_rad", "knob_y_rad")
#: Commands other than angles (motor currents, servo units), in the unit of the rig's ``[commands] unit``.
CMD = ("cmd_x", "cmd_y")
MARBLE = ("marble_x", "marble_y")
TILT = ("tilt_x_rad", "tilt_y_rad")
#: All columns that are read.
_NAMES = (STEP, STAMP, *KNOBS, *CMD, *MARBLE, *TILT)

#: Largest median of positions [board edges]; larger values are in another unit.
MOST_EDGES = 2.0
#: Largest position [board edges] or command; squares of larger numbers may overflow.
_LARGEST = 1e6
#: Largest median tilt [rad], 29 degrees; labyrinths tilt less.
_STEEPEST_RAD = 0.5
#: Longest duration of a command [s]: 5000 physics updates, the engine's limit.
_LONGEST_STEP_S = 5000 / 240
#: Shortest median step [s]: no camera takes a million pictures a second, and the rate of a much smaller step
#: overflows.
_SHORTEST_STEP_S = 1e-6


def check_header(where: str, header: list[str], required: Sequence[str]) -> None:
    """Raise unless a header has the required columns, and no column twice."""
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise IrtError(f"{where}: cells must be separated by commas; irt import reads semicolons and tabs")
    if all(is_number(cell) for cell in header):
        raise IrtError(f"{where}: the columns have no names; name them {', '.join(required)}")
    if set(CMD) & set(header) and set(KNOBS) & set(header):
        raise IrtError(
            f"{where}: there are commands in both {', '.join(KNOBS)} and {', '.join(CMD)}; keep one pair"
        )
    if set(MARBLE) <= set(required) and not set(_NAMES) & set(header):
        raise IrtError(
            f"{where}: no column of a recording among {', '.join(header)}; `irt import` converts logs with "
            "other columns"
        )
    for name in required:
        if name not in header:
            near = difflib.get_close_matches(name, [one for one in header if one not in _NAMES], n=1)
            remedy = (
                f"rename {near[0]}"
                if near
                else "count rows 0, 1, 2, ..."
                if name == STEP
                else "rename the column that holds it"
            )
            raise IrtError(f"{where}: column {name} is missing; {remedy}; the header has {', '.join(header)}")
    for name in _NAMES:
        if header.count(name) > 1:
            raise IrtError(f"{where}: column {name} appears {header.count(name)} times; keep one")


def check_commands(
    name: str, knobs: Array, stamps: Array | None, where: Where, columns: tuple[str, str]
) -> None:
    """Raise unless commands are numbers in at least two rows, and stamps increase by possible steps."""
    if len(knobs) < 2:
        raise IrtError(f"{name}: only one row; at least two are needed, a start and a result")
    expected = "a knob angle in radians" if columns == KNOBS else "a command"
    for axis, column in enumerate(columns):
        if (row := first_row(~(np.abs(knobs[:, axis]) <= _LARGEST))) is not None:
            place, found = where(row, column), knobs[row, axis]
            raise IrtError(f"{place}: expected {expected}, found {found}; no command may be lost")
    if stamps is None:
        return
    if (row := first_row(~np.isfinite(stamps))) is not None:
        raise IrtError(f"{where(row, STAMP)}: a stamp must be a finite number, found {stamps[row]}")
    steps = np.diff(stamps)
    if (row := first_row(steps <= 0)) is not None:
        found = f"{stamps[row + 1]} follows {stamps[row]}"
        raise IrtError(
            f"{where(row + 1, STAMP)}: stamps must rise from row to row, but {found}; remove the rows that "
            "repeat, sort the others, or split the recording here if the clock was set back"
        )
    if (row := first_row(steps > _LONGEST_STEP_S)) is not None:
        raise IrtError(
            f"{where(row + 1, STAMP)}: {steps[row]:.6g} s after the row before; are the stamps in seconds? "
            "Otherwise split the recording at this pause"
        )
    if (typical := float(np.median(steps))) < _SHORTEST_STEP_S:
        raise IrtError(
            f"{where(1, STAMP)}: most rows are {typical:.3g} s apart, and no camera is as fast; give stamps "
            "in seconds"
        )


def check_tilt(tilt: Array, where: Where) -> None:
    """Raise if a measured tilt is no angle."""
    for axis, column in enumerate(TILT):
        values = np.abs(tilt[:, axis])
        if (row := first_row(values > _LARGEST)) is not None:
            raise IrtError(
                f"{where(row, column)}: {tilt[row, axis]} is not an angle; leave the cell empty where the "
                "tilt was not measured"
            )


def check_steepness(tilt: Array, where: Where) -> None:
    """Raise if a measured tilt is too large for a labyrinth in most rows."""
    for axis, column in enumerate(TILT):
        values = np.abs(tilt[:, axis])
        measured = values[np.isfinite(values)]
        if len(measured) and np.median(measured) > _STEEPEST_RAD:
            raise IrtError(
                f"{where(int(np.argmax(values > _STEEPEST_RAD)), column)}: most tilts exceed "
                f"{_STEEPEST_RAD:g} rad (29 degrees), which no board does; tilts are in radians: "
                "divide degrees by 57.2958"
            )


def check_marble(name: str, marble: Array, where: Where, *, alone: bool = False) -> None:
    """Raise unless positions are possible; with `alone`, a run may have a tilt and no marble."""
    for axis, column in enumerate(MARBLE):
        values = np.abs(marble[:, axis])
        if (row := first_row(values > _LARGEST)) is not None:
            raise IrtError(
                f"{where(row, column)}: {marble[row, axis]} is not a position [board edges]; "
                "leave both cells empty where the marble was lost"
            )
    lost = np.isnan(marble)
    if (row := first_row(lost[:, 0] != lost[:, 1])) is not None:
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
    if np.median(np.abs(marble[seen]).max(axis=1)) > MOST_EDGES:
        low, high = marble[seen].min(axis=0), marble[seen].max(axis=0)
        raise IrtError(
            f"{where(0, MARBLE[0])}: positions go from {low[0]:.4g}, {low[1]:.4g} to {high[0]:.4g}, "
            f"{high[1]:.4g}, most of them more than {MOST_EDGES:g} edges from the centre; positions are "
            "relative to the board's centre in units of its long edge: subtract the centre, then divide by "
            "the length of the long edge in the same unit (pixels or millimetres)"
        )


def first_row(wrong: NDArray[np.bool_]) -> int | None:
    """Return the first row where a mask is True, None if there is none."""
    rows = np.flatnonzero(wrong)
    return int(rows[0]) if len(rows) else None
