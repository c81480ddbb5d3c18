"""The contract of diagnosis.json."""

import pytest

from irt.diagnose.diagnosis import NamedEffect
from irt.diagnose.words import suggestion, summary
from irt.model import Parameter


def effect(name="backlash", ties=()):
    width = Parameter(0.031, 0.029, 0.033)
    return NamedEffect(name, "actuation", {"width_x_rad": width}, {"width_x_rad": "rad"}, 0.04, 0.002, ties)


def test_the_answer_names_effect_value_and_gain():
    told = summary([effect()], noise=0.001, before=0.04, after=0.002)
    for words in ("backlash", "width_x_rad 0.031 rad", "0.2 %", "4 %", "0.08 %"):
        assert words.lower() in told.lower()


def test_a_tie_is_said():
    told = summary([effect("delay", ("latency",))], noise=0.001, before=0.04, after=0.002)
    assert "do not tell delay from latency" in told


def test_nothing_missing_claims_no_more_than_was_shown():
    assert "that these recordings could show" in summary([], noise=0.001, before=0.001, after=0.001)


@pytest.mark.parametrize(
    ("effects", "words"),
    [([], "Larger"), ([effect()], "sharpen"), ([effect("a", ("b",))], "To tell a from b")],
)
def test_what_to_record_next_depends_on_the_answer(tmp_path, effects, words):
    assert words in suggestion(effects, tmp_path)
