"""`irt check`: check a rig's recordings and the identifiability of the parameters before a fit."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from irt.cli.inputs import whole

NAME = "check"
HELP = "check recordings before a fit: rates, gaps, noise, units, axes, identifiable parameters"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt check`."""
    parser.add_argument("rig", metavar="RIG", type=Path, help="a folder of recordings (*.csv)")
    parser.add_argument("--json", action="store_true", help="print the findings and numbers as JSON")
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="simulator threads (default: one per core)"
    )
    parser.epilog = (
        "The exit status is 1 if the recordings can identify nothing.\n\n"
        "examples:\n  irt check my-rig\n  irt check my-rig --json"
    )


def run(args: argparse.Namespace) -> None:
    """Check, print the page or JSON, and raise if the recordings can identify nothing."""
    from irt.checking import check, page
    from irt.cli.inputs import rows_for_fit
    from irt.rig import load_rig

    rig, _ = rows_for_fit(load_rig(args.rig), quiet=args.json)
    found = check(rig, threads=args.threads)
    print(json.dumps(found.as_dict(), indent=2, allow_nan=False) if args.json else page(found))
    found.require()
