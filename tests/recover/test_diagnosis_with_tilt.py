"""A measured tilt decides what the marble's path alone cannot, and only that."""

from dataclasses import replace

import numpy as np
import pytest

from irt import diagnose
from irt.engine import SUBSTEP_S
from irt.rig import TiltSensor
from tilted_rigs import TILT_NOISE_RAD, ZERO, rig_of, tilted_recordings

pytestmark = pytest.mark.slow

#: Dead time and lag of a servo: the marble shows little more than their sum.
SERVO = ({"name": "delay", "delay_s": 0.08}, {"name": "lag", "time_constant_s": 0.07})


def tilted(effects=(), *, gain=1.0):
    """Return a rig in motion whose tilt is measured with this gain."""
    recordings = [replace(one, tilt=one.tilt * gain) for one in tilted_recordings(effects, runs=5, rows=150)]
    return replace(rig_of(recordings), tilt=TiltSensor(noise_rad=TILT_NOISE_RAD))


@pytest.fixture(scope="module")
def servo():
    return diagnose(tilted(SERVO))


def test_dead_time_and_lag_of_a_servo_are_both_found(servo):
    found = {one.name: one for one in servo.effects}
    assert set(found) == {"delay", "lag"}
    for name, key, truth in (("delay", "delay_s", 0.08), ("lag", "time_constant_s", 0.07)):
        parameter = found[name].parameters[key]
        assert parameter.low <= truth <= parameter.high
        # Engines differ by a step in when a command takes effect: what the tilt shows is no more certain.
        assert 1.99 * SUBSTEP_S < parameter.high - parameter.low < 0.02
        assert "latency" not in found[name].confusable_with


def test_it_is_predicted_in_recordings_that_were_held_out(servo):
    (said,) = [note for note in servo.notes if "measured tilt" in note]
    assert said.startswith(
        "From the commands alone, the answer predicts the measured tilt of held-out recordings"
    )
    assert "contradicts" not in said
    assert "do more than that" not in said


def test_the_gain_and_the_zero_of_the_sensor_are_no_missing_physics():
    found = diagnose(tilted(gain=1.15))
    assert found.verdict == "sufficient", found.summary


def test_a_tilt_that_stands_still_changes_nothing():
    rig = tilted(SERVO)
    still = tuple(replace(one, tilt=np.zeros_like(one.tilt)) for one in rig.recordings)
    with_still, without = diagnose(replace(rig, recordings=still)), diagnose(rig.of_marbles())
    assert with_still.summary == without.summary


def test_a_late_picture_is_no_late_command():
    (found,) = diagnose(tilted([{"name": "latency", "latency_s": 0.07}])).effects
    assert (found.name, found.confusable_with) == ("latency", ())
    parameter = found.parameters["latency_s"]
    assert parameter.low <= 0.07 <= parameter.high


def test_the_model_has_the_zero_of_the_sensor(servo):
    (sensor,) = [one for one in servo.model.effects if one.name == "tilt_sensor"]
    for axis, truth in zip("xy", ZERO, strict=True):
        assert sensor.parameters[f"zero_{axis}_rad"] == pytest.approx(truth, abs=5e-4)
    assert servo.model.sample(3, seed=0) is not None


@pytest.fixture(scope="module")
def swept():
    """Four recordings of the marble without a tilt, and two of the tilt without a marble."""
    recordings = tilted_recordings(SERVO, runs=6, rows=120)
    marbles = [replace(one, tilt=None) for one in recordings[:4]]
    sweeps = [replace(one, marble=np.full_like(one.marble, np.nan)) for one in recordings[4:]]
    return diagnose(replace(rig_of([*sweeps, *marbles]), tilt=TiltSensor(noise_rad=TILT_NOISE_RAD)))


def test_recordings_without_a_marble_decide_by_their_tilt(swept):
    found = {one.name: one for one in swept.effects}
    assert set(found) == {"delay", "lag"}
    assert found["delay"].confusable_with == ()
    assert found["delay"].parameters["delay_s"].value == pytest.approx(0.08, abs=2e-3)
    assert found["lag"].parameters["time_constant_s"].value == pytest.approx(0.07, abs=2e-3)


def test_they_are_said_to_be_fitted_and_not_held_out(swept):
    assert [one.recording for one in swept.runs] == ["run-1", "run-2", "run-3", "run-4"]
    (said,) = [note for note in swept.notes if "measured tilt" in note]
    assert said.startswith("run-5, run-6 have no marble. The measured tilt was fitted, never held out")
    (sensor,) = [one for one in swept.model.effects if one.name == "tilt_sensor"]
    assert sensor.parameters["zero_x_rad"] == pytest.approx(ZERO[0], abs=5e-4)
