"""How a board answers commands: gain, delay, lag, play and zero about each axis, of any model.

Two models with different effects cannot be compared by the parameters of their effects: a late response is a
delay in one and a lag in the other. They can be compared by these numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from irt.diagnosis.intervals import FEWEST, scatter
from irt.model import Model
from irt.posterior import draws

AXES = ("x", "y")
#: Draws from a posterior for the intervals.
_DRAWS = 1000
#: The quantities that are times.
_TIMES = ("delay", "lag", "late")
#: Quantiles of a 95 % interval.
_ENDS = (0.025, 0.975)


@dataclass(frozen=True)
class Quantity:
    """A number that describes the response of the board about one axis.

    Attributes
    ----------
    name : str
        Its key in the results.
    title, means : str
        Its name and its meaning on the page.
    unit : str
        Its unit; that of a gain is "" if commands are in rad.
    """

    name: str
    title: str
    means: str
    unit: str


#: In the order of the tables.
QUANTITIES = (
    Quantity("gain", "gain", "change of the tilt per unit of the command, slowly", ""),
    Quantity("delay", "delay", "time before the board answers a command at all", "s"),
    Quantity("lag", "lag", "time constant with which it then follows", "s"),
    Quantity("late", "delay + lag", "mean time by which the tilt trails the command", "s"),
    Quantity("play", "play", "tilt that is lost at each reversal of the command", "rad"),
    Quantity("zero", "zero", "tilt against gravity at command 0", "rad"),
)


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval.

    Attributes
    ----------
    value : float
        In the quantity's unit.
    low, high : float
        The ends; both NaN if none is known.
    """

    value: float
    low: float = math.nan
    high: float = math.nan

    @property
    def has_interval(self) -> bool:
        """Whether the interval is known."""
        return not (math.isnan(self.low) or math.isnan(self.high))

    def contains(self, value: float) -> bool:
        """Return whether a value lies in the interval; False without one."""
        return self.low <= value <= self.high

    def overlaps(self, other: Estimate) -> bool:
        """Return whether the two intervals have a point in common; False without both."""
        return self.low <= other.high and other.low <= self.high

    def as_dict(self) -> dict[str, float | None]:
        """Return it as JSON content, None for NaN."""
        return {name: None if math.isnan(one) else one for name, one in asdict(self).items()}


Response = dict[tuple[str, str], Estimate]


def response(model: Model) -> Response:
    """Return each quantity about each axis, with the interval of the model's posterior where it has one."""
    five = {name: one.value for name, one in model.parameters.items()}
    own = {one.name: one.parameters for one in model.effects}
    middle = quantities(five, own)
    if not model.posterior:
        return {key: Estimate(value) for key, value in middle.items()}
    drawn = []
    for component, found in draws(model.posterior, _DRAWS, seed=0):
        effects = {name: dict(own.get(name, {})) for name in component.effects}
        for key, value in found.items():
            of_effect, _, parameter = key.partition(".")
            if of_effect in effects:
                effects[of_effect][parameter] = value
        drawn.append(quantities({**five, **found}, effects))
    ends = {key: np.quantile([one[key] for one in drawn], _ENDS).tolist() for key in middle}
    # A value at the edge of what is possible may lie outside the quantiles of its draws.
    return {
        key: Estimate(value, min(value, ends[key][0]), max(value, ends[key][1]))
        for key, value in middle.items()
    }


def quantities(
    five: Mapping[str, float], effects: Mapping[str, Mapping[str, float]]
) -> dict[tuple[str, str], float]:
    """Return each quantity about each axis from the five parameters and those of the effects, by name.

    An effect that the model does not have counts as zero.
    """
    delay = _by_axis(effects.get("delay", {}), "delay_s", "y_minus_x_s")
    lag = _by_axis(effects.get("lag", {}), "time_constant_s", "y_minus_x_s")
    second = effects.get("second_order_lag", {})
    # The mean delay of 1 / (1 + 2 ζ τ s + τ² s²) is 2 ζ τ.
    slower = _by_axis(second, "time_constant_s", "y_minus_x_s")
    damping = second.get("damping_ratio", 1.0)
    found = {}
    for index, axis in enumerate(AXES):
        gain = five[f"gear_{axis}"]
        trailing = lag[index] + 2.0 * damping * slower[index]
        found[("gain", axis)] = gain
        found[("delay", axis)] = delay[index]
        found[("lag", axis)] = trailing
        found[("late", axis)] = delay[index] + trailing
        found[("play", axis)] = abs(gain) * effects.get("backlash", {}).get(f"width_{axis}_rad", 0.0)
        found[("zero", axis)] = effects.get("tilt_bias", {}).get(f"bias_{axis}_rad", 0.0)
    return found


def widened(whole: Response, parts: Sequence[Response], row_s: float) -> Response:
    """Return the estimates of a fit with intervals that its curvature makes too narrow made wider.

    Residuals of real recordings repeat from row to row: an interval is at least that of the jackknife, if
    there are three parts or more. Commands and tilt are known once a row, so that all delays between two
    rows may look the same: times are uncertain by a row at least.

    Parameters
    ----------
    whole : Response
        Of the fit to all recordings.
    parts : sequence of Response
        Of the fits that leave out one recording each.
    row_s : float
        Duration of a row [s].
    """
    found = {}
    for key, one in whole.items():
        margins = [row_s] if key[0] in _TIMES else []
        if len(parts) >= FEWEST:
            margins.append(float(scatter(np.array([part[key].value for part in parts]))))
        if not margins:
            found[key] = one
            continue
        low, high = one.value - max(margins), one.value + max(margins)
        if one.has_interval:
            low, high = min(low, one.low), max(high, one.high)
        # Times and play have no negative values.
        least = -math.inf if key[0] in ("gain", "zero") else 0.0
        found[key] = Estimate(one.value, max(least, low), high)
    return found


@dataclass(frozen=True)
class Comparison:
    """A quantity about one axis, as the diagnosis predicts it and as the tilt shows it.

    Attributes
    ----------
    quantity : Quantity
        What is compared.
    axis : {"x", "y"}
        About which axis.
    predicted, measured : Estimate
        By the diagnosis, which saw no tilt, and by a fit to the measured tilt.
    """

    quantity: Quantity
    axis: str
    predicted: Estimate
    measured: Estimate

    @property
    def holds(self) -> bool:
        """Whether the measured value lies in the interval of the diagnosis."""
        return self.predicted.contains(self.measured.value)

    @property
    def overlaps(self) -> bool:
        """Whether the two intervals overlap."""
        return self.predicted.overlaps(self.measured)

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON content."""
        return {
            "quantity": self.quantity.name,
            "axis": self.axis,
            "unit": self.quantity.unit,
            "predicted": self.predicted.as_dict(),
            "measured": self.measured.as_dict(),
            "measured_inside_interval": self.holds,
            "intervals_overlap": self.overlaps,
        }


def compared(predicted: Response, measured: Response, unit: str = "rad") -> list[Comparison]:
    """Return all quantities about both axes, in the order of the tables, for commands in a unit."""
    per_unit = "" if unit == "rad" else f"rad/{unit}"
    return [
        Comparison(
            replace(one, unit=per_unit) if one.name == "gain" else one,
            axis,
            predicted[(one.name, axis)],
            measured[(one.name, axis)],
        )
        for one in QUANTITIES
        for axis in AXES
    ]


def _by_axis(parameters: Mapping[str, float], mean: str, difference: str) -> tuple[float, float]:
    """Return the values about x and y of a parameter that has a mean and a difference between the axes."""
    half = 0.5 * parameters.get(difference, 0.0)
    middle = parameters.get(mean, 0.0)
    return max(0.0, middle - half), max(0.0, middle + half)
