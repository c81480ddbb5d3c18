"""Figures of the page, from the experiments to their files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.paper import figures, networks
from irt.paper.setting import PAPERS_TRIALS, Setting
from irt.paper.simulated import Experiment1
from irt.paper.standin import PAPERS_TABLE, Experiment2
from irt.paper.symmetry import floor, symmetry
from irt.tuning.iterate import Tuner

Array = NDArray[np.float64]

#: Rows of Figs. 3 and 7.
_ITERATIONS = (0, 1, 2, 5, 20)


def fig3(folder: Path, first: Experiment1) -> None:
    """Draw two starts of one target by the paper's method, and IRT+ on the same target."""
    setting, chosen = first.setting, _lively(first)
    target = first.trials.observed[chosen]
    tuner = _papers_tuner(setting)
    starts = first.trials.start[[chosen, (chosen + 1) % len(first.truth)]]
    trace = tuner.iterate(starts, [target], max(_ITERATIONS), threads=setting.threads)
    columns = [
        (
            f"IRT, start {start + 1}",
            target,
            _proposals(setting, setting.drive.parameters(trace.scaled[:, start]), "iteration"),
        )
        for start in range(2)
    ]
    columns.append(("IRT+", target, _proposals(setting, first.held["irt+"].parameters[chosen], "rollout")))
    figures.plot_observations(folder / "fig3.png", columns)


def fig4(folder: Path, first: Experiment1) -> None:
    """Draw raw parameter errors, and errors in the combinations that can be identified."""
    under = floor(first.setting.drive, first.truth, first.setting.seed)
    figures.plot_errors(
        folder / "fig4.png",
        {name: first.parameter_error(held) for name, held in first.held.items()},
        "mean absolute parameter error",
        floor=(under.parameters, "floor by symmetry"),
        logarithmic=False,
        papers=[(5, 0.10, "paper, IRT: around 10 %")],
    )
    figures.plot_errors(
        folder / "fig4-combinations.png",
        {name: first.combination_error(held) for name, held in first.held.items()},
        "mean absolute error of the combinations",
        floor=(under.combinations, "floor by symmetry"),
    )


def fig5(folder: Path, first: Experiment1) -> None:
    """Draw state errors: newest proposals of IRT as in the paper, best ones of the other methods."""
    states = {name: held.mae for name, held in first.held.items()}
    figures.plot_errors(folder / "fig5.png", states, "mean absolute state error")
    pretraining = {name: count["pretraining_rollouts"] for name, count in first.as_dict()["methods"].items()}
    figures.plot_pretraining(folder / "fig5-pretraining.png", states, pretraining)


def fig6(folder: Path, first: Experiment1) -> None:
    """Draw ten traces of the parameters to one target."""
    setting, chosen = first.setting, _lively(first)
    starts = np.random.default_rng([setting.seed, 6]).random((PAPERS_TRIALS, first.truth.shape[1]))
    observed = [first.trials.observed[chosen]]
    rows = [_papers_tuner(setting)]
    titles = ["as in the paper"]
    shipped = networks.shipped(setting)
    if shipped is not None:
        rows.append(Tuner(setting.drive, shipped.network, joint=True))
        titles.append("as shipped")
    traces = [
        tuner.iterate(starts, observed, 20, threads=setting.threads).scaled.swapaxes(0, 1) for tuner in rows
    ]
    truth = setting.drive.scaled(first.truth[chosen])
    figures.plot_evolution(folder / "fig6.png", np.array(traces), truth, titles)


def fig7(folder: Path, second: Experiment2) -> None:
    """Draw a success and a failure of the paper's method on rigs, and IRT+ on both."""
    setting, held = second.setting, second.random["irt-paper"]
    # Relative to the error of a marble at rest: a board on which nothing rolls is no success.
    rest = np.abs(second.trials.observed).mean(axis=(1, 2))
    success = int(np.argmin(held.mae[:, -1] / rest))
    failure = int(np.argmax(held.mae[:, -1]))
    columns = []
    for name, rig in (("success", success), ("failure", failure)):
        for method, title, count in (("irt-paper", "IRT", "iteration"), ("irt+", "IRT+", "rollout")):
            proposals = _proposals(setting, second.random[method].parameters[rig], count)
            columns.append((f"{title}, {name}", second.trials.observed[rig], proposals))
    figures.plot_observations(folder / "fig7.png", columns)


def fig8(folder: Path, second: Experiment2) -> None:
    """Draw state errors on rigs from the middle of the ranges."""
    figures.plot_errors(
        folder / "fig8.png",
        {name: held.mae for name, held in second.middle.items()},
        "mean absolute state error",
        papers=[
            (rollouts, mae, f"paper, {_PAPERS_NAMES[name]}") for name, (mae, rollouts) in PAPERS_TABLE.items()
        ],
    )


def symmetries(folder: Path, setting: Setting) -> None:
    """Draw the lower bound of all parameter errors."""
    figures.plot_symmetry(folder / "symmetry.png", symmetry(setting))


#: The figures by experiment.
OF_FIRST: dict[str, Callable[[Path, Experiment1], None]] = {
    "fig3": fig3,
    "fig4": fig4,
    "fig5": fig5,
    "fig6": fig6,
}
OF_SECOND: dict[str, Callable[[Path, Experiment2], None]] = {"fig7": fig7, "fig8": fig8}
_PAPERS_NAMES = {"cma-es": "CMA-ES", "direct": "direct", "irt-paper": "IRT"}


def _papers_tuner(setting: Setting) -> Tuner:
    return Tuner(setting.drive, networks.papers(setting, "difference").network, joint=True, both_orders=False)


def _proposals(setting: Setting, parameters: Array, count: str) -> list[tuple[str, Array]]:
    """Return proposals after some of the rollouts of one trial, with labels."""
    chosen = parameters[list(_ITERATIONS)]
    observed = setting.drive.simulate(chosen, setting.threads)[0]
    return [(f"{count} {row}", each) for row, each in zip(_ITERATIONS, observed, strict=True)]


def _lively(first: Experiment1) -> int:
    """Return the target with the largest motion along its lesser axis."""
    moved = np.abs(np.diff(first.trials.observed, axis=1)).sum(axis=1).min(axis=1)
    return int(np.argmax(moved))
