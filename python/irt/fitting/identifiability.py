"""How well recordings pin the parameters down: 95 % intervals, and plain words for what they cannot tell.

Gauss-Newton theory around a solution: the Jacobian of all residuals, freed of what the start states can take up,
tells which changes of the parameters the recordings would show. A combination whose 95 % interval would span half
of its range or more counts as flat: nothing measured says where in the ranges it is. The intervals of all
parameters that take part in it then reach as far as the ranges allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from irt.fitting import robust
from irt.fitting.coordinates import SMALLEST, TIME, Coordinates
from irt.fitting.sentences import unidentifiable
from irt.fitting.shooting import Linearisation, Shooting, cut
from irt.fitting.solver import minimise
from irt.model import Parameter
from irt.rig import PARAMETERS

if TYPE_CHECKING:
    from irt.model import Model
    from irt.residual import Segment
    from irt.rollouts import Engine

Array = NDArray[np.float64]

#: Two-sided confidence of the intervals.
CONFIDENCE = 0.95
#: A combination is flat if its interval reaches this share of the range to either side.
FLAT = 0.25
#: Gauss-Newton steps for the start states, which the model does not hold.
STATE_ITERATIONS = 8


def estimates(
    model: Model,
    segments: Sequence[Segment],
    noise: float,
    *,
    engine: Engine = "rolling",
    threads: int | None = None,
    states: Array | None = None,
) -> tuple[dict[str, Parameter], tuple[str, ...]]:
    """Return the parameters of a model with 95 % intervals, and what the recordings cannot pin down.

    Works for the outcome of any method: where the model is not the best fit, the intervals also hold the
    place where the linearised best fit would be.

    Parameters
    ----------
    model : Model
        The tuned model.
    segments : sequence of Segment
        What it was tuned to.
    noise : float
        The tracker's standard deviation [board edges]; residuals count with their own scale where it is larger.
    engine, threads
        As for `irt.rollouts`.
    states : (w, 4) array, optional
        Start states of the segments, where the method knows them; else they are estimated.

    Returns
    -------
    parameters : dict of Parameter
        The model's values with low and high, in their own units. A parameter that was not estimated (a range
        of one value; the time scale of stamped recordings) has none.
    sentences : tuple of str
        One for each combination that is not pinned down; empty if all is known.
    """
    information = Information.of(model, segments, noise, engine, threads, states)
    low, high = information.intervals()
    parameters = {
        name: Parameter(float(value), float(low[i]), float(high[i]))
        if information.free[i]
        else Parameter(float(value))
        for i, (name, value) in enumerate(zip(PARAMETERS, model.values, strict=True))
    }
    return parameters, unidentifiable(information, low, high)


@dataclass(frozen=True, eq=False)
class Information:
    """What recordings tell about the five parameters, to first order.

    Directions are in units of the parameters' ranges, so that 1 is from one end to the other.

    Attributes
    ----------
    values, widths : (5,) arrays
        The parameters and the widths of their ranges, in their own units.
    ranges : (5, 2) array
        Ends of the ranges, moved out to hold the value where it lies outside.
    free : (5,) bool array
        False where a parameter was not estimated.
    directions : (f, 5) array
        Orthonormal combinations, f the number of free parameters.
    half_width : (f,) array
        Of the 95 % interval along each direction, infinite where nothing is known.
    offset : (f,) array
        From the value to the linearised best fit, along each direction.
    """

    values: Array
    widths: Array
    ranges: Array
    free: NDArray[np.bool_]
    directions: Array
    half_width: Array
    offset: Array

    @classmethod
    def of(
        cls,
        model: Model,
        segments: Sequence[Segment],
        noise: float,
        engine: Engine,
        threads: int | None,
        states: Array | None,
    ) -> Information:
        """Linearise a model at its values."""
        values = model.values
        ranges = np.array([model.ranges[name] for name in PARAMETERS])
        stamped = segments[0].durations is not None
        sign = np.where((values < 0.0) | ((values == 0.0) & (ranges[:, 1] <= 0.0)), -1.0, 1.0)
        coordinates = Coordinates.of(model.ranges, sign, float(values[TIME]) if stamped else None)
        free = coordinates.lower < coordinates.upper
        widths = np.where(free, np.ptp(ranges, axis=1), 1.0)
        windows = cut(
            segments, max(len(segment.knobs) for segment in segments), at_rest=model.start == "rest"
        )
        shooting = Shooting(model, coordinates, windows, engine=engine, threads=threads)
        z = coordinates.to_z(values)[None]
        start = minimise(
            shooting, z, windows.guess[None], noise, STATE_ITERATIONS, held=np.ones(5, dtype=bool)
        )
        line = shooting.linearise(z, start.states)
        jacobian = _without_states(line)[:, free] @ np.linalg.inv(
            coordinates.derivative(z[0])[np.ix_(free, free)]
        )
        left, singular, right = np.linalg.svd(jacobian * widths[free], full_matrices=False)

        scale = np.maximum(robust.scale(line.residual, windows.known), noise)
        psi, slope = robust.influence(line.residual[0], float(scale[0]))
        psi, slope = (
            np.where(windows.known.reshape(psi.shape), psi, 0.0),
            slope[windows.known.reshape(psi.shape)].mean(),
        )
        count = int(windows.known.sum())
        dof = max(count - windows.unknowns - int(free.sum()), 1)
        variance = (
            (psi**2).sum() / dof / slope**2 * _repetition(psi.reshape(windows.known.shape), windows.known)
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            half_width = float(stdtrit(dof, 0.5 + CONFIDENCE / 2)) * np.sqrt(variance) / singular
            offset = -(left.T @ psi.ravel()) / slope / singular
        directions = np.zeros((len(singular), 5))
        directions[:, free] = right
        return cls(
            values,
            widths,
            np.stack([np.minimum(ranges[:, 0], values), np.maximum(ranges[:, 1], values)], axis=1),
            free,
            directions,
            np.where(np.isfinite(half_width), half_width, np.inf),
            np.where(half_width < FLAT, offset, 0.0),
        )

    @property
    def flat(self) -> NDArray[np.bool_]:
        """Which directions are not pinned down, (f,)."""
        return self.half_width >= FLAT

    def margin(self, change: Array) -> float:
        """Half width of the 95 % interval of a linear function of the parameters, (5,) in units of the ranges.

        What the flat directions would add is left out.
        """
        known = ~self.flat
        return float(np.linalg.norm(self.directions[known] @ change * self.half_width[known]))

    def intervals(self) -> tuple[Array, Array]:
        """Return the ends of the 95 % intervals, (5,) each, in the parameters' own units."""
        margin = np.array([self.margin(axis) for axis in np.eye(5)]) * self.widths
        offset = self.offset @ self.directions * self.widths
        low = self.values + np.minimum(offset, 0.0) - margin
        high = self.values + np.maximum(offset, 0.0) + margin
        if self.flat.any():
            reach_low, reach_high = self._reach()
            low, high = low + reach_low - self.values, high + reach_high - self.values
            involved = reach_low < reach_high
            low = np.where(involved, np.maximum(low, self.ranges[:, 0]), low)
            high = np.where(involved, np.minimum(high, self.ranges[:, 1]), high)
        # No contact pushes, no time runs backwards, and a fit does not turn a gear's sense round.
        negative = self.values < 0.0
        return np.where(negative, low, np.maximum(low, 0.0)), np.where(negative, np.minimum(high, 0.0), high)

    def _reach(self) -> tuple[Array, Array]:
        """How far each parameter gets along the flat directions before any of them leaves its range: (5,) twice.

        Along the symmetries of the motion logarithms change in proportion, so the allowed moves form a polytope
        in logarithms, and the furthest ones are among its corners.
        """
        sign = np.where(self.values < 0.0, -1.0, 1.0)
        ends = np.sort(np.maximum(self.ranges * sign[:, None], 0.0), axis=1)
        least = SMALLEST * ends[:, 1]
        size = np.maximum(np.abs(self.values), least)
        room = np.log(np.maximum(ends, least[:, None]) / size[:, None])
        moves = (self.directions[self.flat] * self.widths * sign / size).T
        furthest = np.zeros((2, 5))
        corners = moves[self.free] @ _corners(moves[self.free], room[self.free]).T
        furthest[:, self.free] = corners.min(axis=1), corners.max(axis=1)
        low, high = np.sort(sign * size * np.exp(furthest), axis=0)
        # Close to a vanishing parameter logarithms would go on for ever.
        low = np.where(np.abs(low) <= 2.0 * least, np.minimum(self.values, 0.0), low)
        return np.minimum(low, self.values), np.maximum(high, self.values)


def _corners(moves: Array, room: Array) -> Array:
    """Corners (m, k) of the polytope room[:, 0] <= moves @ w <= room[:, 1], with moves (f, k); w = 0 is inside."""
    f, k = moves.shape
    found = [np.zeros(k)]
    for rows in combinations(range(f), k):
        matrix = moves[list(rows)]
        if abs(np.linalg.det(matrix / np.linalg.norm(matrix, axis=1, keepdims=True).clip(1e-300))) < 1e-9:
            continue
        found += [np.linalg.solve(matrix, room[list(rows), list(ends)]) for ends in product((0, 1), repeat=k)]
    corners = np.array(found)
    along = corners @ moves.T
    return corners[np.all((along >= room[:, 0] - 1e-6) & (along <= room[:, 1] + 1e-6), axis=1)]


def _without_states(line: Linearisation) -> Array:
    """Return the (w * N, 5) Jacobian by coordinates of the first candidate, without what start states can take up."""
    by_z, by_state = line.by_z[0], line.by_state[0]
    return (by_z - by_state @ (np.linalg.pinv(by_state, rcond=1e-9) @ by_z)).reshape(-1, 5)


def _repetition(psi: Array, known: NDArray[np.bool_]) -> float:
    """How many residuals in a row, (w, n, 2), say the same thing: 1 for noise, more where the model is wrong.

    One plus twice the sum of the autocorrelations, up to the first that noise alone could have: the factor by
    which the variance of a mean of correlated values exceeds that of independent ones.
    """
    total = (psi**2).sum()
    factor, count = 1.0, np.sqrt(known.sum())
    for lag in range(1, psi.shape[1]):
        correlation = (psi[:, lag:] * psi[:, :-lag]).sum() / max(total, np.finfo(float).tiny)
        if correlation < 2.0 / count:
            break
        factor += 2.0 * correlation
    return float(factor)
