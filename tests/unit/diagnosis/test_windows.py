"""What effects would change, beside what the base model leaves over."""

from dataclasses import replace

import numpy as np
import pytest

import irt
from irt.catalogue import effect
from irt.diagnosis.hypotheses import hypotheses, is_rough
from irt.diagnosis.screen import Screen
from irt.fitting.effect_size import size_of


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("bump", "height_m"),
        ("friction_patch", "factor"),
        ("point_field", "strength_m3_per_s2"),
        ("lag", "time_constant_s"),
    ],
)
def test_the_size_of_an_effect_is_the_parameter_without_which_there_is_none(name, size):
    assert effect(name).parameters[size_of(name)].name == size


@pytest.mark.parametrize("name", ["backlash", "tilt_bias"])
def test_where_parameters_act_alone_none_is_the_size(name):
    assert size_of(name) is None


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("viscous_drag", {"rate_per_s": 0.6}),
        ("side_force", {"rate_per_s": -0.5}),
        ("parallax", {"height_m_per_rad": 0.4}),
        ("tilt_bias", {"bias_x_rad": 0.002, "bias_y_rad": -0.001}),
    ],
)
def test_the_planted_effect_explains_most(plant, name, values):
    case = plant([{"name": name, **values}])
    screen = Screen(case, case.fit())
    shares = {info.name: screen.draws(info.name).explained[0] for info in irt.effects()}
    ranked = sorted(shares, key=lambda one: -shares[one])
    assert name in ranked[:5]
    assert shares[name] > 0.1


def test_a_bump_is_found_where_it_is(plant):
    bump = {"name": "bump", "x_m": 0.02, "y_m": -0.015, "height_m": 3e-4, "width_m": 0.02}
    case = plant([bump], runs=6)
    best = Screen(case, case.fit()).draws("bump").values[0]
    assert np.hypot(best[0] - 0.02, best[1] + 0.015) < 0.045


def test_only_steps_of_the_knob_are_rough():
    assert [name for name in hypotheses() if is_rough(name)] == ["command_quantisation"]


@pytest.mark.parametrize("step", [0.00909, 0.0153])
def test_the_step_of_a_knob_is_found_to_a_hundredth(plant, step):
    """Half a hundredth beside it the rounding is another one, and tells nothing."""
    case = plant([{"name": "command_quantisation", "step_rad": step}], runs=6)
    found = Screen(case, case.fit()).draws("command_quantisation")
    assert found.values[0, 0] == pytest.approx(step, rel=0.01)


def test_noise_alone_makes_misfits_of_one(plant):
    case = plant()
    assert np.median(Screen(case, case.fit(), 40).misfits()) == pytest.approx(1.0, abs=0.25)


def test_the_same_draws_for_the_same_seed(plant):
    case = plant([{"name": "lag", "time_constant_s": 0.1}])
    base = case.fit()
    first, second = (Screen(case, base).draws("lag") for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.explained, second.explained)


@pytest.mark.parametrize(("stamped", "reach"), [(None, 3.0), (15.0, 1.0)])
def test_without_stamps_times_and_speeds_are_drawn_as_far_as_the_clock_may_be_wrong(plant, stamped, reach):
    case = plant()
    fitted = case.fit(starts=2, rounds=1)
    screen = Screen(replace(case, time_scale=stamped), fitted)
    speed = effect("stribeck").parameters[1]
    drawn = screen.draws("stribeck").values[:, 1]
    assert speed.low / reach < drawn.min() < 1.3 * speed.low / reach
    assert 0.7 * speed.high * reach < drawn.max() < speed.high * reach
    place = effect("bump").parameters[0]
    assert np.abs(screen.draws("bump").values[:, 0]).max() <= place.high
