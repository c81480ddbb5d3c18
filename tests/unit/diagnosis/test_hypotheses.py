"""The searched effects and their size parameters."""

import pytest

from irt.catalogue import effect
from irt.diagnosis.hypotheses import ALIKE, INERTIA, hypotheses, simulated
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


def test_of_two_names_of_one_thing_one_is_asked_for():
    names = hypotheses()
    assert len(set(names)) == len(names)
    assert len(ALIKE.intersection(names)) == 1
    assert {"delay_jitter", "lag", "bump"} <= set(names)


def test_inertial_forces_are_searched_although_they_are_no_hypothesis():
    assert INERTIA in hypotheses()
    assert not effect(INERTIA).hypothesis


def test_a_marble_that_rolls_already_lies_another_way_in_each_recording():
    assert set(hypotheses()) - set(hypotheses("moving")) == {"eccentric_marble"}


def test_what_cannot_be_simulated_is_simulated_by_what_it_is_on_average():
    assert simulated(["bump", "delay_jitter"]) == ["spinning_friction", "bump", "delay", "lag"]
