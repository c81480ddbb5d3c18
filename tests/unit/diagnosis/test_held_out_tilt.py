"""The measured tilt says which actuator is right."""

import re
from dataclasses import replace

import pytest

from irt.diagnosis.held_out_tilt import TiltPredictions
from irt.model import Effect, Model
from irt.rig import TiltSensor
from tilted_rigs import TILT_NOISE_RAD, VALUES, rig_of, tilted_recordings

LATE = {"name": "delay", "delay_s": 0.085}


@pytest.fixture(scope="module")
def rig():
    return replace(rig_of(tilted_recordings([LATE])), tilt=TiltSensor(noise_rad=TILT_NOISE_RAD))


def said_of(rig, named, base=(), tied=()):
    """Return what is said of an answer with these effects, and of what it may be confused with."""
    answer, five, *ties = [
        Model.from_rig(rig, VALUES, effects=effects, time_step="continuous")
        for effects in (named, base, *tied)
    ]
    count = len(rig.recordings)
    return TiltPredictions(
        rig.recordings, [answer] * count, [five] * count, ties, True, rig.tilt.noise_rad
    ).sentence()


def test_the_right_answer_predicts_it_to_its_noise_and_a_late_picture_does_not(rig):
    delay, latency = Effect("delay", {"delay_s": 0.085}), Effect("latency", {"latency_s": 0.085})
    said = said_of(rig, [delay], tied=[[latency]])
    right = re.search(
        r"the measured tilt of held-out recordings to (.*?) mrad about x and (.*?) mrad about y", said
    )
    assert [float(one) for one in right.groups()] == pytest.approx([1.0, 1.0], rel=0.1)
    other = re.search(r"with latency in place of delay to (.*?) mrad about x and (.*?) mrad about y", said)
    assert min(float(one) for one in other.groups()) > 10.0
    assert "the actuators do more" not in said
    assert "contradicts" not in said


def test_what_the_answer_lacks_shows_in_it(rig):
    partly = [Effect("delay", {"delay_s": 0.05})]
    assert "The sensor's noise is 1 mrad: the actuators do more than that." in said_of(rig, partly)
    wrong = [Effect("delay", {"delay_s": 0.4})]
    assert said_of(rig, wrong).endswith("contradicts what the answer says of the actuators.")
    nothing = said_of(rig, [])
    assert "five parameters" not in nothing


def test_without_a_tilt_nothing_is_said(rig):
    unseen = replace(rig, recordings=tuple(replace(one, tilt=None) for one in rig.recordings))
    assert said_of(unseen, []) is None
