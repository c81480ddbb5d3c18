"""A measured tilt that no fit has seen says which actuator is right."""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from irt.diagnosis.held_out_tilt import sentence
from irt.model import Effect, Model
from irt.rig import TiltSensor
from tilted_rigs import TILT_NOISE_RAD, VALUES, rig_of, tilted_recordings

LATE = {"name": "delay", "delay_s": 0.085}


@pytest.fixture(scope="module")
def rig():
    return replace(rig_of(tilted_recordings([LATE])), tilt=TiltSensor(noise_rad=TILT_NOISE_RAD))


def answer(rig, named, base=(), tied=()):
    """Return what a diagnosis says with these effects, and with what it may be confused."""
    models = [
        Model.from_rig(rig, VALUES, effects=effects, time_step="continuous")
        for effects in (named, base, *tied)
    ]
    return SimpleNamespace(model=models[0], base=models[1], indistinguishable=models[2:], effects=named)


def test_the_right_answer_predicts_it_to_its_noise_and_a_late_picture_does_not(rig):
    delay, latency = Effect("delay", {"delay_s": 0.085}), Effect("latency", {"latency_s": 0.085})
    said = sentence(answer(rig, [delay], tied=[[latency]]), rig)
    assert said.startswith("The measured tilt took no part in the diagnosis.")
    right = re.search(r"the answer predicts it to (.*?) mrad about x and (.*?) mrad about y", said)
    assert [float(one) for one in right.groups()] == pytest.approx([1.0, 1.0], rel=0.1)
    other = re.search(r"with latency in place of delay to (.*?) mrad about x and (.*?) mrad about y", said)
    assert min(float(one) for one in other.groups()) > 10.0
    assert "the actuators do more" not in said
    assert "contradicts" not in said


def test_what_the_answer_lacks_shows_in_it(rig):
    partly = [Effect("delay", {"delay_s": 0.05})]
    assert "The sensor's noise is 1 mrad: the actuators do more than that." in sentence(
        answer(rig, partly), rig
    )
    wrong = [Effect("delay", {"delay_s": 0.4})]
    assert sentence(answer(rig, wrong), rig).endswith("contradicts what the answer says of the actuators.")
    nothing = sentence(answer(rig, []), rig)
    assert "five parameters" not in nothing


def test_without_a_tilt_nothing_is_said(rig):
    unseen = replace(rig, recordings=tuple(replace(one, tilt=None) for one in rig.recordings))
    assert sentence(answer(rig, []), unseen) is None
