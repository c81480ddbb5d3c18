"""The formula of a learned correction."""

import pytest

from irt.catalogue import effect
from irt.diagnosis.formula import formula, holds_or_brakes, turns, variables
from irt.diagnosis.result import UNLISTED


def neutral(**changes):
    return {one.name: one.neutral for one in effect(UNLISTED).parameters} | changes


@pytest.mark.parametrize(
    ("changes", "text", "depends"),
    [
        ({"shape_2": 1.0, "push_2_x_m_per_s2": 0.5, "rate_2_per_s": 2.0}, "0.5 e_x tanh(2 t)", ["time"]),
        (
            {"shape_1": 3.0, "push_1_y_m_per_s2": 0.5, "wave_1_x_per_m": 9.0, "phase_1_rad": -1.0},
            "0.5 e_y ridge(9 x - 1), ridge(s) = -s exp((1 - s^2)/2)",
            ["position"],
        ),
        (
            {"shape_1": 4.0, "brake_1_m_per_s2": 0.2, "wave_1_x_per_m": 9.0, "across_1_rad": 2.0},
            "-(0.2 exp(-((9 x)^2 + (9 y + 2)^2)/2)) (v / 0.1 m/s)^1 along v",
            ["position", "speed"],
        ),
        (
            {"shape_1": 7.0, "push_1_x_m_per_s2": 0.5, "tilt_1_x_per_rad": 3.0},
            "0.5 e_x (3 tilt_x) (3 tilt_y)",
            ["tilt"],
        ),
        ({"drag_strength": 0.3, "drag_power": 0.0}, "-(0.3) along v", ["speed"]),
        (
            {"drag_strength": 0.3, "shape_1": 5.0, "brake_1_m_per_s2": 0.1, "heading_1_y": 1.0},
            "-(0.3 + 0.1 (1 sin heading)) (v / 0.1 m/s)^1 along v",
            ["heading", "speed"],
        ),
        (
            {
                "push_1_x_m_per_s2": 0.005,
                "push_1_y_m_per_s2": -1e-6,
                "wave_1_x_per_m": -0.02,
                "wave_1_y_per_m": 90.0,
            },
            "0.005 e_x cos(90 y)",
            ["position"],
        ),
        (
            {"shape_1": 5.0, "gear_1_x": 0.1, "gear_1_y": -0.2, "rate_1_per_s": 3.0},
            "5/7 g (-0.2 tilt_y e_x - 0.1 tilt_x e_y) (3 t)",
            ["tilt", "time"],
        ),
        (
            {
                "push_1_x_m_per_s2": 4e-6,
                "push_1_y_m_per_s2": -3e-5,
                "wave_1_x_per_m": 26.0,
                "rate_1_per_s": 2.0,
                "push_2_x_m_per_s2": 0.0044,
                "wave_2_x_per_m": 108.0,
                "shape_3": 5.0,
                "push_3_x_m_per_s2": 1e-5,
                "wave_3_y_per_m": 900.0,
            },
            "0.0044 e_x cos(108 x) + 1e-05 e_x (900 y)",
            ["position"],
        ),
        (
            {"yield_lag_s": 0.2, "yield_y": 0.9, "yield_y_s_per_rad": 500.0, "yield_x_s_per_rad": 9.0},
            "5/7 g ((w_y (1 - 0.9 (1 - exp(-(500 w_y')^2/2))) - tilt_y) e_x - (w_x - tilt_x) e_y), "
            "w' = (tilt - w) / 0.2",
            ["tilt", "rate of the tilt"],
        ),
        ({"mode_gain": 1.0}, "5/7 g 1 (u - tilt), u'' = 100 (tilt - u) - 4 u'", ["tilt"]),
    ],
)
def test_a_formula_says_what_was_learned(changes, text, depends):
    assert formula(neutral(**changes)) == f"a = {text}"
    assert variables(neutral(**changes)) == depends


def test_forces_at_the_rim_are_no_push():
    rim = neutral(rim_hold_m_per_s2=0.2, rim_brake_m_per_s2=0.05, rim_drag_per_s=3.0)
    assert holds_or_brakes(rim)
    assert not holds_or_brakes(neutral(mode_gain=1.0))
    assert variables(rim) == []
    assert formula(rim) == "at the rim: a = 0.2 against leaving it and -(0.05 + 3 v) along v"
    assert not holds_or_brakes(neutral(rim_hold_m_per_s2=-0.1))
    assert formula(neutral(rim_drag_per_s=3.0, rim_brake_m_per_s2=-0.01)) == "at the rim: a = -(3 v) along v"


def test_a_picture_that_turns_is_no_push():
    turning = neutral(picture_turn_x=-18.0, picture_turn_y=0.01, picture_growth_y_per_rad=2.0)
    assert turns(turning)
    assert not turns(neutral(mode_gain=1.0))
    assert variables(turning) == []
    assert formula(turning) == "angle of the picture = -18 tilt_x; growth of the picture = 2 tilt_y"
    both = formula(turning | {"mode_gain": 1.0})
    assert both.startswith("a = 5/7 g")
    assert both.endswith(formula(turning))
