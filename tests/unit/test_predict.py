"""A model predicts with all its physics, and its effects are never dropped without a word."""

from dataclasses import replace

import numpy as np
import pytest

import irt
from irt.model import Model
from simulated_rigs import STEP_S, TRUTH, drive

KNOBS = drive(80, 3)
EFFECTS = (
    irt.Effect("delay", {"delay_s": 0.2}),
    irt.Effect("backlash", {"width_x_rad": 0.02, "width_y_rad": 0.03}),
)
STAMPS = STEP_S * np.arange(80)


def model(**fields):
    rig = irt.Rig.from_recordings([{"knob_x_rad": KNOBS[:, 0], "knob_y_rad": KNOBS[:, 1], **PLACES}])
    return replace(Model.from_rig(rig, TRUTH[0], effects=EFFECTS, time_step="continuous"), **fields)


PLACES = {"marble_x": np.full(80, 0.1), "marble_y": np.full(80, -0.05)}
NAMED = [{"name": one.name, **one.parameters} for one in EFFECTS]


def test_predicts_with_its_effects():
    found = model().predict(KNOBS, start=[0.1, -0.05])
    expected = irt.rollouts(TRUTH, KNOBS, effects=NAMED, time_step="continuous", start=[0.1, -0.05])[0]
    np.testing.assert_array_equal(found, expected)
    plain = irt.rollouts(TRUTH, KNOBS, time_step="continuous", start=[0.1, -0.05])[0]
    assert np.abs(found - plain).max() > 0.01


def test_rollouts_of_a_model_are_its_predictions():
    np.testing.assert_array_equal(irt.rollouts(model(), KNOBS)[0], model().predict(KNOBS))
    both = np.stack([KNOBS, KNOBS[::-1]])
    np.testing.assert_array_equal(irt.rollouts(model(), both), model().predict(both))


def test_parameters_beside_a_model_with_effects_are_refused():
    with pytest.raises(irt.IrtError, match="this model has effects"):
        irt.rollouts(TRUTH, KNOBS, rig=model())
    plain = irt.rollouts(TRUTH, KNOBS, rig=model(), effects=())
    np.testing.assert_array_equal(plain, irt.rollouts(TRUTH, KNOBS, rig=model(effects=())))


@pytest.mark.parametrize("option", [{"rig": irt.Board}, {"effects": ()}, {"time_step": "rounded"}])
def test_what_a_model_brings_is_not_given_again(option):
    with pytest.raises(irt.IrtError, match="a model has its own"):
        irt.rollouts(model(), KNOBS, **option)


@pytest.mark.parametrize("stamped", [True, False])
def test_a_table_brings_its_start_and_its_stamps(stamped):
    table = {"knob_x_rad": KNOBS[:, 0], "knob_y_rad": KNOBS[:, 1], **PLACES}
    stamps = 1.1 * STAMPS
    if stamped:
        table["t_s"] = stamps
    expected = model().predict(KNOBS, start=[0.1, -0.05], t=stamps if stamped else None)
    np.testing.assert_array_equal(model().predict(table), expected)
    recording = irt.Rig.from_recordings([table]).recordings[0]
    np.testing.assert_array_equal(model().predict(recording), expected)


def test_observation_scale_is_part_of_what_is_seen():
    scaled = model(parameters={**model().parameters, "observation_scale": irt.Parameter(1.1)}, effects=())
    np.testing.assert_allclose(
        scaled.predict(0.1 * KNOBS), 1.1 * model(effects=()).predict(0.1 * KNOBS), atol=1e-9
    )


def test_the_tilt_comes_with_rollouts():
    marble, tilt = irt.rollouts(model(), KNOBS, tilt=True)
    assert marble.shape == tilt.shape == (1, 80, 2)
    np.testing.assert_array_equal(marble[0], model().predict(KNOBS))


def test_a_moving_start_holds_the_first_command_before():
    moving = model(start="moving")
    shifted = KNOBS + np.array([0.05, -0.03])
    expected = irt.rollouts(
        TRUTH,
        shifted,
        effects=NAMED,
        time_step="continuous",
        knobs_before=shifted[0],
        start_velocity=[0.1, 0.0],
    )[0]
    np.testing.assert_array_equal(moving.predict(shifted, start_velocity=[0.1, 0.0]), expected)


@pytest.mark.parametrize(
    ("commands", "options", "message"),
    [
        (np.zeros((5, 3)), {}, "commands: expected shape"),
        ("knobs.csv", {}, "knobs.csv: no such file"),
        (KNOBS, {"t": STAMPS[:-1]}, "t: expected 80 rising times"),
        (KNOBS, {"t": STAMPS[::-1]}, "t: expected 80 rising times"),
        (KNOBS, {"start": [0.0, 0.0, 0.0]}, "start: expected shape"),
        (KNOBS, {"start": [320.0, 0.0]}, "start: 320 is not on the board"),
        (KNOBS, {"begin": [0.0, 0.0]}, 'unknown option of predict "begin"'),
        ({"knob_x_rad": [0.0, 0.1]}, {}, "column knob_y_rad is missing"),
    ],
)
def test_what_is_no_command_is_refused(commands, options, message):
    with pytest.raises(irt.IrtError, match=message):
        model().predict(commands, **options)
