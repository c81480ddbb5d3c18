"""Measure the accuracy of IRT on many random pairs, as in the paper's experiment 1; print a Markdown table.

    python benches/irt_accuracy.py > table.md

Targets and start points are drawn uniformly from the paper's ranges and simulated under the paper's drive.
State errors are mean absolute errors in percent of the board's long edge, parameter errors in percent of the
ranges, each with its standard error over the trials. The shipped network is compared with one trained here as
in the paper: 10,000 fixed pairs, a constant learning rate, no noise.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.fitting.least_squares import least_squares
from irt.recording import Recording
from irt.rig import PARAMETERS, Rig
from irt.tuning.cache import SHIPPED
from irt.tuning.drive import Drive
from irt.tuning.iterate import Tuner
from irt.tuning.pairs import simulate_pairs
from irt.tuning.pretrain import pretrain
from irt.tuning.recipes import Recipe
from irt.tuning.tunenet import NetworkFile, TuneNet, load_network

Array = NDArray[np.float64]

ITERATIONS = (0, 1, 2, 5, 10, 20)
PAPERS_WAY = Recipe(dealing="once", schedule="constant", noise=(0.0, 0.0))


class Trials:
    """Random targets and start points under the paper's drive."""

    def __init__(self, count: int, seed: int) -> None:
        random = np.random.default_rng([seed, 2023])
        self.drive = Drive.paper()
        self.target = random.random((count, len(PARAMETERS)))
        self.start = random.random((count, len(PARAMETERS)))
        self.observed = self.drive.simulate(self.drive.parameters(self.target))

    def tune(self, network: TuneNet, *, both_orders: bool) -> tuple[Array, Array]:
        """Return state and parameter errors [%] after each of `ITERATIONS`, (6, trials) each."""
        tuner = Tuner(self.drive, network, joint=True, both_orders=both_orders)
        trace = tuner.iterate(self.start, self.observed, max(ITERATIONS))
        chosen = list(ITERATIONS)
        return 100 * trace.mae[chosen], 100 * np.abs(trace.scaled - self.target).mean(axis=2)[chosen]

    def least_squares(self, starts: int) -> tuple[Array, Array]:
        """Return state and parameter errors [%] of least squares, (trials,) each."""
        found = []
        for i, observed in enumerate(self.observed[0]):
            recording = Recording(f"trial-{i}", Path(f"trial-{i}.csv"), self.drive.runs[0].knobs, observed)
            rig = Rig(
                Path(), self.drive.board, self.drive.marble, "rest", dict(self.drive.ranges), (recording,)
            )
            result = least_squares(rig, starts=starts, seed=i)
            error = np.abs(self.drive.scaled(result.model.values) - self.target[i]).mean()
            found.append((100 * result.mae, 100 * error))
            print(f"\rleast squares {i + 1}/{len(self.target)}", end="", file=sys.stderr)
        print(file=sys.stderr)
        state, parameters = np.array(found).T
        return state, parameters


def table(columns: dict[str, tuple[Array, Array]]) -> Iterator[str]:
    """Yield the table's lines: a row for each iteration, two columns for each method."""
    yield "| iteration | " + " | ".join(f"{name}: state | parameters" for name in columns) + " |"
    yield "| ---: |" + " ---: | ---: |" * len(columns)
    for row, iteration in enumerate(ITERATIONS):
        cells = [with_error(errors[row]) for column in columns.values() for errors in column]
        yield f"| {iteration} | " + " | ".join(cells) + " |"


def with_error(errors: Array) -> str:
    """Return mean and standard error as text."""
    return f"{errors.mean():.2f} ± {errors.std(ddof=1) / np.sqrt(len(errors)):.2f}"


def describe(name: str, file: NetworkFile) -> str:
    """Return a description of a network with its loss."""
    about = file.metadata
    return (
        f"- {name}: {int(about['pairs']):,} pairs, {about['epochs']} epochs, "
        f"held-out loss {float(about['heldout_loss']):.4f} (`{about['command']}`)"
    )


def main(words: Sequence[str] | None = None) -> None:
    """Train, tune and print."""
    parser = argparse.ArgumentParser(description="Measure the accuracy of IRT on random pairs.")
    parser.add_argument("--trials", type=int, default=100, help="target and start pairs (default: 100)")
    parser.add_argument("--seed", type=int, default=0, help="of the trials (default: 0)")
    parser.add_argument("--starts", type=int, default=8, help="of least squares (default: 8)")
    args = parser.parse_args(words)
    trials = Trials(args.trials, args.seed)

    began = time.perf_counter()
    simulate_pairs(trials.drive, PAPERS_WAY.pairs, PAPERS_WAY.seed)
    simulated = time.perf_counter() - began
    with tempfile.TemporaryDirectory() as folder:
        command = "benches/irt_accuracy.py, the paper's way"
        papers = pretrain(trials.drive, Path(folder) / "papers.safetensors", PAPERS_WAY, command=command)
    trained = time.perf_counter() - began - simulated
    shipped = load_network(SHIPPED)
    columns = {
        "the paper's way": trials.tune(papers.network, both_orders=False),
        "shipped, one order": trials.tune(shipped.network, both_orders=False),
        "shipped, both orders": trials.tune(shipped.network, both_orders=True),
    }
    print("\n".join(table(columns)))
    began = time.perf_counter()
    state, parameters = trials.least_squares(args.starts)
    each = (time.perf_counter() - began) / args.trials
    print(
        f"\nLeast squares ends at {with_error(state)} and {with_error(parameters)}, in {each:.1f} s a trial "
        f"from {args.starts} starts. Over {args.trials} trials; errors in % of the edge and of the ranges.\n"
    )
    print(describe("the paper's way", papers))
    print(describe("shipped", shipped))
    print(f"- {PAPERS_WAY.pairs:,} pairs: {simulated:.1f} s to simulate, {trained:.0f} s in all to pretrain")


if __name__ == "__main__":
    main()
