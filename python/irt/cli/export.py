"""`irt export`: a model as other programs read it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

NAME = "export"
HELP = "write a model for MuJoCo, or as JSON"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt export`."""
    parser.add_argument(
        "model", metavar="MODEL", type=Path, help="a model.toml, as `irt tune` and `irt diagnose` write it"
    )
    parser.add_argument(
        "--to",
        choices=("mjcf", "json"),
        required=True,
        help="mjcf: a MuJoCo model of board, marble and servos; json: all that the model holds, with units",
    )
    parser.add_argument("--out", metavar="FILE", type=Path, help="file to write (default: standard output)")
    parser.epilog = (
        "examples:\n"
        "  irt export diagnosed/model.toml --to mjcf --out board.xml\n"
        "  irt export diagnosed/model.toml --to json --out model.json\n\n"
        "What MuJoCo cannot express is a warning here and a comment in the file."
    )


def run(args: argparse.Namespace) -> None:
    """Write the file, and say what it does not have."""
    from irt.cli.inputs import print_replaced
    from irt.export.jsonfile import to_json
    from irt.export.mjcf import to_mjcf
    from irt.files import write_atomic
    from irt.model import load_model

    model = load_model(args.model)
    if args.to == "mjcf":
        exported = to_mjcf(model)
        text, missing = exported.text, exported.warnings
    else:
        text, missing = to_json(model), ()
    for one in missing:
        print(f"warning: {one}", file=sys.stderr)
    if args.out is None:
        sys.stdout.write(text)
        return
    print_replaced([args.out])
    write_atomic(args.out, text)
    print(f"wrote {args.out}")
