"""Leave-one-run-out errors of tuned models on a rig.

    python benches/held_out_runs.py my-rig --window 1 --effect delay --effect lag --effect tilt_bias

prints mean absolute errors over windows, averaged over runs: of the marble predicted from the commands and,
with measured tilt, from that tilt; and of the tilt predicted from the commands.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from irt.fitting.least_squares import least_squares
from irt.model import Effect
from irt.residual import Evaluation, evaluate
from irt.rig import Rig, load_rig

COLUMNS = ("windows", "windows, tilt played", "tilt about x", "tilt about y")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rig", type=Path)
    parser.add_argument("--window", type=float, default=2.0, help="length of a window [s]")
    parser.add_argument("--effect", action="append", default=[], help="of the catalogue, added to the model")
    parser.add_argument("--starts", type=int, default=8, help="start points of each fit")
    args = parser.parse_args()
    rig = load_rig(args.rig)
    began = time.perf_counter()
    rows = [errors(held_out(rig, i, args)) for i in range(len(rig.recordings))]
    print(f"{'held out':<12}" + "".join(f"{title:>22}" for title in COLUMNS))
    for name, row in [*zip((one.name for one in rig.recordings), rows, strict=True), ("mean", mean(rows))]:
        print(f"{name:<12}" + "".join(f"{shown(value, i):>22}" for i, value in enumerate(row)))
    print(f"{time.perf_counter() - began:.1f} s")


def held_out(rig: Rig, index: int, args: argparse.Namespace) -> Evaluation:
    """Tune to all other runs, and evaluate on one run."""
    others = tuple(one for i, one in enumerate(rig.recordings) if i != index)
    effects = [Effect(name, {}) for name in args.effect]
    model = least_squares(replace(rig, recordings=others), effects=effects, starts=args.starts).model
    return evaluate(model, [rig.recordings[index]], args.window)


def errors(evaluation: Evaluation) -> list[float]:
    """Return the errors in the order of `COLUMNS`, NaN for missing ones."""
    marble = [np.nan if one is None else one.mae for one in (evaluation.windowed, evaluation.played)]
    tilt = evaluation.tilt
    angles = [None, None] if tilt is None else [tilt.mae_x_rad, tilt.mae_y_rad]
    return [*marble, *(np.nan if angle is None else angle for angle in angles)]


def mean(rows: list[list[float]]) -> list[float]:
    columns = [[value for value in column if not np.isnan(value)] for column in zip(*rows, strict=True)]
    return [float(np.mean(column)) if column else np.nan for column in columns]


def shown(value: float, column: int) -> str:
    if np.isnan(value):
        return "-"
    return f"{value:.4f} edges" if column < 2 else f"{1000 * value:.2f} mrad"


if __name__ == "__main__":
    main()
