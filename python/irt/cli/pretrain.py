"""`irt pretrain`: simulate pairs and train the tuning network."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import whole

if TYPE_CHECKING:
    from irt.tuning.drive import Drive

NAME = "pretrain"
HELP = "simulate pairs of parameter sets and train the network that tunes by them"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt pretrain`."""
    parser.add_argument(
        "--pairs", metavar="N", type=whole(1), default=10_000, help="pairs to learn from (default: 10000)"
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("tunenet.safetensors"),
        help="the network to write, its loss curve beside it (default: tunenet.safetensors)",
    )
    parser.add_argument(
        "--epochs", metavar="N", type=whole(1), default=200, help="passes over the pairs (default: 200)"
    )
    parser.add_argument(
        "--seed", metavar="S", type=whole(0), default=0, help="of all that is random (default: 0)"
    )
    drive = parser.add_mutually_exclusive_group()
    drive.add_argument(
        "--rig",
        metavar="RIG",
        type=Path,
        help="train for the recordings of this folder (default: the paper's drive)",
    )
    drive.add_argument(
        "--literal-drive", action="store_true", help="the paper's Eq. 3 to the letter, a fortieth of a period"
    )
    parser.add_argument(
        "--engine", choices=("rolling", "rapier"), default="rolling", help="the simulator (default: rolling)"
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on from the checkpoint of a stopped training"
    )
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="of the simulator (default: one for each core)"
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help='simulate on an existing Ray cluster ("auto" finds a local one); the network is the same',
    )
    parser.epilog = "example:\n  irt pretrain --pairs 20000 --out tunenet.safetensors"


def run(args: argparse.Namespace) -> None:
    """Train the network, write it with its loss curve, and say what came out."""
    from irt.cli.progress import progress_bar
    from irt.report.plots import plot_loss
    from irt.tuning.pretrain import Recipe, checkpoint_path, pretrain
    from irt.workers.choice import make_workers

    began = time.perf_counter()
    try:
        with progress_bar() as progress:
            file = pretrain(
                _drive(args),
                args.out,
                Recipe(pairs=args.pairs, epochs=args.epochs, seed=args.seed),
                resume=args.resume,
                command=_command(args),
                threads=args.threads,
                progress=progress,
                workers=None if args.cluster is None else make_workers(cluster=args.cluster),
            )
    except KeyboardInterrupt:
        if (checkpoint := checkpoint_path(args.out)).exists():
            again = f"{_command(args)} --out {shlex.quote(str(args.out))} --resume"
            print(f"irt: {checkpoint} holds the training so far; go on with: {again}", file=sys.stderr)
        raise
    plot = args.out.with_name(f"{args.out.stem}-loss.svg")
    plot_loss(plot, file.training.numpy(), file.heldout.numpy())
    print(f"pairs     {args.pairs} to learn from, {max(1, args.pairs // 10)} held out")
    print(f"loss      {file.training[-1]:.5f} training, {file.heldout[-1]:.5f} held out")
    print(f"time      {time.perf_counter() - began:.0f} s on {file.metadata['device']}")
    print(f"\nwrote {args.out} and {plot}")


def _drive(args: argparse.Namespace) -> Drive:
    from irt.rig import load_rig
    from irt.tuning.cache import need
    from irt.tuning.drive import Drive

    if args.rig is not None:
        return need(load_rig(args.rig), args.engine).network_drive
    return Drive.paper(engine=args.engine, literal=args.literal_drive)


def _command(args: argparse.Namespace) -> str:
    """Return the command that makes the same network again, wherever it is written."""
    words = ["irt", "pretrain", "--pairs", args.pairs, "--epochs", args.epochs, "--seed", args.seed]
    words += ["--engine", args.engine]
    words += ["--rig", args.rig] if args.rig is not None else []
    words += ["--literal-drive"] if args.literal_drive else []
    return shlex.join(str(word) for word in words)
