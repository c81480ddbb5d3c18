"""`irt evaluate`: measure a model's prediction error on recordings."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from irt.cli.inputs import positive

if TYPE_CHECKING:
    from collections.abc import Iterator

    from irt.residual import Errors, Evaluation, RunEvaluation

NAME = "evaluate"
HELP = "measure a model's prediction error on recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `irt evaluate`."""
    parser.add_argument("model", metavar="MODEL", type=Path, help="a model.toml, as `irt tune` writes it")
    parser.add_argument("rig", metavar="RIG", type=Path, help="a folder of recordings (*.csv)")
    parser.add_argument(
        "--window",
        metavar="SECONDS",
        type=positive,
        default=2.0,
        help="length of a window; its start state is estimated from the rows before it: four, or with stamps "
        "those of 0.13 s if these are more (default: 2)",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("irt-evaluate"),
        help="folder for evaluation.json and evaluation.svg (default: irt-evaluate)",
    )
    parser.epilog = "example:\n  irt evaluate model.toml my-rig --window 2"


def run(args: argparse.Namespace) -> None:
    """Evaluate the model, print the errors of each run, and write them and a plot."""
    import numpy as np

    from irt.cli.inputs import TIME_UNKNOWN, results_folder
    from irt.files import write_atomic
    from irt.model import load_model
    from irt.residual import evaluate
    from irt.rig import load_rig

    model = load_model(args.model)
    rig = load_rig(args.rig)
    # This loads matplotlib: a file that cannot be read is named before.
    from irt.report.plots import plot_evaluation

    folder = results_folder(args.out, ("evaluation.json", "evaluation.svg"))
    evaluation = evaluate(model, rig.recordings, args.window)
    for line in _table(evaluation):
        print(line)
    for run in evaluation.runs:
        gone = np.flatnonzero(np.isnan(run.free_prediction[:, 0]))
        if run.free_run is not None and len(gone) > 0:
            print(f"\n{run.recording}: the predicted marble falls; rows from {gone[0]} on do not count")
    if evaluation.window_length_rows is not None:
        print(f"\n{TIME_UNKNOWN}")
    written = {"model": f"{args.model}", "rig": f"{args.rig}", **evaluation.as_dict()}
    write_atomic(folder / "evaluation.json", json.dumps(written, indent=2, allow_nan=False) + "\n")
    plot_evaluation(folder / "evaluation.svg", evaluation, rig.recordings)
    print(f"\nwrote {folder / 'evaluation.json'} and {folder / 'evaluation.svg'}")


def _table(evaluation: Evaluation) -> Iterator[str]:
    """Yield the lines of the tables: a row for each run and one for all runs."""
    runs: list[tuple[str, RunEvaluation | Evaluation]] = [(run.recording, run) for run in evaluation.runs]
    runs.append(("all runs", evaluation))
    width = max(len(name) for name, _ in runs)
    if evaluation.free_run is not None:
        windows = evaluation.windows
        yield "errors in % of the board's long edge"
        yield f"{'':{width}}               {'free run':^16}   {windows:^16}".rstrip()
        yield f"{'run':{width}}   rows   lost    mean largest      mean largest"
        for name, run in runs:
            rows, lost = (run.free_run.rows, run.free_run.lost) if run.free_run is not None else (0, 0)
            yield f"{name:{width}} {rows:6} {lost:6} {_percent(run.free_run)}   {_percent(run.windowed)}"
    if evaluation.tilt is None:
        return
    if evaluation.free_run is not None:
        yield ""
    yield "mean error of the tilt predicted from commands, and of the marble under the measured tilt"
    played = f"{evaluation.windows}, played"
    yield f"{'run':{width}}   about x    about y   {played}"
    for name, run in runs:
        x, y = (None, None) if run.tilt is None else (run.tilt.mae_x_rad, run.tilt.mae_y_rad)
        marble = "-" if run.played is None else f"{100 * run.played.mae:.2f} %"
        yield f"{name:{width}} {_milliradians(x)} {_milliradians(y)}   {marble:>{len(played)}}"


def _percent(errors: Errors | None) -> str:
    if errors is None:
        return f"{'-':>7} {'-':>7}"
    return f"{100 * errors.mae:7.2f} {100 * errors.max:7.2f}"


def _milliradians(error: float | None) -> str:
    return f"{'-':>10}" if error is None else f"{1000 * error:5.2f} mrad"
