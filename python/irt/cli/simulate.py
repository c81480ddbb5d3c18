"""`irt simulate`: simulate commands with a model, and write the result as a recording."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

NAME = "simulate"
HELP = "predict the marble's path and the board's tilt under given commands"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt simulate`."""
    parser.add_argument("model", metavar="MODEL", type=Path, help="a model.toml, as `irt tune` writes it")
    parser.add_argument(
        "--commands",
        metavar="CSV",
        type=Path,
        required=True,
        help="columns step, knob_x_rad, knob_y_rad (or cmd_x, cmd_y); optional t_s, the stamps; optional "
        "marble_x, marble_y, whose first row is the start at rest (default: the maze's, or the centre). "
        "Recordings work too",
    )
    parser.add_argument(
        "--out", metavar="CSV", type=Path, help="recording to write (default: standard output)"
    )
    parser.epilog = "example:\n  irt simulate model.toml --commands run-1.csv --out predicted.csv"


def run(args: argparse.Namespace) -> None:
    """Simulate the commands and write the recording."""
    import numpy as np

    from irt.cli.inputs import print_replaced
    from irt.engine import rollouts
    from irt.files import write_atomic
    from irt.model import load_model
    from irt.recording import Recording, load_commands

    model = load_model(args.model)
    commands = load_commands(args.commands)
    falls = np.empty((1, 2), dtype=np.int64)
    marble, tilt = rollouts(
        model, commands.knobs, start=commands.start, durations=commands.durations, tilt=True, falls=falls
    )
    row, hole = falls[0].tolist()
    if model.maze is not None and row >= 0:
        x, y = model.maze.holes[hole]
        print(
            f"note: the marble falls through hole {hole + 1} at [{x:g}, {y:g}]; it is gone from row {row} on",
            file=sys.stderr,
        )
    name, path, columns = args.commands.stem, args.commands, commands.columns
    recording = Recording(name, path, commands.knobs, marble[0], commands.stamps, tilt[0], columns)
    if args.out is None:
        sys.stdout.write(recording.to_csv())
    else:
        print_replaced([args.out])
        write_atomic(args.out, recording.to_csv())
