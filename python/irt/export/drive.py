"""What of a model lies between a command and the board's tilt, as a servo, a crank and a linkage have it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from irt.model import Model

#: Time constant of a knob that follows at once [s]: critically damped, it comes later by twice this. A board
#: that jumps throws the marble off.
SERVO_S = 0.01


@dataclass(frozen=True)
class Axis:
    """How the board turns about one axis.

    Attributes
    ----------
    delay_s, lag_s : float
        From a command until the servo has it, and the time constant of a first-order lag before it.
    servo_s, damping_ratio : float
        Time constant of the servo, one over its undamped angular frequency [s], and its damping ratio.
    width : float
        Backlash between the knob and what turns with the board [command units].
    gears : dict
        Tilt [rad] for each command unit of each axis, "x" and "y".
    cubic : float
        Tilt [rad] for each cubed command unit.
    bias_rad : float
        Tilt while the knobs are level [rad].
    late_s : float
        By how much more than the model's the tilt comes late [s].
    """

    delay_s: float
    lag_s: float
    servo_s: float
    damping_ratio: float
    width: float
    gears: dict[str, float]
    cubic: float
    bias_rad: float
    late_s: float


def axes(model: Model) -> dict[str, Axis]:
    """Return how the board turns about x and about y."""
    return {axis: _axis(model, axis) for axis in "xy"}


def warnings(found: Mapping[str, Axis]) -> Iterator[str]:
    """Say what of these MuJoCo does not do as the model has it."""
    late = {axis: one.late_s for axis, one in found.items() if one.late_s > 0.0}
    if late:
        named = " and ".join(late)
        yield (
            f"the board turns about {named} {1000.0 * max(late.values()):.0f} ms later than in the model: a "
            "servo takes its time, and there is no delay or lag to take that from"
        )


def _axis(model: Model, axis: str) -> Axis:
    effects = {one.name: one.parameters for one in model.effects}
    other = "y" if axis == "x" else "x"
    gear = {each: model.parameters[f"gear_{each}"].value for each in "xy"}
    matrix, coupling = (effects.get(name, {}) for name in ("gear_matrix", "cross_coupling"))
    mixed = matrix.get(f"{axis}_from_{other}", 0.0) + gear[other] * coupling.get(f"{axis}_from_{other}", 0.0)
    delay = _of_axis(effects.get("delay", {}), "delay_s", "y_minus_x_s", axis)
    lag = _of_axis(effects.get("lag", {}), "time_constant_s", "y_minus_x_s", axis)
    second = effects.get("second_order_lag")
    servo, ratio, late = SERVO_S, 1.0, 2.0 * SERVO_S
    if second is not None:
        servo = max(_of_axis(second, "time_constant_s", "y_minus_x_s", axis), SERVO_S / 2.0)
        ratio, late = second.get("damping_ratio", 1.0), 0.0
    # The servo's own lateness comes off the delay, else off a lag that is longer.
    from_delay = min(delay, late)
    late -= from_delay
    from_lag = late if lag > 2.0 * late else 0.0
    return Axis(
        delay_s=delay - from_delay,
        lag_s=lag - from_lag,
        servo_s=servo,
        damping_ratio=ratio,
        width=effects.get("backlash", {}).get(f"width_{axis}_rad", 0.0),
        gears={axis: gear[axis], other: mixed},
        cubic=gear[axis]
        * _of_axis(
            effects.get("gear_nonlinearity", {}), "cubic_per_rad2", "y_minus_x_per_rad2", axis, least=None
        ),
        bias_rad=sum(
            effects.get(name, {}).get(f"{word}_{axis}_rad", 0.0)
            for name, word in (("tilt_bias", "bias"), ("lean", "lean"))
        ),
        late_s=late - from_lag,
    )


def _of_axis(
    values: Mapping[str, float], mean: str, difference: str, axis: str, *, least: float | None = 0.0
) -> float:
    """Return what a parameter is about an axis, given its mean and by how much it differs about y."""
    half = 0.5 * values.get(difference, 0.0)
    value = values.get(mean, 0.0) + (half if axis == "y" else -half)
    return value if least is None else max(value, least)
