"""The page of a reproduction: claims, floors, figures and tables, in Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.files import write_atomic
from irt.paper import claims, tables
from irt.paper.contenders import METHODS
from irt.paper.recorded import WINDOW_S, Judged
from irt.paper.setting import Setting
from irt.paper.simulated import Experiment1
from irt.paper.standin import FEW, PAPERS_TABLE, Experiment2
from irt.paper.symmetry import floor
from irt.report.words import versions

#: Methods that IRT+ must outperform at every number of rollouts.
_RIVALS = ("cma-es", "es", "direct", "npe")


@dataclass(frozen=True)
class Floor:
    """A promise of this project and the measured value."""

    what: str
    promise: str
    measured: str
    kept: bool


@dataclass(frozen=True)
class Results:
    """The contents of the page.

    Attributes
    ----------
    first, second
        The paper's experiments.
    ablations
        Experiment 1 with the other drive and the other damping, if requested.
    real
        A real recording, if given.
    """

    first: Experiment1
    second: Experiment2
    ablations: Mapping[str, Experiment1]
    real: Sequence[Judged]


def write_page(page: Path, command: str, results: Results) -> None:
    """Write the page, and its figures into the folder of its name.

    Raises
    ------
    IrtError
        If it cannot be written.
    """
    first, second = results.first, results.second
    lines = [
        "# The paper, reproduced and beaten",
        "",
        "Written by `irt reproduce`. Every number was measured by the command below; state errors are mean "
        "absolute errors in % of the board's long edge.",
        "",
        *_claims(first, second),
        *_floors(first, second),
        *_first(first, page.stem),
        *_second(second, page.stem),
        *_ablations(first, results.ablations),
        *_real(results.real),
        *_how(first.setting, command),
    ]
    write_atomic(page, "\n".join(lines) + "\n")


def floors(first: Experiment1, second: Experiment2) -> Iterator[Floor]:
    """Yield this project's promises."""
    plus = first.held["irt+"]
    combined = first.combination_error(plus)
    under = floor(first.setting.drive, first.truth, first.setting.seed)
    for rollouts, most in ((5, 0.01), (20, 0.003)):
        mean = plus.mae[:, rollouts].mean()
        yield Floor(
            f"IRT+: mean state MAE after {rollouts} rollouts",
            f"below {100 * most:g} %",
            f"{100 * mean:.3f} %, worst {100 * plus.mae[:, rollouts].max():.2f} %",
            bool(mean < most),
        )
    yield Floor(
        "IRT+: mean error in the identifiable combinations after 5 rollouts",
        "below 2 %",
        f"{100 * combined[:, 5].mean():.3f} %, median {100 * np.median(combined[:, 5]):.2f} %; "
        f"{100 * combined[first.at_rim, 5].mean():.2f} % where the marble meets the rim, which shows the "
        f"observation scale; the least that any method can have is {100 * under.combinations:.2f} %",
        bool(combined[:, 5].mean() < 0.02),
    )
    yield Floor("IRT+: trials that diverge", "none", f"{first.diverged(plus)}", first.diverged(plus) == 0)
    for name in _RIVALS:
        if name in first.held:
            behind = (first.held[name].mae.mean(axis=0) <= plus.mae.mean(axis=0))[1:]
            times = "none" if not behind.any() else f"{int(behind.sum())} of {len(behind)}"
            yield Floor(
                f"IRT+ ahead of {METHODS[name].title} in mean state MAE at 1 to {len(behind)} rollouts",
                "always",
                f"behind at {times}",
                not behind.any(),
            )
    row = next(row for row in second.rows() if row.name == "irt+")
    papers = PAPERS_TABLE["irt-paper"][0]
    yield Floor(
        f"stand-in rigs, five parameters: median state MAE after {FEW} rollouts of IRT+",
        f"below the paper's {100 * papers:.2f} %",
        f"{100 * row.early[0]:.2f} % ({100 * row.early[1]:.2f} to {100 * row.early[2]:.2f})",
        row.early[0] < papers,
    )
    if second.diagnosed:
        full = float(np.median([one.full for one in second.diagnosed]))
        again = float(np.median([one.full_again for one in second.diagnosed]))
        given = float(np.median([one.oracle for one in second.diagnosed]))
        yield Floor(
            f"stand-in rigs after diagnosis: median state MAE of {len(second.diagnosed)}",
            "at most 1.0 %",
            f"{100 * full:.2f} %; {100 * again:.2f} % when the same drive is recorded again; "
            f"{100 * given:.2f} % with every hidden effect given",
            full <= 0.01,
        )


def _claims(first: Experiment1, second: Experiment2) -> Iterator[str]:
    yield "## Claim by claim"
    yield ""
    yield "| where | the paper says | | why |"
    yield "| --- | --- | --- | --- |"
    for claim in (*claims.of_experiment1(first), *claims.of_experiment2(second)):
        yield f"| {claim.place} | {claim.text} | **{claim.verdict}** | {claim.why} |"
    yield ""


def _floors(first: Experiment1, second: Experiment2) -> Iterator[str]:
    yield "## What this project promises"
    yield ""
    yield "| | promise | measured | |"
    yield "| --- | --- | --- | --- |"
    for one in floors(first, second):
        yield f"| {one.what} | {one.promise} | {one.measured} | {'kept' if one.kept else '**missed**'} |"
    yield ""
    yield from _beside_least_squares(first)
    yield ""


def _beside_least_squares(first: Experiment1) -> Iterator[str]:
    """Yield the comparison of least squares with IRT+."""
    plus, engine = first.held["irt+"].mae, first.engine
    for scipys in [first.held[name].mae for name in ("least-squares",) if name in first.held]:
        stretches = []
        for what, of in (("mean", np.mean), ("median", np.median)):
            better = np.flatnonzero(of(scipys, axis=0)[1:] <= of(plus, axis=0)[1:]) + 1
            stretches.append(f"in the {what} {_stretch(better, plus.shape[1] - 1)}")
        yield (
            "**scipy's least squares**, from random starts and restarted when it converges, is as good as "
            f"IRT+ or better at an equal number of rollouts {', '.join(stretches)}."
        )
        yield ""
    few = plus[: len(engine.mae), -1]
    verdict = "as good or better" if np.median(engine.mae) <= np.median(few) else "not as good"
    yield (
        f"**Least squares as `irt tune` runs it**, without a limit on rollouts (median "
        f"{np.median(first.engine_rollouts):,.0f}, on the first {len(engine.mae)} targets), ends at a median "
        f"state MAE of {100 * np.median(engine.mae):.2g} %, mean {100 * engine.mae.mean():.2g} %; IRT+ after "
        f"{plus.shape[1] - 1} rollouts at {100 * np.median(few):.2g} %, mean {100 * few.mean():.2g} %. Where "
        f"rollouts cost nothing it is {verdict}, and it needs no network: it is the default. IRT+ is for "
        "simulators whose rollouts are expensive."
    )


def _stretch(counts: NDArray[np.int64], most: int) -> str:
    """Describe a subset of 1 to `most` rollouts."""
    if not len(counts):
        return f"at none of 1 to {most} rollouts"
    if len(counts) == counts[-1] - counts[0] + 1:
        return f"from {counts[0]} to {counts[-1]} rollouts" if len(counts) > 1 else f"after {counts[0]}"
    return f"at {len(counts)} of {most} numbers of rollouts, first {counts[0]}, last {counts[-1]}"


def _first(first: Experiment1, folder: str) -> Iterator[str]:
    count = len(first.truth)
    yield f"## Experiment 1: {count} simulated targets (the paper: 10)"
    yield ""
    yield (
        "After n rollouts the error of a method is that of the best proposal that it has simulated; for "
        "the paper's IRT it is that of the newest one, as in the paper, and for direct prediction that of "
        "the only one. Bands are 95 % intervals of the mean."
    )
    yield ""
    for name, caption in (
        ("fig3", "Fig. 3: two starts, one target, and IRT+ on the same."),
        ("fig4", "Fig. 4: raw parameter error, and the part that the symmetry alone causes."),
        ("fig4-combinations", "The same in the combinations of parameters that a path identifies."),
        ("fig5", "Fig. 5: state error."),
        ("fig5-pretraining", "State error over all rollouts, including those of the pretraining."),
        ("fig6", "Fig. 6: parameters over the iterations of IRT, ten starts; dashed: the target's."),
        (
            "symmetry",
            "Along this line parameters change and the path hardly does, so no method can go below this "
            "floor. Medians and quartiles over targets.",
        ),
    ):
        yield f"![{caption}]({folder}/{name}.png)"
        yield ""
        yield f"*{caption}*"
        yield ""
    yield from tables.of_methods(first)
    yield ""


def _second(second: Experiment2, folder: str) -> Iterator[str]:
    yield f"## Experiment 2: {len(second.truths)} rigs of a stand-in laboratory"
    yield ""
    yield (
        "The paper's recordings are not public. A rigid-body simulation in PyBullet, independent of this "
        "package's simulator, takes their place. It has the effects that the paper names (anisotropic "
        "friction, motor delays that vary from command to command, an uneven marble), and also controller "
        "lag, parallax and camera noise; `irt.paper.laboratory` lists the sizes. It is not a copy of the "
        "paper's rig: how far the physics of that rig is from five parameters is not known."
    )
    yield ""
    yield from tables.table1(second)
    yield ""
    yield "Medians over the rigs with their 95 % intervals, from random proposals."
    yield ""
    for name, caption in (
        ("fig7", "Fig. 7: a success and a failure of the paper's method, and IRT+ on both."),
        ("fig8", "Fig. 8: state error from the middle of the ranges; crosses: the paper's Table 1."),
    ):
        yield f"![{caption}]({folder}/{name}.png)"
        yield ""
        yield f"*{caption}*"
        yield ""
    if second.diagnosed:
        yield (
            f"The first {len(second.diagnosed)} rigs of {len(second.truths)} were diagnosed from eight "
            "recordings each. Errors are those of free runs under the paper's drive. *True effects* is a "
            "model fitted with the effects that the rig has, except the delays that vary at random from "
            "command to command, which no model can predict. Where no effect was named, the table shows "
            "the verdict."
        )
        yield ""
        yield from tables.of_diagnoses(second.diagnosed)
        yield ""


def _ablations(first: Experiment1, ablations: Mapping[str, Experiment1]) -> Iterator[str]:
    yield "## What the paper leaves open, decided the other way"
    yield ""
    if not ablations:
        yield "Not measured (`--ablations N`)."
        yield ""
        return
    count = len(next(iter(ablations.values())).truth)
    yield (
        f"Experiment 1 again, on {count} targets each, once with the other reading of Eq. 3 (and networks "
        "trained for it), once with the other damping (and networks trained without damping, as in `irt "
        "tune`). Means in % after the given number of rollouts: state MAE in % of the edge, errors of "
        "combinations and parameters in % of their ranges."
    )
    yield ""
    yield from tables.of_ablations({"as above": first, **ablations})
    yield ""


def _real(real: Sequence[Judged]) -> Iterator[str]:
    yield "## A real recording"
    yield ""
    if not real:
        yield "None was given (`--real RIG`)."
        yield ""
        return
    yield (
        f"Mean error over windows of {WINDOW_S:g} s, on the runs used for tuning and on the last third, "
        "which was held out. IRT and IRT+ were not tried: they would need networks trained for these "
        "commands."
    )
    yield ""
    yield "| | tuned on | held out | rollouts |"
    yield "| --- | ---: | ---: | ---: |"
    for one in real:
        rollouts = f"{one.rollouts:,}" if one.rollouts else ""
        yield f"| {one.name} | {100 * one.tuned:.2f} % | {100 * one.heldout:.2f} % | {rollouts} |"
    yield ""


def _how(setting: Setting, command: str) -> Iterator[str]:
    yield "## How to repeat it"
    yield ""
    yield f"- command: {command}"
    yield f"- seed: {setting.seed}"
    for name, version in versions("torch").items():
        yield f"- {name}: {version}"
