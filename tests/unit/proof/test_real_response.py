"""The response of a board in numbers that models with different effects share."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.model import Effect, Model
from irt.posterior import Component, Spread
from irt.proof.real.response import Estimate, compared, quantities, response, widened
from irt.rig import RANGES, Board, Marble

FIVE = {
    "gear_x": 0.9,
    "gear_y": -1.1,
    "rolling_friction": 0.0005,
    "time_scale": 8.0,
    "observation_scale": 1.0,
}


def model(*effects: Effect, posterior: tuple[Component, ...] = ()) -> Model:
    from irt.model import Parameter  # noqa: PLC0415

    return Model(
        Board(),
        Marble(),
        "moving",
        dict(RANGES),
        {name: Parameter(value) for name, value in FIVE.items()},
        effects,
        posterior=posterior,
    )


def test_each_axis_has_its_own_times_and_play() -> None:
    found = quantities(
        FIVE,
        {
            "delay": {"delay_s": 0.1, "y_minus_x_s": 0.04},
            "lag": {"time_constant_s": 0.05},
            "backlash": {"width_x_rad": 0.02, "width_y_rad": 0.01},
            "tilt_bias": {"bias_x_rad": 0.003, "bias_y_rad": -0.002},
        },
    )
    assert [found["delay", axis] for axis in "xy"] == pytest.approx([0.08, 0.12])
    assert [found["late", axis] for axis in "xy"] == pytest.approx([0.13, 0.17])
    # Play is an angle of the board, whichever way the gear turns.
    assert [found["play", axis] for axis in "xy"] == pytest.approx([0.018, 0.011])
    assert [found["zero", axis] for axis in "xy"] == [0.003, -0.002]
    assert found["gain", "y"] == -1.1


def test_a_second_order_lag_is_as_late_as_its_step_response() -> None:
    """The mean delay of a step response is the integral of one minus it."""
    time_constant, damping = 0.08, 0.6
    times = np.arange(0.0, 3.0, 1e-4)
    ringing = math.sqrt(1.0 - damping**2)
    phase = ringing * times / time_constant
    decay = np.exp(-damping * times / time_constant)
    rest = decay * (np.cos(phase) + damping / ringing * np.sin(phase))
    effects = {"second_order_lag": {"time_constant_s": time_constant, "damping_ratio": damping}}
    assert quantities(FIVE, effects)["late", "x"] == pytest.approx(rest.sum() * 1e-4, rel=1e-3)


def test_effects_that_are_absent_count_as_zero() -> None:
    found = response(model())
    assert {key for key, one in found.items() if one.value} == {("gain", "x"), ("gain", "y")}
    assert not any(one.has_interval for one in found.values())


def test_intervals_come_from_all_sets_of_the_posterior() -> None:
    sets = (
        Component(
            0.6,
            ("delay",),
            {"delay.delay_s": Spread(0.1, linear=(0.01,), power=(0.0,)), "gear_x": Spread(0.9)},
        ),
        Component(0.4, ("lag",), {"lag.time_constant_s": Spread(0.12, linear=(0.01,), power=(0.0,))}),
    )
    found = response(model(Effect("delay", {"delay_s": 0.1}), posterior=sets))
    # The delay is 0 wherever the lag acts instead.
    assert found["delay", "x"].low == 0.0
    assert found["delay", "x"].high == pytest.approx(0.117, abs=0.004)
    assert found["late", "x"].low > 0.07
    assert found["late", "x"].contains(0.12)
    assert found["gain", "x"] == Estimate(0.9, 0.9, 0.9)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.05, 0.15), min_size=3, max_size=8))
def test_widened_intervals_hold_the_curvature_the_row_and_the_jackknife(values: list[float]) -> None:
    whole = {("delay", "x"): Estimate(0.1, 0.099, 0.101), ("gain", "x"): Estimate(0.1)}
    parts = [{key: Estimate(value) for key in whole} for value in values]
    found = widened(whole, parts, 0.01)
    delay, gain = found["delay", "x"], found["gain", "x"]
    assert delay.low <= 0.09 + 1e-12
    assert delay.high >= 0.11 - 1e-12
    assert gain.low <= gain.value <= gain.high
    # With the ordinary t of two degrees of freedom or more, one deviation of the jackknife is inside.
    deviation = math.sqrt((len(values) - 1) * np.var(values))
    assert gain.high - gain.value >= deviation - 1e-12
    assert delay.low >= 0.0


def test_without_a_third_recording_only_times_are_widened() -> None:
    whole = {("delay", "x"): Estimate(0.1, 0.099, 0.101), ("play", "x"): Estimate(0.01, 0.009, 0.011)}
    found = widened(whole, [], 0.01)
    assert (found["delay", "x"].low, found["delay", "x"].high) == pytest.approx((0.09, 0.11))
    assert found["play", "x"] == Estimate(0.01, 0.009, 0.011)


def test_a_comparison_says_whether_the_measured_value_is_inside() -> None:
    predicted, measured = response(model()), response(model())
    predicted["zero", "x"] = Estimate(0.0, -0.001, 0.001)
    for value, holds, overlaps in ((0.0005, True, True), (0.0015, False, True), (0.004, False, False)):
        measured["zero", "x"] = Estimate(value, value - 0.001, value + 0.001)
        one = next(
            one for one in compared(predicted, measured) if (one.quantity.name, one.axis) == ("zero", "x")
        )
        assert (one.holds, one.overlaps) == (holds, overlaps)
        assert one.as_dict()["measured_inside_interval"] is holds


def test_a_gain_has_the_unit_of_the_commands() -> None:
    both = response(model()), response(model())
    assert {one.quantity.unit for one in compared(*both) if one.quantity.name == "gain"} == {""}
    assert {one.quantity.unit for one in compared(*both, "mA") if one.quantity.name == "gain"} == {"rad/mA"}
