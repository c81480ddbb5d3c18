"""`irt pretrain`: simulate pairs and train the tuning network."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from irt.cli.inputs import whole
from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.fitting.fit import Progress
    from irt.tuning.drive import Drive

NAME = "pretrain"
HELP = "simulate pairs of parameter sets and train the tuning network on them"

METHODS = ("irt", "irt+", "direct")
#: Pairs of a full irt+ training, as for the bundled network.
_SAMPLES = 5_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt pretrain`."""
    parser.add_argument(
        "--method", choices=METHODS, default=METHODS[0], help=f"method to train for (default: {METHODS[0]})"
    )
    parser.add_argument(
        "--pairs",
        metavar="N",
        type=whole(1),
        help=f"training pairs (default: 10000; for irt+, which uses each once or twice, {_SAMPLES})",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("tunenet.safetensors"),
        help="network file to write; its loss curve goes beside it (default: tunenet.safetensors)",
    )
    parser.add_argument(
        "--epochs",
        metavar="N",
        type=whole(1),
        help="passes over the pairs; irt and direct only (default: 200)",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="random seed (default: 0)")
    drive = parser.add_mutually_exclusive_group()
    drive.add_argument(
        "--rig",
        metavar="RIG",
        type=Path,
        help="train for the commands recorded in this folder (default: the paper's drive)",
    )
    drive.add_argument(
        "--literal-drive", action="store_true", help="use the paper's Eq. 3 literally: 1/40 of a period"
    )
    parser.add_argument(
        "--engine", choices=("rolling", "rapier"), default="rolling", help="the simulator (default: rolling)"
    )
    parser.add_argument(
        "--resume", action="store_true", help="resume from the checkpoint of an interrupted training"
    )
    parser.add_argument(
        "--threads", metavar="N", type=whole(1), help="simulator threads (default: one per core)"
    )
    parser.add_argument(
        "--device", metavar="D", help="torch device: cpu, cuda, mps (default: the fastest available)"
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help='simulate on an existing Ray cluster ("auto" finds a local one); the network is the same',
    )
    parser.epilog = (
        "examples:\n"
        "  irt pretrain --pairs 20000 --out tunenet.safetensors\n"
        "  irt pretrain --method irt+ --out steps.safetensors   15 minutes on one core"
    )


def run(args: argparse.Namespace) -> None:
    """Train the network, write it and its loss curve, and print a summary."""
    from irt.cli.progress import progress_bar
    from irt.extras import require
    from irt.tuning.tensors import checkpoint_path

    require("torch", "irt pretrain")
    began = time.perf_counter()
    try:
        with progress_bar() as progress:
            lines, plot = (_streamed if args.method == "irt+" else _dealt)(args, progress)
    except KeyboardInterrupt:
        if (checkpoint := checkpoint_path(args.out)).exists():
            again = f"{_command(args)} --out {shlex.quote(str(args.out))} --resume"
            print(f"irt: {checkpoint} holds the training so far; resume with: {again}", file=sys.stderr)
        raise
    for line in lines:
        print(line)
    print(f"time      {time.perf_counter() - began:.0f} s")
    print(f"\nwrote {args.out} and {plot}")


def _dealt(args: argparse.Namespace, progress: Progress) -> tuple[list[str], Path]:
    """Train the network of irt or of direct prediction, on pairs that are reshuffled each epoch."""
    from irt.report.plots import plot_loss
    from irt.tuning.pretrain import pretrain
    from irt.tuning.recipes import Recipe
    from irt.workers.choice import make_workers

    task: Literal["difference", "parameters"] = "parameters" if args.method == "direct" else "difference"
    recipe = Recipe(pairs=args.pairs or 10_000, epochs=args.epochs or 200, seed=args.seed, task=task)
    workers = None if args.cluster is None else make_workers(cluster=args.cluster)
    file = pretrain(_drive(args), args.out, recipe, **_options(args), progress=progress, workers=workers)
    plot = args.out.with_name(f"{args.out.stem}-loss.svg")
    plot_loss(plot, file.training, file.heldout)
    return [
        f"pairs     {recipe.pairs} training, {max(1, recipe.pairs // 10)} held out",
        f"loss      {file.training[-1]:.5f} training, {file.heldout[-1]:.5f} held out",
        f"device    {file.metadata['device']}",
    ], plot


def _streamed(args: argparse.Namespace, progress: Progress) -> tuple[list[str], Path]:
    """Train the network of irt+ on pairs that are simulated during training."""
    from irt.report.plots import plot_likelihood
    from irt.tuning.recipes import Streamed
    from irt.tuning.streaming import train_steps

    for option in ("epochs", "cluster"):
        if getattr(args, option) is not None:
            raise IrtError(f"--{option} belongs to --method irt or direct; leave it out")
    recipe = Streamed(samples=args.pairs or _SAMPLES, seed=args.seed)
    file = train_steps(_drive(args), args.out, recipe, **_options(args), progress=progress)
    plot = args.out.with_name(f"{args.out.stem}-loss.svg")
    plot_likelihood(plot, file.losses)
    return [
        f"pairs     {file.metadata['samples']} training, {file.metadata['rollouts']} rollouts",
        f"loss      {file.losses[-1]:.3f} nats per coordinate, on pools not trained on yet",
        f"device    {file.metadata['device']}",
    ], plot


def _options(args: argparse.Namespace) -> dict[str, Any]:
    from irt.tuning.pretrain import checked_device

    device = None if args.device is None else checked_device(args.device)
    return {"resume": args.resume, "command": _command(args), "device": device, "threads": args.threads}


def _drive(args: argparse.Namespace) -> Drive:
    from irt.rig import load_rig
    from irt.tuning.cache import need
    from irt.tuning.drive import Drive

    if args.rig is not None:
        return need(load_rig(args.rig), args.engine).network_drive
    return Drive.paper(engine=args.engine, literal=args.literal_drive)


def _command(args: argparse.Namespace) -> str:
    """Return the command that trains the same network again, without its output path."""
    words = ["irt", "pretrain", *(["--method", args.method] if args.method != METHODS[0] else [])]
    for name in ("pairs", "epochs"):
        words += [f"--{name}", getattr(args, name)] if getattr(args, name) is not None else []
    words += ["--seed", args.seed, "--engine", args.engine]
    words += ["--rig", args.rig] if args.rig is not None else []
    words += ["--literal-drive"] if args.literal_drive else []
    return shlex.join(str(word) for word in words)
