"""Identifiability of the parameters: 95 % intervals, and sentences on what recordings do not determine.

A combination of parameters is flat if its 95 % interval spans half of its range or more: the recordings do
not determine it. The intervals of all parameters in a flat combination extend as far as the ranges allow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.engine import Engine
from irt.fitting import sentences
from irt.fitting.information import Information
from irt.fitting.problem import Problem
from irt.fitting.sentences import SMALL
from irt.model import Model, Parameter
from irt.rig import PARAMETERS
from irt.segments import Segment

Array = NDArray[np.float64]

#: Smallest value in logarithms, as a share of the largest allowed value.
SMALLEST = 1e-4
#: A parameter is unknown if the flat directions contain at least this share of its axis.
UNKNOWN = 0.9


def informed(
    model: Model,
    segments: Sequence[Segment],
    noise: float,
    *,
    engine: Engine = "rolling",
    threads: int | None = None,
) -> Information:
    """Return the information of recordings about the parameters of a model.

    Works for the model of any method: if it is not the best fit, the intervals also contain the linearised
    best fit.

    Parameters
    ----------
    model : Model
        The tuned model; its effects are held fixed.
    segments : sequence of Segment
        The segments that it was tuned to.
    noise : float
        The tracker's standard deviation [board edges]; residuals are weighted by their own scale if that is
        larger.
    engine, threads
        As for `irt.rollouts`.
    """
    stamped = segments[0].durations is not None
    asked = Problem.of(
        model,
        segments,
        time_scale=model.parameters["time_scale"].value if stamped else None,
        engine=engine,
        threads=threads,
    )
    return Information.of(asked, model.values, asked.inform(model.values, noise))


def with_intervals(information: Information) -> dict[str, Parameter]:
    """Return all parameters by name; those that were estimated have 95 % intervals."""
    low, high = intervals(information)
    parameters = {}
    for index, name in enumerate(information.names):
        ends = (float(low[index]), float(high[index])) if information.free[index] else ()
        parameters[name] = Parameter(float(information.values[index]), *ends)
    return parameters


def unidentifiable(information: Information) -> tuple[str, ...]:
    """Return a sentence for each unidentifiable combination."""
    return sentences.unidentifiable(information, *intervals(information))


def intervals(information: Information) -> tuple[Array, Array]:
    """Return the ends of the 95 % intervals, (n,) each, in the parameters' own units."""
    values, widths = information.values, information.widths
    margin = np.array([information.margin(axis) for axis in np.eye(len(values))]) * widths
    offset = information.offset @ information.directions * widths
    low, high = values + np.minimum(offset, 0.0) - margin, values + np.maximum(offset, 0.0) + margin
    if information.flat.any():
        furthest_low, furthest_high = _reach(information)
        involved = furthest_low < furthest_high
        low = np.where(involved, np.maximum(low + furthest_low - values, information.ranges[:, 0]), low)
        high = np.where(involved, np.minimum(high + furthest_high - values, information.ranges[:, 1]), high)
        # An effect's parameter may have either sign, which logarithms cannot represent.
        held = np.linalg.norm(information.directions[information.flat], axis=0)
        unknown = (held > UNKNOWN) & (np.arange(len(values)) >= len(PARAMETERS))
        low = np.where(unknown, information.ranges[:, 0], low)
        high = np.where(unknown, information.ranges[:, 1], high)
    # Friction, time scale and observation scale are positive, and a fit does not change the sign of a gear.
    one_sided = np.arange(len(values)) < len(PARAMETERS)
    low = np.where(one_sided & (values >= 0.0), np.maximum(low, 0.0), low)
    high = np.where(one_sided & (values < 0.0), np.minimum(high, 0.0), high)
    return np.maximum(low, information.allowed[:, 0]), np.minimum(high, information.allowed[:, 1])


def _reach(information: Information) -> tuple[Array, Array]:
    """Return the lowest and highest values along the flat directions within all ranges: two (n,) arrays.

    The symmetries of the motion change logarithms linearly, so the allowed moves form a polytope in
    logarithms.
    """
    values, free = information.values, information.free
    sign = np.where(values < 0.0, -1.0, 1.0)
    ends = np.sort(np.maximum(information.ranges * sign[:, None], 0.0), axis=1)
    size = np.maximum(np.abs(values), SMALL * ends[:, 1])
    room = np.log(np.maximum(ends, SMALLEST * ends[:, 1:]) / size[:, None])
    room = np.stack([np.minimum(room[:, 0], 0.0), np.maximum(room[:, 1], 0.0)], axis=1)
    moves = (information.directions[information.flat] * information.widths * sign / size).T[free]
    furthest = np.zeros((2, len(values)))
    furthest[:, free] = _furthest(moves, room[free])
    reached = size * np.exp(furthest)
    # Logarithms diverge as a parameter vanishes.
    reached = np.where(reached <= 2.0 * SMALLEST * ends[:, 1], 0.0, reached)
    low, high = np.sort(sign * np.where(furthest == 0.0, np.abs(values), reached), axis=0)
    return np.minimum(low, values), np.maximum(high, values)


def _furthest(moves: Array, room: Array) -> Array:
    """Return the least and largest of each row of moves (f, k) @ w with all within room (f, 2): (2, f)."""
    from scipy.optimize import linprog  # noqa: PLC0415

    limits, ends = np.concatenate([-moves, moves]), np.concatenate([-room[:, 0], room[:, 1]])

    def most(along: Array, end: float) -> float:
        found = linprog(-along, limits, ends, bounds=(None, None))
        # If the solver fails, assume the end of the range.
        return float(-found.fun) if found.success else end

    lowest = [-most(-one, -low) for one, (low, _) in zip(moves, room, strict=True)]
    highest = [most(one, high) for one, (_, high) in zip(moves, room, strict=True)]
    return np.array([lowest, highest])
