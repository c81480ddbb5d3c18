"""`irt reproduce`: repeat the paper's experiments, figures and table, and compare with its numbers."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import whole

if TYPE_CHECKING:
    from irt.fitting.fit import Progress
    from irt.paper.setting import Setting

NAME = "reproduce"
HELP = "repeat the paper's experiments, with intervals, and write its figures, its table and a page"

ITEMS = ("fig3", "fig4", "fig5", "fig6", "fig7", "fig8", "table1", "symmetry")
_OF_FIRST, _OF_SECOND = ITEMS[:4], ITEMS[4:7]
#: Counts of a quick and of a full reproduction: targets, rigs, diagnosed rigs, targets per ablation.
_COUNTS = ("targets", "rigs", "diagnosed", "ablations")
_QUICK, _FULL = (100, 20, 3, 0), (500, 100, 20, 100)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt reproduce`."""
    parser.add_argument(
        "items",
        metavar="ITEM",
        nargs="*",
        choices=[*ITEMS, "all"],
        default="all",
        help=f"{', '.join(ITEMS)} or all (default: all, with the page)",
    )
    parser.add_argument(
        "--full",
        action="store_true",
        help=f"{_FULL[0]} targets, {_FULL[1]} rigs and {_FULL[2]} diagnoses instead of {_QUICK[0]}, "
        f"{_QUICK[1]} and {_QUICK[2]}, and {_FULL[3]} targets per ablation (an hour on two cores)",
    )
    parser.add_argument("--targets", metavar="N", type=whole(2), help="targets of Experiment 1")
    parser.add_argument("--rigs", metavar="N", type=whole(2), help="rigs of Experiment 2")
    parser.add_argument(
        "--diagnosed", metavar="N", type=whole(0), help="rigs of Experiment 2 to diagnose as well"
    )
    parser.add_argument(
        "--ablations",
        metavar="N",
        type=whole(0),
        help="targets per ablation: the other drive, and the other damping",
    )
    parser.add_argument(
        "--real", metavar="RIG", type=Path, help="a folder of real recordings; the last third is held out"
    )
    parser.add_argument(
        "--literal-drive", action="store_true", help="use the paper's Eq. 3 literally: 1/40 of a period"
    )
    parser.add_argument("--damping", action="store_true", help="damp the marble as PyBullet does by default")
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="random seed (default: 0)")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("irt-reproduce"),
        help="folder of the results; existing results are reused (default: irt-reproduce)",
    )
    parser.add_argument("--page", metavar="FILE", type=Path, help="page to write (default: DIR/paper.md)")
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="simulator threads (default: one per core)"
    )
    parser.epilog = (
        "examples:\n"
        "  irt reproduce fig5 --targets 20 --out paper     one figure and its numbers\n"
        "  irt reproduce --out paper                       all; the same command resumes after Ctrl-C\n"
        "  irt reproduce --full --page docs/paper.md --out paper-full"
    )


def run(args: argparse.Namespace) -> None:
    """Run the needed experiments, draw the figures, and print the tables."""
    from irt.cli.progress import progress_bar
    from irt.extras import require
    from irt.files import make_folder
    from irt.paper.setting import Setting

    require("torch", "irt reproduce")
    counts = _counts(args)
    setting = Setting(
        out=make_folder(args.out),
        targets=counts["targets"],
        rigs=counts["rigs"],
        diagnosed=counts["diagnosed"],
        seed=args.seed,
        literal=args.literal_drive,
        damped=args.damping,
        threads=args.threads,
    )
    items = set(ITEMS) if "all" in args.items else set(args.items)
    page = args.page or args.out / "paper.md"
    try:
        with progress_bar() as progress:
            lines = _done(args, setting, items, page, progress)
    except KeyboardInterrupt:
        print(f"irt: finished work is kept in {args.out}; the same command resumes it", file=sys.stderr)
        raise
    for line in lines:
        print(line)


def _counts(args: argparse.Namespace) -> dict[str, int]:
    """Return the counts by name: the arguments, or the defaults where an argument is absent."""
    given = {name: getattr(args, name) for name in _COUNTS}
    usual = dict(zip(_COUNTS, _FULL if args.full else _QUICK, strict=True))
    return {name: usual[name] if given[name] is None else given[name] for name in _COUNTS}


def _done(
    args: argparse.Namespace, setting: Setting, items: set[str], page: Path, progress: Progress
) -> list[str]:
    """Run the experiments and write the items; return the lines to print."""
    import json

    from irt.extras import install_command
    from irt.files import make_folder, write_atomic
    from irt.paper import render, tables
    from irt.paper.ablations import ablations
    from irt.paper.contenders import available
    from irt.paper.page import Results, write_page
    from irt.paper.recorded import judge
    from irt.paper.simulated import experiment1
    from irt.paper.standin import experiment2

    folder = make_folder(page.with_suffix(""))
    lines = [] if "npe" in available() else [f"without neural posterior estimation: {install_command('sbi')}"]
    numbers = {}
    first = experiment1(setting, progress=progress) if items & set(_OF_FIRST) else None
    second = experiment2(setting, progress=progress) if items & set(_OF_SECOND) else None
    others = _counts(args)["ablations"] if items == set(ITEMS) else 0
    other = ablations(setting, others, progress) if others else {}
    real = judge(setting, args.real, progress) if args.real is not None else []
    if first is not None:
        for name in sorted(items & set(_OF_FIRST)):
            render.OF_FIRST[name](folder, first)
        numbers["experiment_1"] = first.as_dict()
        lines += [*tables.of_methods(first), ""]
    if second is not None:
        for name in sorted(items & set(render.OF_SECOND)):
            render.OF_SECOND[name](folder, second)
        numbers["experiment_2"] = second.as_dict()
        lines += [*tables.table1(second), "", *tables.of_diagnoses(second.diagnosed), ""]
    for name, switch in other.items():
        numbers[f"experiment_1, {name}"] = switch.as_dict()
    if "symmetry" in items:
        render.symmetries(folder, setting)
    if numbers:
        write_atomic(folder / "results.json", json.dumps(numbers, indent=1) + "\n")
    if first is None or second is None or items != set(ITEMS):
        return [*lines, f"wrote {folder}"]
    write_page(page, f"`{_command(args)}`", Results(first, second, other, real))
    return [*lines, f"wrote {page} and {folder}"]


def _command(args: argparse.Namespace) -> str:
    """Return the command that reproduces this run."""
    words = ["irt", "reproduce"]
    for name in ("full", "literal_drive", "damping"):
        words += [f"--{name.replace('_', '-')}"] if getattr(args, name) else []
    for name in (*_COUNTS, "real", "page"):
        words += [f"--{name}", f"{getattr(args, name)}"] if getattr(args, name) is not None else []
    return shlex.join([*words, "--seed", f"{args.seed}", "--out", f"{args.out}"])
