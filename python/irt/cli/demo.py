"""`irt demo`: tune and diagnose the bundled example rig."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import whole

if TYPE_CHECKING:
    from collections.abc import Iterator

    from irt.diagnosis import Diagnosis
    from irt.fitting.fit import FitResult
    from irt.rig import Rig

NAME = "demo"
HELP = "tune and diagnose the bundled example rig, and write a report of each (under a minute)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt demo`."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("irt-demo"),
        help="folder to write (default: irt-demo)",
    )
    parser.add_argument("--seed", metavar="S", type=whole(0), default=0, help="random seed (default: 0)")
    parser.epilog = "example:\n  irt demo --out demo"


def run(args: argparse.Namespace) -> None:
    """Tune, diagnose, print the findings and the paths of the reports."""
    from irt.cli.progress import progress_bar
    from irt.diagnosis import diagnose
    from irt.files import make_folder, write_atomic
    from irt.report.diagnosed import write_diagnosis
    from irt.rig import load_rig
    from irt.tuning import tune

    # Before the work, so that an unwritable folder fails at once.
    folder, tuned = make_folder(args.out), make_folder(args.out / "tuned")
    # The recordings too, so that the other verbs can be tried on them.
    example = data("demo-rig")
    recordings = make_folder(folder / example.name)
    for path in example.iterdir():
        write_atomic(recordings / path.name, path.read_bytes())
    rig = load_rig(recordings)
    with progress_bar() as progress:
        result = tune(rig, "least-squares", seed=args.seed, progress=progress)
    tuning_page = _write_tuning(tuned, rig, result, args)
    with progress_bar() as progress:
        found = diagnose(rig, seed=args.seed, progress=progress)
    page = write_diagnosis(folder, rig, found)
    for line in (*_answer(rig, result, found), ""):
        print(line)
    print(f"recordings {recordings}\ntuning     {tuning_page}\ndiagnosis  {page}")


def data(name: str) -> Path:
    """Return the folder of a bundled rig."""
    return Path(__file__).resolve().parents[1] / "data" / name


def _write_tuning(folder: Path, rig: Rig, result: FitResult, args: argparse.Namespace) -> Path:
    """Write the tuned model and its report, and return the report's path."""
    from irt.model import save_model
    from irt.report.tuning_report import write_tuning_report

    save_model(folder / "model.toml", result.model)
    return write_tuning_report(
        folder,
        rig,
        [result],
        title="The example rig, tuned",
        settings={
            "command": shlex.join(["irt", "demo", "--out", f"{args.out}", "--seed", f"{args.seed}"]),
            "recorded by": "PyBullet, another engine than the tuned one (benches/record_demo.py)",
            "seed": f"{args.seed}",
            "time": f"{result.seconds:.1f} s",
        },
    )


def _answer(rig: Rig, result: FitResult, found: Diagnosis) -> Iterator[str]:
    """Yield the summary and a table of errors."""
    from irt.fitting.robust import mean_absolute
    from irt.report.tuning_report import untuned
    from irt.report.words import percent
    from irt.residual import evaluate

    yield found.summary
    rows = sum(len(recording.knobs) for recording in rig.recordings)
    yield f"\nmean error over {len(rig.recordings)} runs ({rows} rows), in % of the board's long edge"
    errors = {
        "untuned, parameters in the middle of their ranges": evaluate(untuned(rig), rig.recordings).mae,
        "tuned, five parameters": evaluate(result.model, rig.recordings).mae,
        "tuned, on held-out runs": found.base_heldout_mae,
        "diagnosed, on held-out runs": found.final_heldout_mae,
        "tracker noise": mean_absolute(found.noise),
    }
    width = max(map(len, errors))
    yield from (f"  {name:<{width}}  {percent(error):>7}" for name, error in errors.items())
