"""The screened gain of effects before they are fitted."""

from dataclasses import replace

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis.hypotheses import hypotheses
from irt.diagnosis.score import Scores
from irt.diagnosis.screening import Screening, draws, place_of

ASKED = ("viscous_drag", "tilt_bias", "backlash", "lag", "parallax", "bump", "stribeck")


def screened(dataset):
    scores = Scores(dataset)
    return Screening(scores, scores.base())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("viscous_drag", {"rate_per_s": 0.8}),
        ("lag", {"time_constant_s": 0.15}),
        ("parallax", {"height_m_per_rad": 0.4}),
        ("tilt_bias", {"bias_x_rad": 0.002, "bias_y_rad": -0.001}),
    ],
)
def test_the_effect_that_acts_promises_about_most(plant, name, values):
    dataset = plant([{"name": name, **values}], runs=6, stamped=True)
    promises = screened(dataset).promises(ASKED)
    # A lagging board resembles a picture that rotates with the tilt.
    assert name in [one.name for one in promises[:2]]
    (own,) = [one for one in promises if one.name == name]
    assert own.gain > 15.0
    assert own.gain > promises[2].gain + 5.0


def test_where_nothing_acts_no_effect_promises_much(plant):
    best = screened(plant(stamped=True)).promises(ASKED)[0]
    # Noise gains about half a nat per parameter.
    assert best.gain < 12.0


@pytest.mark.slow
def test_a_bump_is_looked_for_where_it_is(plant):
    bump = {"name": "bump", "x_m": 0.02, "y_m": -0.015, "height_m": 3e-4, "width_m": 0.02}
    (promise,) = screened(plant([bump], runs=6, stamped=True)).promises(["bump"])
    places = promise.starts[:, -4:-2]
    assert np.hypot(places[:, 0] - 0.02, places[:, 1] + 0.015).min() < 0.03


def test_an_effect_with_a_place_is_also_tried_at_the_one_given(plant):
    field = {"name": "point_field", "x_m": 0.05, "y_m": -0.03, "strength_m3_per_s2": 2e-4}
    scores = Scores(plant([field], runs=6, stamped=True))
    base = scores.base()
    gains = {}
    for place in (None, (0.05, -0.03), (-0.1, 0.1)):
        field, drag = Screening(scores, base, place).promises(["point_field", "viscous_drag"])
        gains[place] = field.gain
        if drag.name == "viscous_drag":
            assert drag.gain < field.gain
    assert gains[(0.05, -0.03)] > gains[None] + 5.0
    # More draws never promise less.
    assert gains[(-0.1, 0.1)] >= gains[None]


def test_start_states_of_recordings_in_motion_are_no_evidence(plant, in_motion):
    """They were fitted without the effect, and may hold a part of what it does."""
    late = {"name": "lag", "time_constant_s": 0.15}
    scores = Scores(in_motion(plant([late], runs=4, rows=120, stamped=True), 20))
    base = scores.base()
    elsewhere = replace(
        base, top=replace(base.top, states=base.top.states + np.array([0.0, 0.0, 0.05, -0.05]))
    )
    promised, again = (Screening(scores, one).promises(["lag", "parallax"]) for one in (base, elsewhere))
    assert [one.gain for one in promised] == [one.gain for one in again]
    assert promised[0].name == "lag"
    assert promised[0].gain > 10.0


def test_only_effects_with_a_place_have_one():
    assert place_of("bump", {"bump.x_m": 0.1, "bump.y_m": -0.2, "bump.height_m": 1e-4}) == (0.1, -0.2)
    assert place_of("slope_map", {}) is None
    assert place_of("viscous_drag", {"viscous_drag.rate_per_s": 1.0}) is None


def test_steps_of_a_knob_are_found_although_a_hundredth_beside_them_nothing_fits(plant):
    step = 0.0131
    (promise,) = screened(
        plant([{"name": "command_quantisation", "step_rad": step}], runs=6, stamped=True)
    ).promises(["command_quantisation"])
    assert abs(promise.starts[:, -1] - step).min() < 0.01 * step
    assert promise.gain > 15.0


def test_a_larger_effect_shows_more(plant):
    sizes = np.array([[0.05], [0.2], [0.8]])
    shown = screened(plant(stamped=True)).shown("viscous_drag", sizes)
    assert (shown > 0.0).all()
    assert (np.diff(shown) > 0.0).all()


@pytest.mark.parametrize("name", [name for name in hypotheses() if name != "delay_jitter"])
def test_draws_stay_within_what_physics_allows_and_are_the_same_for_a_seed(name):
    drawn = draws(effect(name), 32, 5)
    np.testing.assert_array_equal(drawn, draws(effect(name), 32, 5))
    assert not np.array_equal(drawn, draws(effect(name), 32, 6))
    for one, column in zip(effect(name).required, drawn.T, strict=True):
        if one.is_choice:
            assert set(column) <= set(one.choices)
        else:
            # Sizes include negligible ones.
            assert (column >= min(one.low, one.neutral)).all()
            assert (column <= max(one.high, one.neutral)).all()
