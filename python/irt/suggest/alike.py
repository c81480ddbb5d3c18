"""Whether two models predict the same whatever is played: the one refitted to what the other does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from irt.fitting.problem import Problem
from irt.recording import Recording
from irt.residual import segments
from irt.rig import PARAMETERS, Rig
from irt.suggest.criterion import Criterion
from irt.suggest.excitations import Excitation

#: What a refit may leave of the difference of models that are alike: this share of the tracker's noise, or
#: what the engine's whole updates make of one motion at two speeds [board edges].
_ALIKE, _ENGINE = 0.03, 6e-5


def alike(criterion: Criterion, rig: Rig, pair: tuple[int, int], runs: Sequence[Excitation]) -> bool:
    """Whether the second hypothesis of a pair, refitted without noise, does what the first does in all runs.

    Slopes alone cannot tell: two models may lie far apart along what recordings leave open.
    """
    first, second = (criterion.hypotheses[index] for index in pair)
    paths = first.expected(runs, criterion.step_s, threads=criterion.threads).paths
    rows = len(runs[0].commands)
    stamps = criterion.stamps(rows)
    played = tuple(
        Recording(f"{number}", Path(f"{number}"), run.commands, path.reshape(rows, 2), stamps)
        for number, (run, path) in enumerate(zip(runs, paths, strict=True))
    )
    imagined = replace(rig, start="rest", recordings=played)
    problem = Problem.of(
        imagined,
        segments(imagined),
        effects=second.model.effects,
        time_scale=criterion.time_scale,
        noise=criterion.noise,
        threads=criterion.threads,
    )
    # From its own values, and from where the first one is: the way along what is left open may be long.
    common = len(PARAMETERS)
    points = np.stack([second.values, np.append(first.values[:common], second.values[common:])])
    left = [
        np.concatenate([one.ravel() for one in at.residuals]) for at in problem.refine(points, iterations=30)
    ]
    least = min(float(np.sqrt(np.nanmean(residual**2))) for residual in left)
    return least < max(_ALIKE * criterion.noise, _ENGINE)
