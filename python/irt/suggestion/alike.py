"""Check whether two models make the same predictions: refit one to the predictions of the other."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.fitting.problem import Problem
from irt.recording import Recording
from irt.rig import PARAMETERS, Rig
from irt.segments import segments
from irt.suggestion.criterion import Criterion
from irt.suggestion.excitations import Excitation
from irt.suggestion.hypothesis import Hypothesis

Array = NDArray[np.float64]

_COMMON = len(PARAMETERS)
#: Largest difference between models that count as alike: a share of the tracker's noise, or rounding [edges].
_ALIKE, _ROUNDED = 0.01, 2e-5
#: Refinement of the time step at which a late command and an old picture give the same path. At the engine's
#: own step, the phase of a command within the step makes a difference.
_FINER = 16


def alike(criterion: Criterion, rig: Rig, pair: tuple[int, int], runs: Sequence[Excitation]) -> bool:
    """Whether the second hypothesis of a pair, refitted without noise, reproduces the first in all runs.

    Linearised predictions do not suffice, because two models may be far apart along unidentified directions.
    """
    first, second = (criterion.hypotheses[index] for index in pair)
    own = first.paths(runs, finer=_FINER, threads=criterion.threads)
    renamed = replace(second, values=np.append(first.values[:_COMMON], _renamed(first, second)))
    left = own - renamed.paths(runs, finer=_FINER, threads=criterion.threads)
    # The median, because rounding decides whether a marble just reaches a wall in a single run.
    same = float(np.median(np.sqrt((left**2).mean(axis=1)))) < _ROUNDED
    return same or _refits(criterion, rig, first, second, runs)


def _refits(
    criterion: Criterion, rig: Rig, first: Hypothesis, second: Hypothesis, runs: Sequence[Excitation]
) -> bool:
    """Whether a refit of the second hypothesis to the predictions of the first has no residuals."""
    paths = first.expected(runs, criterion.step_s, threads=criterion.threads).paths
    rows = len(runs[0].commands)
    stamps = criterion.stamps(rows)
    played = tuple(
        Recording(f"{number}", Path(f"{number}"), run.commands, path.reshape(rows, 2), stamps)
        for number, (run, path) in enumerate(zip(runs, paths, strict=True))
    )
    problem = Problem.of(
        replace(second.model, start="rest"),
        segments(replace(rig, start="rest", recordings=played)),
        effects=second.model.effects,
        time_scale=criterion.time_scale,
        noise=criterion.noise,
        held=second.held,
        threads=criterion.threads,
    )
    # From its own values and from those of the first, which may be far along unidentified directions.
    points = np.stack([second.values, np.append(first.values[:_COMMON], second.values[_COMMON:])])
    refitted = [np.concatenate(at.residuals) for at in problem.refine(points, iterations=30)]
    least = min(float(np.sqrt(np.nanmean(residual**2))) for residual in refitted)
    return least < max(_ALIKE * criterion.noise, _ROUNDED)


def _renamed(first: Hypothesis, second: Hypothesis) -> Array:
    """Return values of the second model's effects, taken from the first where parameters have equal units."""
    rest = dict(zip(first.names[_COMMON:], first.values[_COMMON:].tolist(), strict=True))
    found = dict(zip(second.names[_COMMON:], second.values[_COMMON:].tolist(), strict=True))
    for name in [name for name in found if name in rest]:
        found[name] = rest.pop(name)
    for own in [one for one in second.effects if one not in first.effects]:
        own_units = _units(own, found)
        for other in [one for one in first.effects if one not in second.effects]:
            units = _units(other, rest)
            if list(own_units.values()) == list(units.values()):
                found |= dict(zip(own_units, [rest[name] for name in units], strict=True))
    return np.array(list(found.values()))


def _units(name: str, values: Container[str]) -> dict[str, str]:
    """Return the units of an effect's parameters in `values`, by ``effect.parameter``."""
    units = {f"{name}.{one.name}": one.unit for one in effect(name).parameters}
    return {key: unit for key, unit in units.items() if key in values}
