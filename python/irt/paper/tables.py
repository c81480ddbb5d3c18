"""The tables of a reproduction, as lines of Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from irt.paper.ablations import ABLATED
from irt.paper.contenders import METHODS
from irt.paper.setting import ROLLOUTS
from irt.paper.simulated import SHOWN, Experiment1
from irt.paper.standin import PAPERS_TABLE, Diagnosed, Experiment2

#: Numbers of rollouts for the comparison of drives.
_FEW = (0, 5, 20)


def of_methods(first: Experiment1) -> Iterator[str]:
    """Yield the tables of all methods: state error, errors in the combinations, diverged trials."""
    yield "State MAE in % of the edge: mean, and in brackets median and 95th percentile."
    yield ""
    yield from _by_rollouts(first, {name: 100 * held.mae for name, held in first.held.items()})
    yield ""
    yield (
        "Error in the identifiable combinations in % of their ranges, over all targets: mean, and in "
        "brackets median and 95th percentile."
    )
    yield ""
    yield from _by_rollouts(
        first, {name: 100 * first.combination_error(held) for name, held in first.held.items()}
    )
    yield ""
    yield (
        f"The same over the {first.at_rim.sum()} targets of {len(first.truth)} whose marble meets the rim, "
        "the only ones that show the observation scale."
    )
    yield ""
    at_rim = {name: 100 * first.combination_error(held)[first.at_rim] for name, held in first.held.items()}
    yield from _by_rollouts(first, at_rim)
    yield ""
    yield "Raw parameter error in % of the ranges: mean, and in brackets median and 95th percentile."
    yield ""
    yield from _by_rollouts(
        first, {name: 100 * first.parameter_error(held) for name, held in first.held.items()}
    )


def of_ablations(of: Mapping[str, Experiment1]) -> Iterator[str]:
    """Yield the errors of each method after few rollouts, by reversed choice."""
    shown = [f"{what}, {n}" for what in ("state MAE", "combinations", "parameters") for n in _FEW]
    yield f"| | targets | at the rim | method | {' | '.join(shown)} |"
    yield f"| --- | ---: | ---: | --- |{' ---: |' * len(shown)}"
    for name, first in of.items():
        for method in ABLATED:
            held = first.held[method]
            kinds = (held.mae, first.combination_error(held), first.parameter_error(held))
            cells = [_digits(100 * kind[:, n].mean()) for kind in kinds for n in _FEW]
            who = [name, f"{len(first.truth)}", f"{first.at_rim.sum()}", METHODS[method].title]
            yield f"| {' | '.join([*who, *cells])} |"


def table1(second: Experiment2) -> Iterator[str]:
    """Yield Table 1 beside the paper's: medians over the rigs, with 95 % intervals."""
    yield (
        "| method | paper: minimum | paper: rollouts | minimum state MAE | rollouts to reach it "
        f"| held after {ROLLOUTS} | best after 5 | ended worse than it began |"
    )
    yield "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    for row in second.rows():
        printed = PAPERS_TABLE.get(row.name)
        papers = ("", "") if printed is None else (f"{100 * printed[0]:.3g} %", f"{printed[1]}")
        cells = [
            METHODS[row.name].title,
            *papers,
            _percent(row.minimum),
            f"{row.rollouts[0]:.0f} ({row.rollouts[1]:.0f} to {row.rollouts[2]:.0f})",
            _percent(row.final),
            _percent(row.early),
            f"{row.failures} of {len(second.truths)}",
        ]
        yield f"| {' | '.join(cells)} |"


def of_diagnoses(diagnosed: list[Diagnosed]) -> Iterator[str]:
    """Yield the named effects of each diagnosis, its errors, and those of a model with the true effects."""
    yield (
        "| rig | named | plain, tuned to this run | plain, run again | diagnosed | diagnosed, run again "
        "| true effects | true effects, run again |"
    )
    yield "| ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: |"
    for rig, one in enumerate(diagnosed):
        errors = (one.plain, one.plain_again, one.full, one.full_again, one.oracle, one.oracle_again)
        named = ", ".join(one.names) or one.verdict
        yield f"| {rig} | {named} | {' | '.join(f'{100 * each:.2f} %' for each in errors)} |"


def _by_rollouts(first: Experiment1, errors: dict[str, NDArray[np.float64]]) -> Iterator[str]:
    yield f"| method | {' | '.join(f'{n}' for n in SHOWN)} | diverged |"
    yield f"| --- | {' | '.join('---:' for _ in SHOWN)} | ---: |"
    for name, trials in errors.items():
        cells = []
        for n in SHOWN:
            median, high = np.percentile(trials[:, n], [50, 95])
            cells.append(f"{_digits(trials[:, n].mean())} ({_digits(median)}; {_digits(high)})")
        diverged = first.diverged(first.held[name])
        yield f"| {METHODS[name].title} | {' | '.join(cells)} | {diverged} |"


def _digits(value: float) -> str:
    return f"{value:.3f}" if value < 0.1 else f"{value:.2f}" if value < 10 else f"{value:.1f}"


def _percent(interval: tuple[float, float, float]) -> str:
    middle, low, high = (100 * value for value in interval)
    return f"{middle:.2f} % ({low:.2f} to {high:.2f})"
