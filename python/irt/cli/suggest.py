"""`irt suggest`: design the next run to record."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import print_replaced, rows_for_fit, whole
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.fitting.fit import Progress
    from irt.model import Model
    from irt.rig import Rig

NAME = "suggest"
HELP = "design the next run: the one that best separates the remaining hypotheses"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt suggest`."""
    parser.add_argument("rig", metavar="RIG", type=Path, help="a folder of recordings (*.csv)")
    parser.add_argument(
        "--models",
        metavar="MODEL",
        type=Path,
        nargs="+",
        help="the folder written by irt diagnose, or a model.toml for each hypothesis, all equally probable; "
        "for a single model the run sharpens its parameters (default: diagnose the rig first, a minute)",
    )
    parser.add_argument(
        "--out",
        metavar="CSV",
        type=Path,
        default=Path("suggest.csv"),
        help="commands to play, with the marble's start in row 0 (default: suggest.csv)",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="random seed (default: 0)")
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="simulator threads (default: one per core)"
    )
    parser.epilog = (
        "examples:\n"
        "  irt suggest my-rig --models diagnosed\n"
        "  irt suggest my-rig --models delay.toml lag.toml --out suggest.csv"
    )


def run(args: argparse.Namespace) -> None:
    """Design the run, write its commands, and print its purpose."""
    from irt.cli.progress import progress_bar
    from irt.files import atomic_path
    from irt.rig import load_rig
    from irt.suggestion import suggest

    rig = rows_for_fit(load_rig(args.rig))[0].of_marbles()
    if args.out.resolve().parent == args.rig.resolve():
        raise IrtError(
            f"{args.out}: a file in the rig's folder would be read as a recording; choose another folder "
            "with --out"
        )
    print_replaced([args.out])
    # Opened before the diagnosis, which takes minutes, so that an unwritable file fails at once.
    with atomic_path(args.out) as beside, progress_bar() as progress:
        known, models, chances, noise = _hypotheses(rig, args, progress)
        found = suggest(
            rig,
            models,
            noise,
            probabilities=chances,
            seed=args.seed,
            threads=args.threads,
            progress=progress,
        )
        found.save(beside)
    for sentence in (*known, *found.sentences):
        print(sentence)
    print(f"\nwrote {args.out}: play it, put the recording into {args.rig}, and diagnose again")


def _hypotheses(
    rig: Rig, args: argparse.Namespace, progress: Progress
) -> tuple[list[str], list[Model], list[float], float]:
    """Return the lines to print, the models, their probabilities, and the tracker's noise [board edges]."""
    from irt.diagnosis import diagnose
    from irt.fitting.problem import tracker_noise
    from irt.model import load_model
    from irt.report.diagnosed import load_plausible
    from irt.segments import segments

    if args.models is not None and any(path.is_dir() for path in args.models):
        if len(args.models) > 1:
            raise IrtError("--models: expected one folder of a diagnosis, or model.toml files, not both")
        found = load_plausible(args.models[0])
        return [found.summary], found.models, found.probabilities, found.noise
    if args.models is not None:
        models = [load_model(path) for path in args.models]
        return [], models, [1.0] * len(models), tracker_noise(segments(rig))
    diagnosis = diagnose(rig, seed=args.seed, threads=args.threads, progress=progress)
    models = [one.model for one in diagnosis.plausible]
    said = [*(f"warning: {one}" for one in diagnosis.warnings), diagnosis.summary]
    return said, models, [one.probability for one in diagnosis.plausible], diagnosis.noise
