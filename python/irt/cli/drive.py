"""`irt drive`: make the commands of the first runs, before anything is recorded."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from irt.cli.inputs import positive, print_replaced, whole
from irt.errors import IrtError

NAME = "drive"
HELP = "make commands for the first runs to record: CSV files with stamps, ready to play"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt drive`."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("drive"),
        help="folder for run-1.csv, run-2.csv, ... (default: drive)",
    )
    parser.add_argument("--runs", metavar="N", type=whole(1), default=6, help="number of runs (default: 6)")
    parser.add_argument(
        "--seconds", metavar="S", type=positive, default=8.0, help="length of a run (default: 8)"
    )
    parser.add_argument(
        "--rate",
        metavar="HZ",
        type=positive,
        default=20.0,
        help="rows per second: the rate at which you can send a command and read a position (default: 20)",
    )
    parser.add_argument(
        "--amplitude",
        metavar="A",
        type=positive,
        default=0.1,
        help="largest command, in rad or in the unit given by --unit (default: 0.1)",
    )
    parser.add_argument(
        "--unit",
        metavar="UNIT",
        help="unit of the commands if they are not knob angles, such as us or mA; the columns are then "
        "cmd_x and cmd_y, relative to the command at which the board is level",
    )
    parser.add_argument(
        "--seed", metavar="S", type=whole(0), default=0, help="random seed of the runs (default: 0)"
    )
    parser.epilog = (
        "examples:\n"
        "  irt drive --out drive\n"
        "  irt drive --seconds 10 --rate 30 --amplitude 0.15\n"
        "  irt drive --unit us --amplitude 200     servo pulses, relative to the pulse for a level board"
    )


def run(args: argparse.Namespace) -> None:
    """Write the commands of each run and print how to record them."""
    import numpy as np

    from irt.files import make_folder
    from irt.recording import CMD, KNOBS, save_recording
    from irt.suggestion.first_runs import first_runs

    if args.unit is None and args.amplitude > math.pi:
        raise IrtError(
            f"--amplitude: no knob of a labyrinth turns by {args.amplitude:g} rad, more than half a turn; "
            "give radians, or name the unit with --unit"
        )
    rows = round(args.seconds * args.rate)
    made = first_runs(
        rows,
        1.0 / args.rate,
        runs=args.runs,
        amplitude=args.amplitude,
        unit=args.unit or "rad",
        seed=args.seed,
    )
    folder = make_folder(args.out)
    _refuse_recordings([folder / f"run-{number}.csv" for number in range(1, args.runs + 1)])
    stamps = (np.arange(rows) / args.rate).round(6)
    for number, one in enumerate(made, start=1):
        # Row 0 holds the start of the marble; the other cells stay empty for the recording.
        marble = np.full((rows, 2), np.nan)
        marble[0] = one.start
        path = folder / f"run-{number}.csv"
        commands = one.commands.round(6) + 0.0
        save_recording(path, commands, marble, stamps, columns=KNOBS if args.unit is None else CMD)
        print(f"{path}: {one.words}")
    print(
        f"\nPut the marble at rest in the centre of the level board and play each file at {args.rate:g} rows "
        "per second.\nWhen a command is sent, write the marble's position in the picture to marble_x and "
        "marble_y,\nand the time to t_s. If the marble spends most of a run at the rim, use a smaller "
        "--amplitude.\nThen put the recordings into one folder and run: irt check FOLDER"
    )
    if args.unit is not None:
        print(f'Add a rig.toml to that folder with the lines\n[commands]\nunit = "{args.unit}"')


def _refuse_recordings(paths: Sequence[Path]) -> None:
    """Raise if a file to write holds a recording: only commands that can be made again are replaced."""
    from irt.recording import load_commands, load_recording

    for path in paths:
        if not path.exists():
            continue
        try:
            load_commands(path)
            recorded = bool(load_recording(path).seen[1:].any())
        except IrtError:
            recorded = True
        if recorded:
            raise IrtError(f"{path}: holds more than commands, and would be replaced; choose another --out")
    print_replaced(paths)
