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
        "marble_x, marble_y, whose first row is the start at rest (default: the centre). Recordings work too",
    )
    parser.add_argument(
        "--out", metavar="CSV", type=Path, help="recording to write (default: standard output)"
    )
    parser.epilog = "example:\n  irt simulate model.toml --commands run-1.csv --out predicted.csv"


def run(args: argparse.Namespace) -> None:
    """Simulate the commands and write the recording."""
    from irt.cli.inputs import print_replaced
    from irt.engine import rollouts
    from irt.files import write_atomic
    from irt.model import load_model
    from irt.recording import Recording, load_commands

    model = load_model(args.model)
    commands = load_commands(args.commands)
    marble, tilt = rollouts(
        model, commands.knobs, start=commands.start, durations=commands.durations, tilt=True
    )
    name, path, columns = args.commands.stem, args.commands, commands.columns
    recording = Recording(name, path, commands.knobs, marble[0], commands.stamps, tilt[0], columns)
    if args.out is None:
        sys.stdout.write(recording.to_csv())
    else:
        print_replaced([args.out])
        write_atomic(args.out, recording.to_csv())
