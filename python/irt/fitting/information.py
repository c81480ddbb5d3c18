"""Information of recordings about the parameters of a model, for intervals and sentences."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.fitting.problem import Problem
from irt.fitting.solution import Curvature

Array = NDArray[np.float64]

#: Two-sided confidence of the intervals.
CONFIDENCE = 0.95
#: A combination is flat if its interval reaches this share of the range to either side.
FLAT = 0.25


@dataclass(frozen=True, eq=False)
class Information:
    """Information about n parameters: the five of `irt.rig.PARAMETERS`, then those of effects.

    Directions are in units of the parameters' ranges: a step of 1 spans a range.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters.
    values, widths : (n,) arrays
        The parameters and the widths of their ranges, in their own units.
    ranges : (n, 2) array
        Ends of the ranges, extended to contain the value.
    allowed : (n, 2) array
        The values that physics allows.
    free : (n,) bool array
        Whether a parameter was estimated.
    directions : (f, n) array
        Orthonormal combinations, f the number of free parameters.
    half_width : (f,) array
        Half-width of the 95 % interval along each direction, infinite if nothing is known.
    offset : (f,) array
        Offset from the value to the linearised best fit along each direction, zero along flat ones.
    """

    names: tuple[str, ...]
    values: Array
    widths: Array
    ranges: Array
    allowed: Array
    free: NDArray[np.bool_]
    directions: Array
    half_width: Array
    offset: Array

    @classmethod
    def of(cls, asked: Problem, values: Array, found: Curvature) -> Information:
        """Return the information from the engine's curvature of a problem at (n,) values."""
        # scipy loads slower than all of `irt check`, which uses this class without this method.
        from scipy.special import stdtrit  # noqa: PLC0415

        free = np.zeros(len(values), dtype=bool)
        free[found.free] = True
        directions = np.zeros((len(found.deviation), len(values)))
        directions[:, found.free] = found.directions
        # With few degrees of freedom the half-width may overflow.
        with np.errstate(over="ignore"):
            half_width = float(stdtrit(found.degrees_of_freedom, 0.5 + CONFIDENCE / 2.0)) * found.deviation
        offset = np.where(half_width < FLAT, found.offset, 0.0)
        return replace(cls.along(asked, values, free, directions, half_width), offset=offset)

    @classmethod
    def along(
        cls,
        asked: Problem,
        values: Array,
        free: NDArray[np.bool_],
        directions: Array,
        half_width: Array,
    ) -> Information:
        """Return the information about (n,) values of a problem, the best fit, along given directions."""
        return cls(
            names=asked.names,
            values=values,
            widths=np.where(free, np.ptp(asked.ranges, axis=1), 1.0),
            ranges=np.stack(
                [np.minimum(asked.ranges[:, 0], values), np.maximum(asked.ranges[:, 1], values)], axis=1
            ),
            allowed=asked.allowed,
            free=free,
            directions=directions,
            half_width=half_width,
            offset=np.zeros(len(half_width)),
        )

    @property
    def flat(self) -> NDArray[np.bool_]:
        """Whether each direction is unidentifiable, (f,)."""
        return self.half_width >= FLAT

    def margin(self, change: Array) -> float:
        """Return the half-width of the 95 % interval of a linear function of the parameters.

        The function is given by its (n,) coefficients in units of the ranges. Flat directions are ignored.
        """
        known = ~self.flat
        return float(np.linalg.norm(self.directions[known] @ change * self.half_width[known]))
