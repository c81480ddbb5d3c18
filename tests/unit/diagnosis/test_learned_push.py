"""Physics outside the catalogue is found in the residuals and learned inside the simulator."""

from dataclasses import replace

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis import config
from irt.diagnosis.dataset import Dataset
from irt.diagnosis.formula import formula, variables
from irt.diagnosis.learned import Corrections
from irt.diagnosis.regressors import terms_of_motion
from irt.diagnosis.result import UNLISTED
from irt.diagnosis.score import LASTING, LASTING_S, PULL, PUSH, Scores
from irt.diagnosis.selection import Selection
from irt.engine import rollouts

#: The planted parameters of `plant`, and its tracker's noise [board edges].
TRUTH, NOISE = (0.06, 0.05, 4e-4, 15.0, 1.03), 1e-3


def quiet(_text: str) -> None:
    """Ignore progress."""


def wave(**changes):
    values = {"push_1_x_m_per_s2": 0.02, "wave_1_x_per_m": 100.0, "phase_1_rad": 0.5, **changes}
    return {"name": UNLISTED, **values}


def likely(dataset):
    base = Scores(dataset).base()
    return terms_of_motion(base, base)


def likeliest(dataset):
    return likely(dataset)[0]


def learned(dataset):
    """Return the five-parameter model, without and with a learned correction."""
    base = Scores(dataset).base()
    return base, Corrections(Scores.of(base), quiet).of(base)


@pytest.mark.slow
def test_a_wave_over_the_board_is_found_with_its_length(plant):
    dataset = plant([wave()], runs=6)
    first = likeliest(dataset)
    assert first.variable == "position"
    assert np.hypot(first.values["wave_1_x_per_m"], first.values["wave_1_y_per_m"]) == pytest.approx(
        100.0, rel=0.1
    )


@pytest.mark.slow
def test_a_push_that_comes_and_goes_with_time_is_found_with_its_rate(plant):
    gust = {"name": UNLISTED, "push_1_y_m_per_s2": 0.02, "rate_1_per_s": 9.0}
    dataset = plant([gust], runs=6)
    base = Scores(dataset).base()
    first = terms_of_motion(base, base)[0]
    assert first.variable == "time"
    time_scale = base.values["time_scale"]
    # Without stamps time is known up to the time scale.
    assert first.values["rate_1_per_s"] * time_scale == pytest.approx(9.0 * 15.0, rel=0.1)


@pytest.mark.slow
def test_a_push_by_the_tilt_is_found(plant):
    swing = {
        "name": UNLISTED,
        "push_1_x_m_per_s2": 0.01,
        "tilt_1_x_per_rad": 300.0,
        "tilt_1_y_per_rad": 200.0,
    }
    dataset = plant([swing], runs=6)
    first = likeliest(dataset)
    assert first.variable == "command"


@pytest.mark.slow
def test_drag_is_a_power_of_the_speed(plant):
    dataset = plant([{"name": "viscous_drag", "rate_per_s": 1.0}], runs=6, rows=120)
    first = likeliest(dataset)
    assert first.variable == "velocity"
    assert first.values["drag_strength"] > 0.0
    assert first.values["drag_power"] in {0.5, 1.0, 1.5}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_noise_has_no_likely_term(plant, seed):
    assert likely(plant(runs=6, seed=seed)) == []


@pytest.mark.slow
@pytest.mark.parametrize("pushed", [0.0, 0.05])
def test_neither_noise_nor_a_random_push_teaches_anything(plant, pushed):
    _, found = learned(plant(runs=6, stamped=True, pushed=pushed))
    assert found is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planted", "family"),
    [
        (
            {"shape_1": 1.0, "push_1_x_m_per_s2": 0.005, "wave_1_x_per_m": 150.0, "phase_1_rad": 0.5},
            ("position", "push"),
        ),
        (
            {
                "shape_1": 4.0,
                "brake_1_m_per_s2": 0.1,
                "drag_power": 1.0,
                "wave_1_x_per_m": 30.0,
                "across_1_rad": 0.3,
            },
            ("position", "brake"),
        ),
        (
            {"shape_1": 5.0, "brake_1_m_per_s2": 0.3, "drag_power": 1.0, "way_1_per_m": 2.0},
            ("way", "brake"),
        ),
        (
            {
                "shape_1": 5.0,
                "brake_1_m_per_s2": 0.05,
                "drag_power": 1.0,
                "heading_1_x": 0.9,
                "phase_1_rad": 1.0,
            },
            ("heading", "brake"),
        ),
        (
            {
                "shape_1": 7.0,
                "push_1_x_m_per_s2": 0.005,
                "push_1_y_m_per_s2": 0.007,
                "tilt_1_x_per_rad": 300.0,
            },
            ("command", "push"),
        ),
        (
            {"shape_1": 5.0, "gear_1_x": -0.2, "gear_1_y": 0.4, "rate_1_per_s": 0.5},
            ("time", "gear"),
        ),
        ({"mode_gain": 1.0, "mode_rate_rad_per_s": 6.0, "mode_damping": 0.1}, ("command", "mode")),
        (
            {
                "yield_lag_s": 0.2,
                "yield_x": 0.8,
                "yield_y": 0.6,
                "yield_x_s_per_rad": 100.0,
                "yield_y_s_per_rad": 80.0,
            },
            ("command", "yield"),
        ),
    ],
    ids=["step", "spot", "way", "heading", "saddle", "gear", "mode", "yield"],
)
def test_what_is_planted_is_learned_first_and_needs_no_push(plant, planted, family):
    base, found = learned(plant([{"name": UNLISTED, **planted}], runs=6, rows=100, stamped=True))
    assert found.terms[0].family == family
    assert found.effects == (UNLISTED,)
    assert found.score > base.score + config.SURE
    assert Scores.of(found).push(found) < Scores(base.dataset).push(base)
    assert found.fitted.noise < base.fitted.noise


@pytest.mark.slow
def test_a_drive_that_yields_is_learned_where_the_other_axis_rests(plant):
    drive = {"name": UNLISTED, "yield_lag_s": 0.2, "yield_y": 0.8, "yield_y_s_per_rad": 100.0}
    rig, random = plant(runs=6, rows=100, stamped=True).rig, np.random.default_rng(1)
    recordings = []
    for one in rig.recordings:
        knobs = one.knobs * [0.0, 1.0]
        marble = rollouts([TRUTH], knobs, effects=[drive], start=one.marble[0])[0]
        marble = marble + NOISE * random.standard_normal(marble.shape)
        recordings.append(replace(one, knobs=knobs, marble=marble))
    base, found = learned(Dataset.of(replace(rig, recordings=tuple(recordings))))
    assert found.terms[0].family == ("command", "yield")
    assert found.values["unlisted.yield_lag_s"] == pytest.approx(0.2, abs=0.03)
    assert found.fitted.noise < 1.3 * base.dataset.noise < base.fitted.noise


@pytest.mark.slow
@pytest.mark.parametrize("size", [1.0, 6.0])
def test_a_picture_that_turns_is_learned_from_small_and_large_angles(plant, size):
    rates = {"picture_turn_x": 8.0 * size, "picture_turn_y": -5.0 * size, "picture_growth_x_per_rad": 2.0}
    base, found = learned(plant([{"name": UNLISTED, **rates}], runs=6, rows=100, stamped=True))
    assert found.terms[0].family == ("command", "picture")
    assert found.score > base.score + config.SURE
    assert found.fitted.noise < 1.3 * base.dataset.noise < base.fitted.noise
    values = found.fitted.value_of(UNLISTED)
    assert {name: values[name] for name in rates} == pytest.approx(rates, abs=1.0)


@pytest.mark.slow
def test_a_correction_is_looked_for_where_the_marble_moves(plant):
    """At a maximum without motion, correlated noise is the whole path, and no residual shows the picture."""
    rates = {"picture_turn_x": 36.0, "picture_turn_y": -25.2, "picture_growth_y_per_rad": 3.0}
    scores = Scores(plant([{"name": UNLISTED, **rates}], runs=4))
    moving = scores.base()
    values, noise = moving.top.values.copy(), moving.noise.copy()
    values[:4] = *np.copysign(0.02, values[:2]), 3e-4, 0.5
    noise[[LASTING, LASTING_S, PUSH, PULL]] = 0.03, 0.15, 1e-10, 1e-5
    (resting,) = scores.ascend((), values[None], noise[None], iterations=config.THOROUGH)
    scores.known[frozenset()] = resting
    assert resting.fitted.noise > 1.5 * moving.fitted.noise

    corrections = Corrections(scores, quiet)
    found = corrections.alone()
    assert found.terms[0].family == ("command", "picture")
    assert found.is_exact
    assert corrections.of(resting).score < found.score - config.NEAR


@pytest.mark.slow
def test_one_complete_term_ends_the_search_for_effects_that_imitate_it(plant):
    waves = wave(push_1_x_m_per_s2=0.06, wave_1_x_per_m=60.0)
    scores = Scores(plant([waves], rows=80, stamped=True))
    corrections = Corrections(scores, quiet)
    answers = []

    def is_beaten(one, is_last):
        answers.append(corrections.beat(one, is_last))
        return answers[-1]

    names = ["board_warp", "point_field", "bump", "camera_offset", "slope_map"]
    found = Selection(scores, names, quiet).run(is_beaten).best
    assert answers == [True]
    assert len(found.effects) == 2
    assert corrections.of(scores.base()).score > found.score + config.NEAR


@pytest.mark.slow
@pytest.mark.parametrize(
    "planted",
    [
        [{"name": "viscous_drag", "rate_per_s": 0.3}, {"name": "quadratic_drag", "coefficient_per_m": 60.0}],
        [
            {"name": "tilt_bias", "bias_x_rad": 0.003, "bias_y_rad": -0.002},
            {"name": "delay", "delay_s": 0.12},
        ],
    ],
    ids=["two drags that one term explains", "effects that two terms explain"],
)
def test_no_correction_ends_the_search_for_effects_that_it_imitates(plant, planted):
    scores = Scores(plant(planted, runs=6, rows=200, stamped=True))
    names = ["delay", "lag", "tilt_bias", "viscous_drag", "quadratic_drag"]
    found = Selection(scores, names, quiet).run(Corrections(scores, quiet).beat).best
    assert set(found.effects) == {one["name"] for one in planted}


@pytest.mark.slow
def test_what_is_learned_simulates_and_leaves_noise(plant):
    base, found = learned(plant([wave()], runs=6, stamped=True))
    assert found.fitted.noise < 1.3 * base.dataset.noise < base.fitted.noise
    values = found.fitted.value_of(UNLISTED)
    assert set(values) == {one.name for one in effect(UNLISTED).parameters}
    assert values["push_1_x_m_per_s2"] == pytest.approx(0.02, rel=0.2)
    assert values["push_2_x_m_per_s2"] == 0.0
    assert "cos(" in formula(values)
    assert variables(values) == ["position"]


@pytest.mark.slow
def test_what_is_left_of_a_first_wave_is_learned_next(plant):
    first = {"push_1_x_m_per_s2": 0.01, "wave_1_x_per_m": 60.0, "phase_1_rad": 0.5}
    second = {"push_2_y_m_per_s2": 0.006, "wave_2_y_per_m": 100.0}
    _, found = learned(plant([{"name": UNLISTED, **first, **second}], runs=6, stamped=True))
    assert len(found.terms) == 2
    assert found.fitted.noise < 1.3 * found.dataset.noise
    assert variables(found.fitted.value_of(UNLISTED)) == ["position"]


@pytest.mark.slow
def test_what_is_learned_stands_beside_effects_that_are_known(plant):
    bias = {"name": "tilt_bias", "bias_x_rad": 0.0015, "bias_y_rad": -0.001}
    scores = Scores(plant([wave(), bias], runs=6, stamped=True))
    base = scores.base()
    begin = np.append(base.top.values, [0.0015, -0.001])[None]
    (known,) = scores.ascend(("tilt_bias",), begin, base.noise[None], base.top.states, iterations=25)
    found = Corrections(Scores.of(known), quiet).of(known)
    assert found.effects == ("tilt_bias", UNLISTED)
    assert found.values["tilt_bias.bias_x_rad"] == pytest.approx(0.0015, rel=0.1)
    assert found.score > known.score + config.SURE
