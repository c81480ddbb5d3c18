"""From what recordings say of the values of one set of effects to a distribution that can be sampled.

The distribution agrees with the 95 % intervals of `irt.fitting.identifiability`. Along directions that the
recordings pin down it is normal, as wide as the intervals. Along the others it fills the ranges: parameters
change in proportion to powers of one factor, as along the symmetries of the motion, until one of them leaves
its range. A parameter that alone is not pinned down, or that is about zero, moves linearly there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from irt.fitting.identifiability import SMALLEST, UNKNOWN
from irt.fitting.information import CONFIDENCE, Information
from irt.fitting.sentences import SMALL
from irt.fitting.solution import Shrunk
from irt.model import LEAN
from irt.posterior import Component, Spread, rounded
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Half width of a 95 % interval in standard deviations.
NORMAL = float(ndtri(0.5 + CONFIDENCE / 2.0))
#: The least standard deviation [ranges]: of none there is no inverse.
_LEAST = 1e-12
#: Relative changes below this along directions that are not pinned down leave a parameter's bounds wide.
_NEGLIGIBLE = 0.05


def component(
    information: Information,
    effects: Sequence[str],
    *,
    probability: float = 1.0,
    covariance: Array | None = None,
    added: Array | None = None,
    widening: float = 1.0,
    renamed: Mapping[str, str] | None = None,
) -> Component:
    """Return the distribution of the values of a set of effects.

    Parameters
    ----------
    information : Information
        What the recordings say of its n parameters.
    effects : sequence of str
        The set.
    probability : float
        Of the set.
    covariance : (n, n) array, optional
        Of the parameters, by another likelihood, in their own units: along no direction is the distribution
        narrower than this one.
    added : (n, n) array, optional
        Covariance of an independent error, in the parameters' own units.
    widening : float
        By which standard deviations are multiplied along directions that are pinned down.
    renamed : mapping, optional
        Names of parameters that are other ones in a model.
    """
    known = _known(information, covariance, added, widening)
    linear, power = _flat(information)
    moved = np.abs(power).sum(axis=1) + (linear != 0.0).any(axis=1)
    low, high = _bounds(information, moved > _NEGLIGIBLE)
    linear = np.concatenate([known, linear], axis=1)
    power = np.concatenate([np.zeros_like(known), power], axis=1)
    parameters = {
        (renamed or {}).get(name, name): Spread(
            float(information.values[index]),
            float(low[index]),
            float(high[index]),
            rounded(linear[index]),
            rounded(power[index]),
        )
        if information.free[index]
        else Spread(float(information.values[index]))
        for index, name in enumerate(information.names)
    }
    return Component(probability, tuple(effects), parameters)


def _known(information: Information, covariance: Array | None, added: Array | None, widening: float) -> Array:
    """Return how parameters move with each z along directions that are pinned down, (n, k)."""
    known = ~information.flat
    directions = information.directions[known]
    # Where a method stopped beside the best fit, the interval reaches over both.
    reach = np.hypot(information.half_width[known], information.offset[known])
    factor = np.diag(np.maximum(widening * reach / NORMAL, _LEAST))
    shares = directions / information.widths
    if added is not None:
        factor = np.linalg.cholesky(factor**2 + shares @ added @ shares.T)
    if covariance is not None and np.isfinite(covariance).all():
        factor = _joined(factor, shares @ covariance @ shares.T)
    return np.asarray((directions * information.widths).T @ factor)


def _joined(factor: Array, covariance: Array) -> Array:
    """Return the factor of a normal distribution that is about as wide as both along every direction.

    Where the first is white, the axes of the second are axes of both: the wider one counts along each.
    """
    inverse = np.linalg.inv(factor)
    variance, axes = np.linalg.eigh(inverse @ covariance @ inverse.T)
    return np.asarray(factor @ axes * np.sqrt(np.maximum(variance, 1.0)))


def _flat(information: Information) -> tuple[Array, Array]:
    """Return how parameters move linearly, and by which powers, along directions that are not pinned down."""
    values, free = information.values, information.free
    directions = information.directions[information.flat]
    sign = np.where(values < 0.0, -1.0, 1.0)
    ends = np.sort(np.maximum(information.ranges * sign[:, None], 0.0), axis=1)
    size = np.maximum(np.abs(values), SMALL * np.maximum(ends[:, 1], 1e-300))
    moves = directions * information.widths * sign / size
    length = np.maximum(np.linalg.norm(moves, axis=1, keepdims=True), 1e-300)
    vanishing = np.abs(values) < size
    alone = np.abs(moves) > UNKNOWN * length
    # An effect's parameter may have either sign, and powers of a factor do not lead from one to the other.
    is_linear = vanishing | alone
    room = np.log(np.maximum(ends, SMALLEST * ends[:, 1:]) / size[:, None])
    room = np.stack([np.minimum(room[:, 0], 0.0), np.maximum(room[:, 1], 0.0)], axis=1)
    spread = np.array(
        [
            1.0 if alone[k].any() else _extent(moves.T[free & ~vanishing], room[free & ~vanishing], k)
            for k in range(len(moves))
        ]
    )
    linear = np.where(is_linear, directions * information.widths, 0.0) * spread[:, None]
    power = np.where(is_linear, 0.0, moves) * spread[:, None]
    return linear.T.reshape(len(values), -1), power.T.reshape(len(values), -1)


def _extent(moves: Array, room: Array, k: int) -> float:
    """Return how far flat direction k goes while moves (f, flats) @ w lie within room (f, 2), at most 10."""
    from scipy.optimize import linprog  # noqa: PLC0415

    limits, ends = np.concatenate([-moves, moves]), np.concatenate([-room[:, 0], room[:, 1]])
    along = np.zeros(moves.shape[1])
    along[k] = 1.0
    found = [linprog(sense * along, limits, ends, bounds=(None, None)) for sense in (1.0, -1.0)]
    if not all(one.success for one in found):
        return 1.0
    return float(np.clip(-found[1].fun - found[0].fun, 1e-3, 10.0))


def _bounds(information: Information, moved: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return least and largest values; what is not pinned down stays in its range."""
    values, allowed = information.values, information.allowed
    low = np.where(moved, information.ranges[:, 0], -np.inf)
    high = np.where(moved, information.ranges[:, 1], np.inf)
    # No contact pushes, no time runs backwards, and a fit does not turn a gear's sense round.
    one_sided = np.arange(len(values)) < len(PARAMETERS)
    low = np.where(one_sided & (values >= 0.0), np.maximum(low, 0.0), low)
    high = np.where(one_sided & (values < 0.0), np.minimum(high, 0.0), high)
    low, high = np.maximum(low, allowed[:, 0]), np.minimum(high, allowed[:, 1])
    return np.minimum(low, values), np.maximum(high, values)


def with_leans(one: Component, shrunk: Sequence[Shrunk]) -> Component:
    """Return a distribution in which each draw is a run of its own, with a lean as large as leans are."""
    size = next((each.size for each in shrunk if each.effect == LEAN), 0.0)
    if LEAN not in one.effects or size == 0.0:
        return one
    parameters = {
        name: _longer(spread, (0.0, 0.0)) if spread.linear else spread
        for name, spread in one.parameters.items()
    }
    count = max((len(spread.linear) for spread in parameters.values()), default=0) or 2
    for index, axis in enumerate("xy"):
        own = [0.0] * count
        own[count - 2 + index] = float(f"{size:g}")
        parameters[f"{LEAN}.lean_{axis}_rad"] = Spread(0.0, linear=tuple(own), power=(0.0,) * count)
    return replace(one, parameters=parameters)


def _longer(spread: Spread, more: tuple[float, ...]) -> Spread:
    return replace(spread, linear=(*spread.linear, *more), power=(*spread.power, *more))


def within(one: Component, stated: dict[str, tuple[float, float]]) -> Component:
    """Return a distribution whose draws stay within narrower bounds, by name."""
    parameters = {
        name: spread
        if name not in stated
        else replace(spread, low=max(spread.low, stated[name][0]), high=min(spread.high, stated[name][1]))
        for name, spread in one.parameters.items()
    }
    return replace(one, parameters=parameters)
