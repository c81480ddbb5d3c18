"""The coordinates that a fit moves in: in logarithms the symmetries of the motion are straight lines.

Two families of changes leave a recording as it is, the first without damping, the second until a wall is met:

- gear_x, gear_y and rolling_friction times L, time_scale divided by sqrt(L);
- observation_scale times r, gear_x, gear_y and rolling_friction divided by r.

In z = (log gear_x, log gear_y, c, log time_scale, log observation_scale), where c is the friction relative to
the gears, both are straight lines along which c stands still. A fit that cannot tell their members apart
slides along a straight valley instead of a bent one, and steps of equal size are equal relative changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.rig import PARAMETERS

Array = NDArray[np.float64]

GEAR_X, GEAR_Y, FRICTION, TIME, SCALE = (
    PARAMETERS.index(name)
    for name in ("gear_x", "gear_y", "rolling_friction", "time_scale", "observation_scale")
)
#: How far beyond the rig's ranges a fit may look, for a rig whose truth lies a little outside.
REACH = 3.0
#: Relative distance beyond a range that counts like a residual of one standard deviation.
LEEWAY = 0.1
#: A logarithm needs a smallest value: this share of the largest that is allowed.
SMALLEST = 1e-4
#: Below this share of their largest value, changes of parameters are no longer counted in proportion.
SMALL = 0.02
#: Below this a timestep rounds to no physics step at all, and the marble never moves.
SHORTEST_TIME_SCALE = 0.5


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The map between parameters p, in their own units, and the coordinates z of a fit.

    Attributes
    ----------
    sign : (5,) array
        1, or -1 for a gear that turns the other way round.
    low, high : (5,) arrays
        The rig's ranges, as magnitudes.
    lower, upper : (5,) arrays
        What p may take at most, as magnitudes; equal where a parameter is held.
    friction_unit : float
        Friction over root-mean-square gear at which c = 1.
    """

    sign: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    friction_unit: float

    @classmethod
    def of(
        cls, ranges: Mapping[str, tuple[float, float]], sign: Array, time_scale: float | None = None
    ) -> Coordinates:
        """Return the coordinates for these ranges, reaching `REACH` times further.

        Parameters
        ----------
        ranges : mapping
            Lowest and highest value, for each of `irt.rig.PARAMETERS`.
        sign : (5,) array
            Which side of zero is searched.
        time_scale : float, optional
            Hold it at this value, whatever its range: what the stamps say.
        """
        ends = np.array([ranges[name] for name in PARAMETERS]) * sign[:, None]
        low, high = np.sort(np.maximum(ends, 0.0), axis=1).T
        if time_scale is not None:
            low[TIME] = high[TIME] = time_scale
        lower, upper = low / REACH, high * REACH
        for index in (GEAR_X, GEAR_Y, SCALE):
            lower[index] = max(lower[index], SMALLEST * upper[index])
        lower[TIME] = max(lower[TIME], SHORTEST_TIME_SCALE)
        if time_scale is not None:
            lower[TIME] = upper[TIME] = time_scale
        gear = np.sqrt((upper[GEAR_X] ** 2 + upper[GEAR_Y] ** 2) / 2)
        unit = max(upper[FRICTION], SMALLEST * gear) / gear
        return cls(sign, low, high, lower, np.maximum(upper, lower), unit)

    def to_z(self, parameters: Array) -> Array:
        """Map (..., 5) parameters, moved to the nearest that a fit may take, to (..., 5) coordinates."""
        p = np.clip(parameters * self.sign, self.lower, self.upper)
        z: Array = np.log(np.maximum(p, np.finfo(float).tiny))
        z[..., FRICTION] = p[..., FRICTION] / (self.friction_unit * _gear(p))
        return z

    def to_p(self, z: Array) -> Array:
        """Map (..., 5) coordinates to (..., 5) parameters that a fit may take."""
        return self.sign * np.clip(self._magnitudes(z), self.lower, self.upper)

    def bounds(self, z: Array) -> tuple[Array, Array]:
        """Return the lowest and highest (..., 5) coordinates; the friction's depend on the gears at z."""
        tiny = np.finfo(float).tiny
        low = np.broadcast_to(np.log(np.maximum(self.lower, tiny)), z.shape).copy()
        high = np.broadcast_to(np.log(np.maximum(self.upper, tiny)), z.shape).copy()
        unit = self.friction_unit * _gear(np.exp(np.clip(z, low, high)))
        low[..., FRICTION], high[..., FRICTION] = self.lower[FRICTION] / unit, self.upper[FRICTION] / unit
        return low, high

    def clip(self, z: Array) -> Array:
        """Move (..., 5) coordinates to the nearest allowed ones."""
        return np.clip(z, *self.bounds(z))

    def excess(self, z: Array) -> tuple[Array, Array]:
        """Return how far outside the ranges parameters lie, in units of `LEEWAY`, and the derivative by z.

        To be squared and halved like a residual: where recordings say nothing, this keeps a fit in the
        ranges; where they say something, it is little against it.

        Returns
        -------
        excess : (..., 5) array
        derivative : (..., 5, 5) array
        """
        p = self._magnitudes(z)
        tiny = np.finfo(float).tiny
        above = np.log(np.maximum(p, tiny) / np.maximum(self.high, tiny))
        below = np.log(np.maximum(self.low, tiny) / np.maximum(p, tiny))
        excess = (
            np.maximum(above, 0.0) * (self.high > 0.0) - np.maximum(below, 0.0) * (self.low > 0.0)
        ) / LEEWAY
        slope = np.broadcast_to(np.eye(5), (*z.shape, 5)).copy()
        slope[..., FRICTION, FRICTION] = 1.0 / np.maximum(z[..., FRICTION], SMALLEST)
        slope[..., FRICTION, :] += _gear_shares(p)
        return excess, np.where(excess[..., None] != 0.0, slope / LEEWAY, 0.0)

    @property
    def axes(self) -> Array:
        """Directions of z, (5, 5) one a row, to take differences along: the symmetries and what is left.

        Differences along single coordinates would each catch other stops and impacts, whose jumps then do not
        cancel along a symmetry, where nothing happens at all.
        """
        axes = np.eye(5)
        axes[SCALE, [GEAR_X, GEAR_Y]] = -1.0
        if self.lower[TIME] < self.upper[TIME]:
            axes[TIME, [GEAR_X, GEAR_Y]] = -2.0
        return axes

    def derivative(self, z: Array) -> Array:
        """Return dp/dz at one point z of shape (5,), as a (5, 5) matrix that does not see the bounds."""
        p = self._magnitudes(z)
        result = np.diag(p)
        result[FRICTION, FRICTION] = self.friction_unit * _gear(p)
        result[FRICTION] += p[FRICTION] * _gear_shares(p)
        return self.sign[:, None] * result

    def _magnitudes(self, z: Array) -> Array:
        p: Array = np.exp(z)
        p[..., FRICTION] = z[..., FRICTION] * self.friction_unit * _gear(p)
        return p


def along_time(z: Array, time_scale: Array) -> Array:
    """Move (..., 5) coordinates along the first symmetry, until their time scale is this one (...)."""
    shift = np.log(time_scale) - z[..., TIME]
    moved = z.copy()
    moved[..., TIME] += shift
    moved[..., [GEAR_X, GEAR_Y]] -= 2.0 * shift[..., None]
    return moved


def _gear(p: Array) -> Array:
    """Return the root mean square of the two gears, which stays positive when one of them vanishes."""
    mean: Array = np.sqrt((p[..., GEAR_X] ** 2 + p[..., GEAR_Y] ** 2) / 2)
    return mean


def _gear_shares(p: Array) -> Array:
    """Return the derivative of the logarithm of `_gear` by z, (..., 5)."""
    shares = np.zeros_like(p)
    squares = p[..., [GEAR_X, GEAR_Y]] ** 2
    shares[..., [GEAR_X, GEAR_Y]] = squares / squares.sum(axis=-1, keepdims=True)
    return shares
