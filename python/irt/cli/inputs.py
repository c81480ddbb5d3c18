"""Argument types, checks and notes shared by several verbs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irt.model import Model, Parameter
    from irt.rig import Rig

#: Note on any result from recordings without stamps.
TIME_UNKNOWN = (
    "time scale unknown: without stamps (a column t_s) the duration of a row is unknown; times are in rows, "
    "and gears, tilts and pushes hold only for the model's time_scale"
)


def whole(least: int) -> Callable[[str], int]:
    """Return an argparse type for whole numbers from a minimum on."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected a whole number from {least} on, found {text}")
        return int(text)

    return read


def positive(text: str) -> float:
    """Return a finite number above 0; an argparse type."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number above 0, found {text}")
    return value


def parameter_line(name: str, value: Parameter, unit: str, row_s: float | None) -> tuple[str, str]:
    """Return the name of an effect's parameter, and its value with interval and unit.

    Parameters
    ----------
    name, unit : str
        As in the catalogue.
    value : Parameter
        In SI units.
    row_s : float, optional
        Duration of a row in the simulation [s] if the recordings have no stamps; times are then given in
        rows.
    """
    from irt.report.words import in_rows, with_interval

    if row_s is not None:
        name, value, unit = in_rows(name, value, unit, row_s)
    return name, f"{with_interval(value)} {unit}".rstrip()


def row_seconds(rig: Rig, model: Model) -> float | None:
    """Return the duration of a row in a model [s] if recordings lack stamps, None if all have stamps."""
    from irt.engine import SUBSTEP_S

    if all(one.stamps is not None for one in rig.recordings):
        return None
    return model.parameters["time_scale"].value * SUBSTEP_S


def rows_for_fit(rig: Rig, *, quiet: bool = False) -> tuple[Rig, tuple[str, ...]]:
    """Return a rig cut to the rows that a fit uses, and a note on the cut, printed unless `quiet`."""
    from irt.display import two_digits
    from irt.rig import MOST_ROWS

    short = rig.on_bare_board().first_rows(MOST_ROWS)
    if short is rig:
        return rig, ()
    longest = max(len(one.knobs) for one in short.recordings)
    note = (
        f"{rig.path}: {rig.rows:,} rows would take {two_digits(rig.rows / MOST_ROWS)} times as long as the "
        f"{MOST_ROWS:,} that a fit needs, which take minutes: only the first {longest:,} of each run are "
        "used; to use others, leave only those rows in the folder"
    )
    if not quiet:
        print(f"note: {note}", flush=True)
    return short, (note,)


def results_folder(path: Path, names: Sequence[str]) -> Path:
    """Create the folder for results, and print which existing files will be replaced.

    Raises
    ------
    IrtError
        If the folder is not writable.
    """
    from irt.files import make_folder

    folder = make_folder(path)
    print_replaced([folder / name for name in names])
    return folder


def print_replaced(paths: Sequence[Path]) -> None:
    """Print which files exist already and will be replaced."""
    there = [f"{path}" for path in paths if path.is_file()]
    if there:
        print(f"note: this replaces {', '.join(there)}", flush=True)


def print_warnings(rig: Rig, threads: int | None = None) -> None:
    """Check the recordings before a fit, and print the warnings.

    Raises
    ------
    IrtError
        If the recordings can identify nothing, or contain a certain error.
    """
    from irt.checking.run import required

    for warning in required(rig, threads=threads):
        print(f"warning: {warning}", flush=True)
