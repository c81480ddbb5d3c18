"""The contract of diagnosis.json."""

from types import SimpleNamespace

import pytest

from irt import catalogue
from irt.diagnosis.result import UNLISTED, NamedEffect
from irt.diagnosis.run import is_doubtful, may_be_absent
from irt.diagnosis.words import suggestion, summary
from irt.model import Parameter


def effect(name="backlash", ties=()):
    width = Parameter(0.031, 0.029, 0.033)
    return NamedEffect(name, "actuation", {"width_x_rad": width}, {"width_x_rad": "rad"}, 0.04, 0.002, ties)


def test_the_answer_names_effect_value_and_gain():
    told = summary([effect()], noise=0.001, before=0.04, after=0.002, heldout=True)
    for words in ("backlash", "width_x_rad 0.031 rad", "0.2 %", "4 %", "0.08 %"):
        assert words.lower() in told.lower()


def test_without_stamps_values_are_in_rows():
    late = NamedEffect("delay", "timing", {"delay_s": Parameter(0.2)}, {"delay_s": "s"}, 0.04, 0.002)
    settings = {"noise": 0.001, "before": 0.04, "after": 0.002, "heldout": True}
    assert "Delay (delay_s 0.2 s)" in summary([late], **settings)
    assert "Delay (delay 2.5 rows)" in summary([late], **settings, row_s=0.08)


def test_a_tie_is_said():
    told = summary([effect("delay", ("latency",))], noise=0.001, before=0.04, after=0.002, heldout=True)
    assert "do not tell delay from latency" in told


def test_one_recording_is_fitted_and_not_predicted():
    told = summary([effect()], noise=0.001, before=0.04, after=0.002, heldout=False)
    assert "held out" not in told
    assert "the only recording is fitted" in told
    assert "held out" not in summary([], noise=0.001, before=0.001, after=0.001, heldout=False)


def test_a_mismatch_that_nothing_explains_is_not_called_sufficient():
    told = summary([], noise=0.001, before=0.04, after=0.04, heldout=True, explained=False)
    assert "No physics is missing" not in told
    assert "Nothing that is known explains" in told


def test_a_name_that_leaves_much_is_told_as_what_it_is():
    text = summary(
        [effect()], noise=0.001, before=0.04, after=0.02, heldout=True, explained=False, leaves=True
    )
    assert "More than noise is not explained" in text
    assert "not explained" not in summary([effect()], noise=0.001, before=0.04, after=0.002, heldout=True)


@pytest.mark.parametrize(
    ("name", "intervals", "may_be"),
    [
        ("bump", {"height_m": (-1e-4, 3e-4), "x_m": (0.01, 0.02)}, True),
        ("bump", {"height_m": (1e-4, 3e-4), "x_m": (-0.1, 0.1)}, False),
        ("anisotropic_friction", {"ratio": (1.0, 5.0), "grain_rad": (0.7, 2.0)}, True),
        ("backlash", {"width_x_rad": (0.0, 0.02), "width_y_rad": (0.01, 0.03)}, False),
        ("backlash", {"width_x_rad": (0.0, 0.02), "width_y_rad": (0.0, 0.03)}, True),
        ("side_force", {"rate_per_s": (None, None)}, True),
    ],
)
def test_a_size_that_may_as_well_be_none_is_no_effect(name, intervals, may_be):
    parameters = {
        one.name: Parameter(0.5 * sum(intervals[one.name]), *intervals[one.name])
        if intervals.get(one.name, (None,))[0] is not None
        else Parameter(0.5)
        for one in catalogue.effect(name).parameters
    }
    assert may_be_absent(NamedEffect(name, "board", parameters, {}, 0.04, 0.03)) is may_be


def test_what_was_learned_is_told_by_what_it_depends_on():
    values = {one.name: one.neutral for one in catalogue.effect(UNLISTED).parameters}
    values |= {"push_1_x_m_per_s2": 0.1, "wave_1_x_per_m": 90.0, "drag_strength": 0.2}
    learned = NamedEffect(
        UNLISTED, "force", {name: Parameter(value) for name, value in values.items()}, {}, 0.04, 0.002
    )
    told = summary([learned], noise=0.001, before=0.04, after=0.002, heldout=True)
    assert "depends on position and speed was left out" in told
    assert "rate_1" not in told


def test_nothing_missing_claims_no_more_than_was_shown():
    assert "that these recordings could show" in summary(
        [], noise=0.001, before=0.001, after=0.001, heldout=True
    )


@pytest.mark.parametrize(
    ("effects", "words"),
    [([], "Larger"), ([effect()], "sharpen"), ([effect("a", ("b",))], "To tell a from b")],
)
def test_what_to_record_next_depends_on_the_answer(tmp_path, effects, words):
    assert words in suggestion(effects, tmp_path)


@pytest.mark.parametrize(
    ("verdict", "final", "leaves", "doubtful"),
    [
        ("missing", 0.02, True, False),
        ("missing", 0.039, True, True),
        ("missing", 0.041, True, True),
        ("missing", 0.039, False, False),
        ("unlisted", 0.039, True, True),
        ("unlisted", 0.02, True, False),
    ],
)
def test_a_name_that_leaves_something_must_predict_what_was_held_out(verdict, final, leaves, doubtful):
    told = SimpleNamespace(verdict=verdict, is_held_out=True, base_heldout_mae=0.04, final_heldout_mae=final)
    assert is_doubtful(told, leaves=leaves, is_of_catalogue=True) is doubtful


def test_where_nothing_is_held_out_a_name_needs_more_than_what_has_none():
    told = SimpleNamespace(verdict="unlisted", is_held_out=False)
    assert is_doubtful(told, leaves=True, is_of_catalogue=True)
    assert not is_doubtful(told, leaves=True, is_of_catalogue=False)
