"""`irt demo`: the whole way on the rig that is shipped with the package."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from irt.fitting.fit import FitResult
    from irt.rig import Rig

NAME = "demo"
HELP = "tune the sample rig that is shipped, judge the result on runs held out, and write a page about it"

METHODS = ("irt+", "least-squares")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt demo`."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("irt-demo"),
        help="folder to write (default: irt-demo)",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="of the starts (default: 0)")
    parser.add_argument(
        "--starts", metavar="N", type=whole(1), default=8, help="starts of each method (default: 8)"
    )
    parser.epilog = "example:\n  irt demo --out demo --starts 4"


def run(args: argparse.Namespace) -> None:
    """Tune by both methods, evaluate on the rig held out, write the page, and name it."""
    from irt.cli.progress import progress_bar
    from irt.files import make_folder
    from irt.model import save_model
    from irt.report.tuning_report import write_tuning_report
    from irt.rig import load_rig
    from irt.tuning import tune

    folder = make_folder(args.out)
    rig, heldout = load_rig(data("labyrinth")), load_rig(data("labyrinth-heldout"))
    results = []
    for method in METHODS:
        with progress_bar() as progress:
            results.append(tune(rig, method, starts=args.starts, seed=args.seed, progress=progress))
    save_model(folder / "model.toml", results[0].model)
    page = write_tuning_report(
        folder,
        rig,
        results,
        heldout=heldout,
        title="The sample labyrinth, tuned",
        settings=_settings(args, rig, heldout, results),
    )
    print(f"model   {folder / 'model.toml'}")
    print(f"report  {page}")


def data(name: str) -> Path:
    """Return the folder of a rig that is shipped with the package."""
    return Path(__file__).resolve().parents[1] / "data" / name


def _settings(
    args: argparse.Namespace, rig: Rig, heldout: Rig, results: Sequence[FitResult]
) -> dict[str, str]:
    """Return what it takes to do the same again."""
    command = ["irt", "demo", "--out", f"{args.out}", "--seed", f"{args.seed}", "--starts", f"{args.starts}"]
    return {
        "command": shlex.join(command),
        "tuned to": _recordings(rig),
        "judged by": _recordings(heldout),
        "recorded by": "PyBullet, another engine than the one tuned (benches/record_pybullet.py)",
        "seed": f"{args.seed}: the starts of both methods",
        "time": ", ".join(f"{result.method} {result.seconds:.1f} s" for result in results),
    }


def _recordings(rig: Rig) -> str:
    names = ", ".join(recording.name for recording in rig.recordings)
    rows = sum(len(recording.knobs) for recording in rig.recordings)
    return f"{rig.path.name}, shipped with the package: {names} ({rows} rows)"
