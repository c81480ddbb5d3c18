"""What recordings tell about the parameters of a model, as intervals and sentences need it."""

from __future__ import annotations

from dataclasses import dataclass

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
    """What recordings tell about n parameters: the five of `irt.rig.PARAMETERS`, then any effects'.

    Directions are in units of the parameters' ranges, so that 1 is from one end to the other.

    Attributes
    ----------
    names : tuple of str
        Of the parameters.
    values, widths : (n,) arrays
        The parameters and the widths of their ranges, in their own units.
    ranges : (n, 2) array
        Ends of the ranges, moved out to hold the value where it lies outside.
    allowed : (n, 2) array
        The values that physics allows.
    free : (n,) bool array
        False where a parameter was not estimated.
    directions : (f, n) array
        Orthonormal combinations, f the number of free parameters.
    half_width : (f,) array
        Of the 95 % interval along each direction, infinite where nothing is known.
    offset : (f,) array
        From the value to the linearised best fit along each direction, zero along flat ones.
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
        """Return what the engine found of a problem around (n,) values."""
        # scipy takes longer to load than `irt check`, which builds the class from its own numbers, to run.
        from scipy.special import stdtrit  # noqa: PLC0415

        free = np.zeros(len(values), dtype=bool)
        free[found.free] = True
        directions = np.zeros((len(found.deviation), len(values)))
        directions[:, found.free] = found.directions
        # Without degrees of freedom to spare nothing is known: the width may pass what a float holds.
        with np.errstate(over="ignore"):
            half_width = float(stdtrit(found.degrees_of_freedom, 0.5 + CONFIDENCE / 2.0)) * found.deviation
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
            offset=np.where(half_width < FLAT, found.offset, 0.0),
        )

    @property
    def flat(self) -> NDArray[np.bool_]:
        """Which directions are not pinned down, (f,)."""
        return self.half_width >= FLAT

    def margin(self, change: Array) -> float:
        """Return the half width of the 95 % interval of a linear function of the parameters.

        The function is given by its (n,) coefficients in units of the ranges. What the flat directions would
        add is left out.
        """
        known = ~self.flat
        return float(np.linalg.norm(self.directions[known] @ change * self.half_width[known]))
