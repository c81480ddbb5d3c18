"""With a measured tilt, the actuator and the board are fitted separately."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irt.fitting.chain import is_chain, without_held_marbles
from irt.fitting.least_squares import least_squares
from irt.fitting.picture_error import scale_error
from irt.model import Effect
from irt.residual import evaluate
from tilted_rigs import TILT_NOISE_RAD, TRACKER_NOISE, VALUES, ZERO, rig_of, tilted_recordings

ACTUATOR = [
    {"name": "delay", "delay_s": 0.07},
    {"name": "lag", "time_constant_s": 0.1, "y_minus_x_s": 0.08},
    {"name": "tilt_bias", "bias_x_rad": 0.002, "bias_y_rad": -0.003},
]
ASKED = [Effect(one["name"], {}) for one in ACTUATOR]


def without_marble(recordings):
    return [replace(one, marble=np.full_like(one.marble, np.nan)) for one in recordings]


@pytest.fixture(scope="module")
def recordings():
    return tilted_recordings(ACTUATOR)


@pytest.fixture(scope="module")
def fitted(recordings):
    return least_squares(rig_of(recordings), effects=ASKED, starts=4)


def test_planted_values_come_back(fitted) -> None:
    found = {name: parameter.value for name, parameter in fitted.model.parameters.items()}
    np.testing.assert_allclose([found["gear_x"], found["gear_y"]], VALUES[:2], rtol=0.03)
    assert found["rolling_friction"] == pytest.approx(VALUES[2], abs=5e-4)
    effects = {one.name: one.parameters for one in fitted.model.effects}
    assert effects["delay"]["delay_s"] == pytest.approx(0.07, abs=0.005)
    assert effects["lag"]["time_constant_s"] == pytest.approx(0.1, abs=0.01)
    assert effects["tilt_bias"]["bias_x_rad"] == pytest.approx(0.002, abs=4e-4)
    assert effects["tilt_bias"]["bias_y_rad"] == pytest.approx(-0.003, abs=4e-4)
    zero = [effects["tilt_sensor"][f"zero_{axis}_rad"] for axis in "xy"]
    np.testing.assert_allclose(zero, ZERO, atol=5e-4)


def test_draws_agree_with_the_intervals_of_both_halves(fitted) -> None:
    drawn = fitted.model.sample(400)
    stated = {**fitted.model.parameters}
    stated |= {f"{name}.{key}": one for name, own in fitted.effects.items() for key, one in own.items()}
    values = [
        {
            **{name: one.value for name, one in each.parameters.items()},
            **{f"{one.name}.{key}": value for one in each.effects for key, value in one.parameters.items()},
        }
        for each in drawn
    ]
    compared = 0
    for name, one in stated.items():
        if one.low is None or one.low == one.high:
            continue
        low, high = np.quantile([each[name] for each in values], [0.025, 0.975])
        # No draw has another picture, of which no recording shows that its scale is wrong.
        noise = TRACKER_NOISE if name == "observation_scale" else 0.0
        width = np.hypot(high - low, 2.0 * 1.96 * scale_error(fitted.model, noise) * one.value)
        assert width == pytest.approx(one.high - one.low, rel=0.25), name
        assert low <= one.value <= high, name
        compared += 1
    assert compared >= 6


def test_the_difference_between_axes_is_opened_where_there_is_one(fitted) -> None:
    effects = {one.name: one.parameters for one in fitted.model.effects}
    assert effects["lag"]["y_minus_x_s"] == pytest.approx(0.08, abs=0.02)
    parameter = fitted.effects["lag"]["y_minus_x_s"]
    assert parameter.low < 0.08 < parameter.high


def test_axes_that_are_alike_stay_tied() -> None:
    alike = [ACTUATOR[0], {"name": "lag", "time_constant_s": 0.1}]
    result = least_squares(rig_of(tilted_recordings(alike, seed=3)), effects=ASKED[:2], starts=4)
    for one in result.model.effects:
        assert not any(name.startswith("y_minus_x") for name in one.parameters), one


def test_an_evaluation_scores_the_tilt_and_plays_it(fitted, recordings) -> None:
    evaluation = evaluate(fitted.model, tilted_recordings(ACTUATOR, seed=7), window_s=1.0)
    noise = np.sqrt(2.0 / np.pi) * TILT_NOISE_RAD
    assert evaluation.tilt.mae_x_rad < 1.4 * noise
    assert evaluation.tilt.mae_y_rad < 1.4 * noise
    assert evaluation.tilt.rows == 4 * 150
    assert evaluation.played.rows == evaluation.windowed.rows
    assert evaluation.windowed.mae < 20 * TRACKER_NOISE
    assert evaluation.played.mae < 20 * TRACKER_NOISE


def test_tilt_alone_is_enough_for_the_actuator(recordings) -> None:
    result = least_squares(rig_of(without_marble(recordings)), effects=ASKED, starts=4)
    effects = {one.name: one.parameters for one in result.model.effects}
    np.testing.assert_allclose(result.model.values[:2], VALUES[:2], rtol=0.03)
    assert effects["delay"]["delay_s"] == pytest.approx(0.07, abs=0.01)
    assert any("No recording has both a moving marble" in note for note in result.notes)
    evaluation = evaluate(result.model, without_marble(recordings))
    assert evaluation.free_run is None
    assert evaluation.played is None
    assert evaluation.tilt.mae_x_rad < 2 * TILT_NOISE_RAD


def test_a_marble_in_a_hole_is_not_used(recordings) -> None:
    rng = np.random.default_rng(0)
    place = 0.1 + rng.normal(0.0, TRACKER_NOISE, recordings[0].marble.shape)
    rig = rig_of([replace(recordings[0], marble=place), *recordings[1:]])
    assert [one.has_marble for one in without_held_marbles(rig).recordings] == [False, True, True, True]


@pytest.mark.slow
def test_gaps_of_the_tilt_cost_little(recordings) -> None:
    def gappy(recording):
        tilt = recording.tilt.copy()
        tilt[40:60] = np.nan
        tilt[::7, 1] = np.nan
        return replace(recording, tilt=tilt)

    result = least_squares(rig_of([gappy(one) for one in recordings]), effects=ASKED, starts=4)
    effects = {one.name: one.parameters for one in result.model.effects}
    assert effects["delay"]["delay_s"] == pytest.approx(0.07, abs=0.01)


def test_a_tilt_about_one_axis_is_no_chain(recordings) -> None:
    half = recordings[0].tilt.copy()
    half[:, 0] = np.nan
    assert not is_chain(rig_of([replace(recordings[0], tilt=half)]))
    assert is_chain(rig_of(recordings))


def test_threads_do_not_matter(recordings) -> None:
    one, two = (least_squares(rig_of(recordings[:2]), effects=ASKED[:1], starts=2, threads=n) for n in (1, 2))
    assert one.model == two.model
