"""What several verbs read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irt.model import Model, Parameter
    from irt.rig import Rig

#: What to know of any answer for recordings without stamps.
TIME_UNKNOWN = (
    "time scale unknown: without stamps (a column t_s) nothing says how long a row lasts; times are in rows, "
    "and gears, tilts and pushes hold for the model's time_scale alone"
)


def whole(least: int) -> Callable[[str], int]:
    """Return the reader of a whole number that must not be below another."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected a whole number from {least} on, found {text}")
        return int(text)

    return read


def parameter_line(name: str, value: Parameter, unit: str, row_s: float | None) -> tuple[str, str]:
    """Return the name of an effect's parameter, and its value with interval and unit.

    Parameters
    ----------
    name, unit : str
        As the catalogue has them.
    value : Parameter
        In SI units.
    row_s : float, optional
        What a row lasts in the simulation [s], where the recordings have no stamps: then rows stand for
        seconds.
    """
    from irt.report.words import in_rows, with_interval

    if row_s is not None:
        name, value, unit = in_rows(name, value, unit, row_s)
    return name, f"{with_interval(value)} {unit}".rstrip()


def row_seconds(rig: Rig, model: Model) -> float | None:
    """Return what a row lasts in a model of recordings without stamps [s], None where they have stamps."""
    from irt.engine import SUBSTEP_S

    if all(one.stamps is not None for one in rig.recordings):
        return None
    return model.parameters["time_scale"].value * SUBSTEP_S


def for_a_fit(rig: Rig, *, quiet: bool = False) -> tuple[Rig, tuple[str, ...]]:
    """Return the rows of a rig that a fit takes, and a note on that, which is printed unless `quiet`."""
    from irt.rig import MOST_ROWS

    short = rig.on_bare_board().first_rows(MOST_ROWS)
    if short is rig:
        return rig, ()
    longest = max(len(one.knobs) for one in short.recordings)
    note = (
        f"{rig.path}: all {rig.rows:,} rows would take {rig.rows / MOST_ROWS:.0f} times as long as the "
        f"{MOST_ROWS:,} that a fit needs, which take minutes: the first {longest:,} of each run are used; "
        "leave only the rows that you want in the folder to choose others"
    )
    if not quiet:
        print(f"note: {note}", flush=True)
    return short, (note,)


def results_folder(path: Path, names: Sequence[str]) -> Path:
    """Make the folder for results, and say which files of an earlier run these will replace.

    Raises
    ------
    IrtError
        If nothing can be written there.
    """
    from irt.files import make_folder

    folder = make_folder(path)
    say_replaced([folder / name for name in names])
    return folder


def say_replaced(paths: Sequence[Path]) -> None:
    """Say which files are there already and will be replaced."""
    there = [f"{path}" for path in paths if path.is_file()]
    if there:
        print(f"note: this replaces {', '.join(there)}", flush=True)


def print_warnings(rig: Rig, threads: int | None = None) -> None:
    """Check the recordings before a fit, and print what would make it wrong.

    Raises
    ------
    IrtError
        If the recordings can identify nothing, or are certainly wrong.
    """
    from irt.checking.run import required

    for warning in required(rig, threads=threads):
        print(f"warning: {warning}", flush=True)
