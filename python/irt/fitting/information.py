"""What recordings tell about the parameters, to first order around a solution.

The Jacobian of all residuals, freed of what the start states can take up, tells which changes of the
parameters the recordings would show (Gauss-Newton theory). It is trusted only where it holds: after an impact
or a stop a small change may send the marble elsewhere, and such rows say less than their slopes pretend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from irt.fitting import robust
from irt.fitting.coordinates import TIME, Coordinates
from irt.fitting.shooting import Linearisation, Shooting, cut
from irt.fitting.solver import minimise
from irt.model import Model
from irt.residual import Segment
from irt.rig import PARAMETERS
from irt.rollouts import Engine

Array = NDArray[np.float64]

#: Two-sided confidence of the intervals.
CONFIDENCE = 0.95
#: A combination is flat if its interval reaches this share of the range to either side.
FLAT = 0.25
#: Gauss-Newton steps for the start states, where the method does not know them.
STATE_ITERATIONS = 8
#: Draws that check the linearisation, the furthest they go (in z), and the error [scales] that is no worse
#: yet.
DRAWS, FURTHEST, WORST = 24, 0.1, 5.0
#: Physics steps more or less with which a row is simulated to see whether it depends on them.
OTHER_STEPS = (-2, -1, 1, 2)


@dataclass(frozen=True, eq=False)
class Information:
    """What recordings tell about the five parameters.

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
        From the value to the linearised best fit along each direction, zero along flat ones.
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
        *,
        engine: Engine,
        threads: int | None,
        states: Array | None,
    ) -> Information:
        """Linearise a model at its values; arguments as for `irt.fitting.identifiability.estimates`."""
        values = model.values
        ranges = np.array([model.ranges[name] for name in PARAMETERS])
        stamped = segments[0].durations is not None
        sign = np.where((values < 0.0) | ((values == 0.0) & (ranges[:, 1] <= 0.0)), -1.0, 1.0)
        coordinates = Coordinates.of(model.ranges, sign, float(values[TIME]) if stamped else None)
        free = coordinates.lower < coordinates.upper
        widths = np.where(free, np.ptp(ranges, axis=1), 1.0)
        longest = max(len(segment.knobs) for segment in segments)
        windows = cut(segments, longest, at_rest=model.start == "rest")
        shooting = Shooting(model, coordinates, windows, engine=engine, threads=threads)
        z = coordinates.to_z(values)
        if states is None:
            found = minimise(
                shooting, z[None], windows.guess[None], noise=noise, iterations=STATE_ITERATIONS, held=True
            )
            states = found.states[0]
        per_z = (coordinates.derivative(z) / widths[:, None])[np.ix_(free, free)]
        line = shooting.linearise(z[None], states[None], careful=True)
        linear = _Linear(shooting, z, states, line, noise, free, per_z)
        solved = linear.solved(linear.known)
        solved = linear.solved(linear.known * linear.trust(solved))
        directions = np.zeros((len(solved.half_width), 5))
        directions[:, free] = solved.directions
        return cls(
            values=values,
            widths=widths,
            ranges=np.stack([np.minimum(ranges[:, 0], values), np.maximum(ranges[:, 1], values)], axis=1),
            free=free,
            directions=directions,
            half_width=solved.half_width,
            offset=np.where(solved.half_width < FLAT, solved.offset, 0.0),
        )

    @property
    def flat(self) -> NDArray[np.bool_]:
        """Which directions are not pinned down, (f,)."""
        return self.half_width >= FLAT

    def margin(self, change: Array) -> float:
        """Return the half width of the 95 % interval of a linear function of the parameters.

        The function is given by its (5,) coefficients in units of the ranges. What the flat directions would
        add is left out.
        """
        known = ~self.flat
        return float(np.linalg.norm(self.directions[known] @ change * self.half_width[known]))


@dataclass(frozen=True, eq=False)
class _Solved:
    """Gauss-Newton solution in units of the ranges: f directions, over the f free parameters."""

    directions: Array
    deviation: Array
    half_width: Array
    offset: Array
    follow: Array  # (w, s, f): how start states follow z


@dataclass(frozen=True, eq=False)
class _Linear:
    """A linearisation of the residuals at one solution."""

    shooting: Shooting
    z: Array
    states: Array
    line: Linearisation
    noise: float
    free: NDArray[np.bool_]
    per_z: Array  # (f, f): units of the ranges per z

    @property
    def known(self) -> Array:
        """1 where something was seen, else 0; (w, N)."""
        return self.shooting.windows.known.reshape(self.line.residual[0].shape).astype(np.float64)

    @property
    def scale(self) -> float:
        """Robust standard deviation of the residuals [board edges]."""
        return max(float(robust.scale(self.line.residual, self.shooting.windows.known)[0]), self.noise)

    def solved(self, weight: Array) -> _Solved:
        """Solve with residuals weighted by (w, N) weights of at most 1."""
        root = np.sqrt(weight)
        by_z = root[..., None] * self.line.by_z[0][..., self.free]
        by_state = root[..., None] * self.line.by_state[0]
        follow = -np.linalg.pinv(by_state, rcond=1e-9) @ by_z
        jacobian = (by_z + by_state @ follow).reshape(-1, by_z.shape[-1]) @ np.linalg.inv(self.per_z)
        left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
        psi, slope = robust.influence(self.line.residual[0], self.scale)
        mean_slope = (slope * weight).sum() / weight.sum()
        pull = root * psi
        dof = max(weight.sum() - self.shooting.windows.unknowns - len(singular), 1.0)
        variance = (
            (pull**2).sum()
            / dof
            / mean_slope**2
            * _repetition(pull.reshape(self.shooting.windows.known.shape))
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            deviation = np.nan_to_num(np.sqrt(variance) / singular, nan=np.inf)
            offset = -(left.T @ pull.ravel()) / mean_slope / singular
        # Without degrees of freedom to spare nothing is known: the width may pass what a float holds.
        with np.errstate(over="ignore"):
            half_width = float(stdtrit(dof, 0.5 + CONFIDENCE / 2.0)) * deviation
        return _Solved(right, deviation, half_width, offset, follow)

    def trust(self, solved: _Solved) -> Array:
        """How far each residual's slope can be believed, (w, N) between 0 and 1.

        Parameters are drawn from what the solution leaves open; by what the linearisation is wrong there is a
        noise of its own. So is the difference that a few physics steps more or less make.
        """
        reach = np.minimum(solved.deviation, 1.0 / np.finfo(float).eps)
        draws = np.random.default_rng(0).standard_normal((DRAWS, len(reach))) * reach
        step = np.zeros((DRAWS, 5))
        step[:, self.free] = draws @ solved.directions @ np.linalg.inv(self.per_z).T
        drawn = self.shooting.coordinates.clip(self.z + np.clip(step, -FURTHEST, FURTHEST))
        step = drawn - self.z
        follow = np.einsum("wsi,mi->mws", solved.follow, step[:, self.free])
        states = np.repeat(self.states[None], DRAWS, axis=0)
        states[..., : follow.shape[-1]] += follow
        foreseen = np.einsum("wni,mi->mwn", self.line.by_z[0], step)
        foreseen += np.einsum("wns,mws->mwn", self.line.by_state[0], follow)
        errors = self.shooting.residuals(drawn, states) - self.line.residual[0] - foreseen
        doubt = self._doubt(errors)
        if self.shooting.windows.durations is None:
            z, states = self.z[None], self.states[None]
            others = [self.shooting.residuals(z, states, more)[0] for more in OTHER_STEPS]
            doubt += self._doubt(np.array(others) - self.line.residual[0])
        return 1.0 / (1.0 + doubt)

    def _doubt(self, errors: Array) -> Array:
        """Mean square of (m, w, N) errors over m, in units of the scale; a rare large one does not decide."""
        doubt: Array = np.mean(np.minimum((errors / self.scale) ** 2, WORST**2), axis=0)
        return doubt


def _repetition(pull: Array) -> float:
    """How many residuals in a row, of (w, n, 2), say the same: 1 for noise, more where a model is wrong.

    One plus twice the sum of the autocorrelations, up to the first that noise alone could have: the factor by
    which the variance of a mean of correlated values exceeds that of independent ones.
    """
    total, factor = max(float((pull**2).sum()), np.finfo(float).tiny), 1.0
    by_chance = 2.0 / np.sqrt(np.count_nonzero(pull) or 1)
    for lag in range(1, pull.shape[1]):
        correlation = float((pull[:, lag:] * pull[:, :-lag]).sum()) / total
        if correlation < by_chance:
            break
        factor += 2.0 * correlation
    return factor
