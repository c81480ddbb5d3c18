"""`irt import`: convert bags of the rig, and logs of other labs, to recordings."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.progress import progress_bar
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.importing import Imported

NAME = "import"
HELP = "convert the rig's bags, or another lab's logs, to recordings"

# Largest difference between synchronised clocks [s].
_CLOCKS_S = 0.2

_EPILOG = """\
examples:
  irt import bags/*.mcap --out my-rig
  irt import rosbag2_2026_05_01/ --dry-run
  irt import tag-session/ --from tag --out tag-rig
  irt import log.csv --from csv --map marble_x=xb/0.276 --map marble_y=yb/0.276 \\
      --map tilt_x_rad=-alpha --map "tilt_y_rad=rad(beta_deg)" --map t_s=stamp_ms/1000 \\
      --map cmd_x=u1 --map cmd_y=u2 --episode run --out my-rig

targets of --map: t_s, marble_x, marble_y [long edges from the centre], tilt_x_rad, tilt_y_rad, cmd_x, cmd_y
(any unit) or knob_x_rad, knob_y_rad; seen (0 where the marble was lost); cmd_t_s, tilt_t_s where they were
stamped by another clock. edge_x_m stands for the length of the board's long edge [m]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt import`."""
    parser.add_argument(
        "sources",
        metavar="SOURCE",
        type=Path,
        nargs="+",
        help="a bag (MCAP, sqlite3, or its folder), a recorder's folder, a CSV or a replay (NPZ); all "
        "sources must be of the same rig",
    )
    parser.add_argument(
        "--from",
        dest="kind",
        choices=("rig", "cyberrunner", "tag", "csv"),
        help="kind of log: our own rig's, CyberRunner's, TAG's, or any CSV with --map (default: detected "
        "from the content)",
    )
    parser.add_argument(
        "--out",
        metavar="RIG",
        type=Path,
        default=Path("irt-rig"),
        help="the rig's folder; a recording is added for each run, and no file is replaced "
        "(default: irt-rig)",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="print the summary and write nothing (not for --from rig)"
    )
    logs = parser.add_argument_group("logs of other labs")
    logs.add_argument(
        "--map",
        metavar="TARGET=EXPRESSION",
        action="append",
        default=[],
        help="compute a target from the log's columns, instead of the format's default (see below)",
    )
    logs.add_argument("--episode", metavar="COLUMN", help="a column whose value changes at each new run")
    logs.add_argument(
        "--topic",
        metavar="NAME",
        action="append",
        default=[],
        help="topic to use if a bag has several of one kind",
    )
    logs.add_argument(
        "--home-after",
        metavar="SECONDS",
        type=_period,
        help="time without a command after which the driver returns to command 0 (default: it holds the "
        "last command)",
    )
    own = parser.add_argument_group("bags of our own rig")
    own.add_argument(
        "--knobs",
        choices=("measured", "commanded"),
        help="source of the knob angles: measured joint angles, or commands, so that the diagnosis finds "
        "the dynamics of the arms (default: measured if the bag has joint angles)",
    )
    own.add_argument(
        "--period",
        metavar="SECONDS",
        type=_period,
        help="duration of a row (default: that of the played file)",
    )
    parser.epilog = _EPILOG


def run(args: argparse.Namespace) -> None:
    """Import the sources and print a summary."""
    from irt.importing.sources import detect

    kinds = {args.kind} if args.kind else {detect(one, mapped=bool(args.map)) for one in args.sources}
    if len(kinds) > 1:
        raise IrtError(f"sources of several kinds ({', '.join(sorted(kinds))}); import one kind at a time")
    (kind,) = kinds
    if kind == "rig":
        _run_rig(args)
    else:
        _run_logs(args, kind)


def _run_rig(args: argparse.Namespace) -> None:
    from irt.importing import import_bags

    given = {
        "--map": args.map,
        "--episode": args.episode,
        "--topic": args.topic,
        "--home-after": args.home_after,
        "--dry-run": args.dry_run,
    }
    _refuse(given, "bags of our own rig")
    for one in import_bags(args.sources, args.out, knobs=args.knobs, period=args.period):
        for line in _lines(one):
            print(line)


def _run_logs(args: argparse.Namespace, kind: str) -> None:
    from irt.importing.logs import import_logs
    from irt.importing.summary import summary_lines

    _refuse({"--knobs": args.knobs, "--period": args.period}, "logs of other labs")
    with progress_bar() as progress:
        summary = import_logs(
            args.sources,
            args.out,
            kind,  # type: ignore[arg-type]
            mapping=args.map,
            topics=args.topic,
            episode=args.episode,
            home_after=args.home_after,
            dry_run=args.dry_run,
            progress=progress,
        )
    for line in summary_lines(summary):
        print(line)


def _refuse(given: dict[str, object], what: str) -> None:
    for option, value in given.items():
        if value:
            raise IrtError(f"{option} is not for {what}; leave it out, or choose the source with --from")


def _lines(one: Imported) -> list[str]:
    lines = [
        f"{one.path}: {one.rows} rows over {one.seconds:.2f} s, {one.knobs} knobs",
        f"  tracker {one.tracker_hz:.1f} Hz, the marble missing in {one.missing} rows; stamps at least "
        f"{1e3 * one.tracker_age_s:.1f} ms old on arrival",
    ]
    if not math.isnan(one.following):
        lines.append(
            f"  knobs within {one.following:.2g} rad of their commands (root mean square), "
            f"{1e3 * one.lag_s:.0f} ms behind; stamps at least "
            f"{1e3 * one.joint_age_s:.1f} ms old on arrival"
        )
    for who, age in (("tracker", one.tracker_age_s), ("arms", one.joint_age_s)):
        if age < 0.0 or age > _CLOCKS_S:
            lines.append(
                f"  the clock of the {who} differs from the rig's by about {age:+.3f} s: synchronise them"
            )
    if one.stop:
        lines.append(f"  stopped: {one.stop}")
    return lines


def _period(text: str) -> float:
    seconds = float(text)
    if not 0.0 < seconds <= 10.0:
        raise argparse.ArgumentTypeError(f"expected more than 0 and at most 10 s, found {text}")
    return seconds
