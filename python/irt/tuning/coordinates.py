"""Coordinates of the parameters that a marble's path identifies.

Off the rim a path depends only on the products observation_scale x time_scale^2 x (gear_x, gear_y,
rolling_friction). Contact with the rim identifies observation_scale; time_scale by itself is hardly
identifiable. Small products change the path in proportion. Large ones change it with their logarithm, because
they determine how soon the marble reaches the rim.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from irt.rig import PARAMETERS
from irt.tuning.drive import Drive

Array = NDArray[np.float64]

#: Share of the largest product at which the scale changes from linear to logarithmic.
_BEND = 0.02
_TIME, _SCALE = PARAMETERS.index("time_scale"), PARAMETERS.index("observation_scale")
#: Number of observation scales in the computation of a median.
_SCALES = 81


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The map between parameters and coordinates, for one drive.

    The five coordinates are the linear-logarithmic products with gear_x, gear_y and rolling_friction, the
    observation scale in half widths of its range, doubled, and the logarithm of the time scale.

    Attributes
    ----------
    drive : Drive
        The drive, with the ranges, and the largest knob angle, which scales the friction.
    """

    drive: Drive

    def of(self, parameters: Array) -> Array:
        """Return the coordinates (k, 5) of (k, 5) parameters, the time scale as the simulator rounds it."""
        steps, scale = self.time_scale(parameters), parameters[:, _SCALE]
        products = (scale * steps**2)[:, None] * parameters[:, :3] / self._sizes
        bent = np.sign(products) * np.log1p(np.abs(products))
        return np.column_stack([bent, (scale - self._middle) / self._half, np.log1p(steps)])

    def parameters(self, coordinates: Array) -> Array:
        """Return the parameters (k, 5) of coordinates, within the ranges.

        The products have priority: if the ranges allow them only with another time scale, that one is used.
        """
        low, high = self._ends
        scale = np.clip(self._middle + self._half * coordinates[:, 3], low[_SCALE], high[_SCALE])
        products = self._unbent(coordinates)
        with np.errstate(divide="ignore", invalid="ignore"):
            least = np.sqrt(np.maximum(products / (scale[:, None] * high[:3]), 0.0).max(axis=1))
        steps = np.rint(np.maximum(np.expm1(coordinates[:, 4]), np.nan_to_num(least, posinf=0.0) - 0.5))
        steps = np.clip(np.where(steps < least - 1e-9, steps + 1.0, steps), max(1.0, low[_TIME]), high[_TIME])
        return np.clip(self._assembled(products, scale, steps), low, high)

    def at_time_scale(self, coordinates: Array, steps: Array) -> Array:
        """Return the parameters (k, 5) of coordinates at given time scales (k,), without bounds."""
        scale = self._middle + self._half * coordinates[:, 3]
        return self._assembled(self._unbent(coordinates), scale, steps)

    def central(self, coordinates: Array) -> Array:
        """Return coordinates (k, 5) with medians for those that a path off the rim does not identify.

        Parameters with the same products have the same path there. The given observation and time scales are
        replaced by the medians over such parameters, drawn uniformly from the ranges. With damping the time
        scale is identifiable and is kept.
        """
        moved = coordinates.copy()
        scales, steps = self._grid
        for row, products in enumerate(self._unbent(coordinates)):
            given = np.maximum(np.rint(np.expm1(coordinates[row, 4])), 1.0)
            shape = (scales * (given if self._time_shows else steps) ** 2).ravel()
            with np.errstate(divide="ignore", invalid="ignore"):
                least = np.nan_to_num(products / self._ends[1][:3], posinf=0.0).max()
            # The density of three products at one point grows as the three factors shrink.
            weight = np.where(shape >= least - 1e-9, shape**-3.0, 0.0)
            if weight.any():
                moved[row, 3] = (_median(scales.ravel(), weight) - self._middle) / self._half
                if not self._time_shows:
                    moved[row, 4] = np.log1p(_median(steps.ravel(), weight))
        return moved

    def time_scale(self, parameters: Array) -> Array:
        """Return the time scales (k,) as whole physics updates, at least one."""
        if self.drive.time_scale is not None:
            return np.full(len(parameters), self.drive.time_scale)
        return np.maximum(np.rint(parameters[:, _TIME]), 1.0)

    @cached_property
    def shown(self) -> NDArray[np.int64]:
        """The coordinates that a path identifies: those of free parameters except the time scale."""
        return np.flatnonzero(self.drive.open[[0, 1, 2, _SCALE]])

    def _assembled(self, products: Array, scale: Array, steps: Array) -> Array:
        if self.drive.time_scale is not None:
            steps = np.full(len(products), self.drive.time_scale)
        return np.column_stack([products / (scale * steps**2)[:, None], steps, scale])

    def _unbent(self, coordinates: Array) -> Array:
        bent = coordinates[:, :3]
        return np.sign(bent) * np.expm1(np.abs(bent)) * self._sizes

    @property
    def _time_shows(self) -> bool:
        return self.drive.time_scale is not None or self.drive.marble.damping_per_s > 0.0

    @cached_property
    def _grid(self) -> tuple[Array, Array]:
        """Grid of observation scales and time scales over their ranges, two arrays of one shape."""
        low, high = self._ends
        scales = np.linspace(low[_SCALE], high[_SCALE], _SCALES)
        first, last = max(1.0, np.rint(low[_TIME])), max(1.0, np.rint(high[_TIME]))
        steps = np.arange(first, last + 1.0)
        return np.repeat(scales[:, None], len(steps), axis=1), np.repeat(steps[None], _SCALES, axis=0)

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        low, high = np.array([self.drive.ranges[name] for name in PARAMETERS]).T
        if self.drive.time_scale is not None:
            low[_TIME] = high[_TIME] = self.drive.time_scale
        return low, high

    @property
    def _middle(self) -> float:
        low, high = self._ends
        return float(low[_SCALE] + high[_SCALE]) / 2.0

    @property
    def _half(self) -> float:
        low, high = self._ends
        return float(high[_SCALE] - low[_SCALE]) / 4.0 or 1.0

    @cached_property
    def _sizes(self) -> Array:
        """Products of the gears and of the friction at which the coordinate becomes logarithmic."""
        low, high = self._ends
        gear = float(np.abs([low[:2], high[:2]]).max()) or 1.0
        largest = float(high[_SCALE] * high[_TIME] ** 2 * gear)
        knob = max(float(np.abs(run.knobs).max()) for run in self.drive.runs) or 1.0
        return _BEND * largest * np.array([1.0, 1.0, knob])


def _median(values: Array, weight: Array) -> float:
    """Return the weighted median of (n,) values."""
    order = np.argsort(values, kind="stable")
    shares = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(shares, 0.5 * shares[-1])]])
