"""Where the fit of an effect beside a hypothesis begins: at draws laid beside residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.hypotheses import PLACE
from irt.diagnosis.screen import ROWS, Screen, drawn_values

Array = NDArray[np.float64]

#: Rows of the windows in which draws are laid beside residuals: short ones, longer ones, whole segments.
HORIZONS: tuple[int | None, ...] = (ROWS, 60, None)
#: Draws of what an effect has besides a place that it shares with another.
MOVED = 64
#: A further effect must take away this share of what was left beyond noise.
WORTH = 0.3
#: Of them so many begin a fit.
LIKELIEST = 3

Report = Callable[[str], None]


def seeds(case: Case, parent: Fitted, names: Iterable[str], report: Report) -> dict[str, tuple[float, Array]]:
    """Return for each effect the largest share that a draw explains, and points to begin a fit at.

    In the order in which to try them: the best one in windows of each length, then as short windows have
    them. In longer ones the marble has gone astray, and what explains most there may be anything.
    """
    longest = max(len(segment.knobs) for segment in case.segments)
    lengths = sorted({min(longest, rows or longest) for rows in HORIZONS})
    screens = [Screen(case, parent, rows) for rows in lengths]
    points: dict[str, Array] = {}
    shares: dict[str, list[float]] = {}
    for name in names:
        report(" + ".join([*parent.effects, name]))
        draws = [screen.draws(name) for screen in screens]
        values = np.concatenate([_best(name, one.values) for one in draws])
        points[name] = np.concatenate([np.tile(parent.values, (len(values), 1)), values], axis=1)
        shares[name] = [float(one.explained[0]) for one in draws]
    ranked = [sorted(shares, key=lambda name: -shares[name][i]) for i in range(len(lengths))]
    order = dict.fromkeys([*(found[0] for found in ranked if found), *ranked[0]])
    return {name: (max(shares[name]), points[name]) for name in order}


def moved_in(case: Case, one: Fitted, name: str, other: str) -> tuple[tuple[str, ...], Array]:
    """Return the effects of a hypothesis with another at the place of one of them, and points to begin at.

    All else stays as the hypothesis has it; of draws of what the other has besides a place, those are points
    that leave least.
    """
    kept = [own for own in one.effects if own != name]
    values = dict(zip(one.names, one.values, strict=True))
    rest = [value for key, value in values.items() if not key.startswith(f"{name}.")]
    parameters = effect(other).required
    drawn = drawn_values(parameters, None, MOVED, case.seed)
    for axis, parameter in enumerate(parameters):
        if parameter.name in PLACE:
            drawn[:, axis] = values[f"{name}.{parameter.name}"]
    names = (*kept, other)
    tried = case.judge(names, np.concatenate([np.tile(rest, (len(drawn), 1)), drawn], axis=1))
    tried.sort(key=lambda fitted: fitted.loss(case.noise))
    return names, np.array([fitted.values for fitted in tried[:LIKELIEST]])


def _best(name: str, drawn: Array) -> Array:
    """Return the first draw, and where an effect has choices the first of each answer."""
    choices = [index for index, one in enumerate(effect(name).required) if one.is_choice]
    if not choices:
        return drawn[:1]
    _, first = np.unique(drawn[:, choices], axis=0, return_index=True)
    return np.asarray(drawn[np.sort(first)])
