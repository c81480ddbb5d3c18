"""`irt import`: bags of the rig to recordings."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irt.importing import Imported

NAME = "import"
HELP = "make recordings out of what the rig recorded"

# Clocks of machines that are kept in time agree to this [s].
_CLOCKS_S = 0.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt import`."""
    parser.add_argument(
        "bags", metavar="BAG", type=Path, nargs="+", help="an MCAP file that `rig play` wrote"
    )
    parser.add_argument(
        "--out",
        metavar="RIG",
        type=Path,
        default=Path("irt-rig"),
        help="the rig's folder, to which a recording is added for each run (default: irt-rig)",
    )
    parser.add_argument(
        "--knobs",
        choices=("measured", "commanded"),
        help="where knob angles come from: the joints, or the commands, which leaves what the arms make of "
        "them to be found out (default: measured, where the joints were heard)",
    )
    parser.add_argument(
        "--period",
        metavar="SECONDS",
        type=_period,
        help="length of a row (default: the rows of the file that was played)",
    )
    parser.epilog = "example:\n  irt import bags/*.mcap --out my-rig\n  irt diagnose my-rig"


def run(args: argparse.Namespace) -> None:
    """Import the bags, and say of each run what was seen."""
    from irt.importing import import_bags

    for one in import_bags(args.bags, args.out, knobs=args.knobs, period=args.period):
        for line in _lines(one):
            print(line)


def _lines(one: Imported) -> list[str]:
    lines = [
        f"{one.path}: {one.rows} rows over {one.seconds:.2f} s, {one.knobs} knobs",
        f"  tracker {one.tracker_hz:.1f} Hz, the marble missing in {one.missing} rows; stamps at least "
        f"{1e3 * one.tracker_age_s:.1f} ms old when they came",
    ]
    if not math.isnan(one.following):
        lines.append(
            f"  knobs within {one.following:.2g} rad of their commands (root mean square), "
            f"{1e3 * one.lag_s:.0f} ms behind; stamps at least "
            f"{1e3 * one.joint_age_s:.1f} ms old when they came"
        )
    for who, age in (("tracker", one.tracker_age_s), ("arms", one.joint_age_s)):
        if age < 0.0 or age > _CLOCKS_S:
            lines.append(
                f"  the clock of the {who} differs from the rig's by about {age:+.3f} s: set it right"
            )
    if one.stop:
        lines.append(f"  stopped: {one.stop}")
    return lines


def _period(text: str) -> float:
    seconds = float(text)
    if not 0.0 < seconds <= 10.0:
        raise argparse.ArgumentTypeError(f"expected more than 0 and at most 10 s, found {text}")
    return seconds
