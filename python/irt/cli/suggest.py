"""`irt suggest`: the next run to record."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import for_a_fit, say_replaced, whole
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.fitting.fit import Progress
    from irt.model import Model
    from irt.rig import Rig

NAME = "suggest"
HELP = "design the next run: the one that best tells the remaining hypotheses apart"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt suggest`."""
    parser.add_argument("rig", metavar="RIG", type=Path, help="a folder of recordings (*.csv)")
    parser.add_argument(
        "--models",
        metavar="MODEL",
        type=Path,
        nargs="+",
        help="the folder that irt diagnose wrote; or model.toml of each hypothesis, all as probable, of "
        "which one alone is sharpened (default: diagnose the rig first, which takes a minute)",
    )
    parser.add_argument(
        "--out",
        metavar="CSV",
        type=Path,
        default=Path("suggest.csv"),
        help="the commands to play, with the marble's start in row 0 (default: suggest.csv)",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="of the search (default: 0)")
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="of the simulator (default: one for each core)"
    )
    parser.epilog = (
        "examples:\n"
        "  irt suggest my-rig --models diagnosed\n"
        "  irt suggest my-rig --models delay.toml lag.toml --out suggest.csv"
    )


def run(args: argparse.Namespace) -> None:
    """Design the run, write its commands, and say what it is for."""
    from irt.cli.progress import progress_bar
    from irt.files import atomic_path
    from irt.rig import load_rig
    from irt.suggestion import suggest

    rig = for_a_fit(load_rig(args.rig))[0].of_marbles()
    if args.out.resolve().parent == args.rig.resolve():
        raise IrtError(
            f"{args.out}: in the rig's folder it would be read as one of its recordings; name another place "
            "with --out"
        )
    say_replaced([args.out])
    # Opened beforehand: a diagnosis takes minutes, and a file that cannot be written is known at once.
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
    """Return what a diagnosis says, models, how probable each is, and the tracker's noise [board edges]."""
    from irt.diagnosis import diagnose
    from irt.fitting.problem import tracker_noise
    from irt.model import load_model
    from irt.report.diagnosed import load_plausible
    from irt.segments import segments

    if args.models is not None and any(path.is_dir() for path in args.models):
        if len(args.models) > 1:
            raise IrtError("--models: the folder of a diagnosis stands alone; name it, or model.toml files")
        left = load_plausible(args.models[0])
        return [left.summary], left.models, left.probabilities, left.noise
    if args.models is not None:
        models = [load_model(path) for path in args.models]
        return [], models, [1.0] * len(models), tracker_noise(segments(rig))
    diagnosis = diagnose(rig, seed=args.seed, threads=args.threads, progress=progress)
    models = [one.model for one in diagnosis.plausible]
    said = [*(f"warning: {one}" for one in diagnosis.warnings), diagnosis.summary]
    return said, models, [one.probability for one in diagnosis.plausible], diagnosis.noise
