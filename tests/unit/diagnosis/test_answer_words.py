"""Summary and suggestion of a diagnosis."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from irt import catalogue, rollouts
from irt.diagnosis.result import UNLISTED, NamedEffect
from irt.diagnosis.words import CORNERS, LAW_OF_IMPACTS, beyond, corners, notes, smoothed, suggestion, summary
from irt.engine import SUBSTEP_S
from irt.model import Parameter


def effect(name="backlash", ties=()):
    width = Parameter(0.031, 0.029, 0.033)
    return NamedEffect(name, "actuation", {"width_x_rad": width}, {"width_x_rad": "rad"}, 0.04, 0.002, ties)


def test_the_answer_names_effect_value_and_gain():
    text = summary([effect()], noise=0.001, before=0.04, after=0.002, heldout=True)
    for words in ("backlash", "width_x 0.031 rad", "0.20 %", "4.0 %", "0.080 %"):
        assert words.lower() in text.lower()


def test_several_effects_are_enumerated_and_no_unit_stands_twice():
    shift = NamedEffect(
        "camera_offset", "sensing", {"x_edges": Parameter(0.03)}, {"x_edges": "edge"}, 0.04, 0.002
    )
    text = summary([shift, effect(), effect("lag")], noise=0.001, before=0.04, after=0.002, heldout=True)
    assert "lacks camera_offset (x 0.03 edge), backlash (width_x 0.031 rad) and lag (width_x" in text


def test_the_unit_of_the_commands_stands_alone():
    width = {"half_width_rad": Parameter(53.4)}
    band = NamedEffect("dead_band", "actuation", width, {"half_width_rad": "us"}, 0.04, 0.002)
    text = summary([band], noise=0.001, before=0.04, after=0.002, heldout=True)
    assert "dead_band (half_width 53.4 us)" in text


def test_without_stamps_values_are_in_rows():
    late = NamedEffect("delay", "timing", {"delay_s": Parameter(0.2)}, {"delay_s": "s"}, 0.04, 0.002)
    settings = {"noise": 0.001, "before": 0.04, "after": 0.002, "heldout": True}
    assert "delay (delay 0.2 s)" in summary([late], **settings)
    assert "delay (delay 2.5 rows)" in summary([late], **settings, row_s=0.08)


def test_a_tie_is_said():
    text = summary([effect("delay", ("latency",))], noise=0.001, before=0.04, after=0.002, heldout=True)
    assert "do not distinguish delay from latency" in text


def test_one_recording_is_fitted_and_not_predicted():
    text = summary([effect()], noise=0.001, before=0.04, after=0.002, heldout=False)
    assert "held-out" not in text
    assert "the error on the only recording falls" in text
    assert "held-out" not in summary([], noise=0.001, before=0.001, after=0.001, heldout=False)


@pytest.mark.parametrize("after", [0.04, 0.0401, 0.05])
def test_no_error_is_said_to_fall_that_does_not(after):
    text = summary([effect()], noise=0.001, before=0.04, after=after, heldout=True)
    assert "falls" not in text
    assert "held-out recordings are likelier row by row, but the error does not fall (4.0 % of" in text


def parallax(height):
    return NamedEffect(
        "parallax",
        "sensing",
        {"height_m_per_rad": Parameter(height)},
        {"height_m_per_rad": "m/rad"},
        0.04,
        0.0,
    )


INFOS = {info.name: info for info in catalogue.effects()}


@pytest.mark.parametrize(
    "info", [info for info in INFOS.values() if info.hypothesis], ids=lambda one: one.name
)
def test_a_value_is_doubted_only_if_it_is_certainly_beyond_its_range(info):
    def named(shift):
        """Return the effect with intervals about values that are so many ranges above the highest."""
        found = {}
        for one in info.required:
            width = one.high - one.low
            value = one.high + shift * width
            found[one.name] = Parameter(value, value - 0.1 * width, value + 0.1 * width)
        return NamedEffect(info.name, info.stage, found, {}, 0.04, 0.002)

    assert not list(beyond([named(-0.5)], INFOS))
    assert not list(beyond([named(0.05)], INFOS))
    (note,) = beyond([named(0.2)], INFOS)
    for one in info.required:
        assert (f"({one.name} " in note) == (not one.is_choice)


def test_what_is_learned_has_no_range():
    learned = NamedEffect(UNLISTED, "board", {"push_1": Parameter(9.0, 8.0, 10.0)}, {}, 0.04, 0.002)
    assert not list(beyond([learned], INFOS))


def test_a_parallax_that_is_a_smoothed_track_is_said_to_be_one():
    updates, turns = 16, 2.0 * np.pi * np.arange(120) / 60
    knobs = 0.06 * np.stack([np.sin(turns), np.sin(0.8 * turns + 1.0)], axis=1)
    values = [[0.06, 0.05, 4e-4, updates, 1.0]]
    path = rollouts(values, knobs)[0]
    assert np.abs(path).max() < 0.4
    mean = (path[:-2] + path[1:-1] + path[2:]) / 3.0
    # The height at which the path of a parallax is nearest to the smoothed one.
    shift = rollouts(values, knobs, effects=[{"name": "parallax", "height_m_per_rad": 1.0}])[0] - path
    height = float((shift[1:-1] * (mean - path[1:-1])).sum() / (shift[1:-1] ** 2).sum())
    assert np.abs(path[1:-1] + height * shift[1:-1] - mean).max() < 0.25 * np.abs(mean - path[1:-1]).max()
    (note,) = smoothed([effect(), parallax(height)], updates * SUBSTEP_S)
    # Three equal weights have a standard deviation of 0.82 rows.
    assert "standard deviation of 0.8" in note


@pytest.mark.parametrize("height", [-0.01, 0.0, 0.6])
def test_no_smoothing_looks_like_other_parallaxes(height):
    assert not list(smoothed([parallax(height)], 0.07))
    assert not list(smoothed([effect()], 0.07))


def test_a_mismatch_that_nothing_explains_is_not_called_sufficient():
    text = summary([], noise=0.001, before=0.04, after=0.04, heldout=True, rest="push")
    assert "no missing physics" not in text
    assert "No known effect explains" in text


def test_of_a_push_that_does_not_repeat_nothing_is_said_to_be_certain():
    text = summary([], noise=0.001, before=0.01, after=0.01, heldout=True, rest="chance")
    assert text.startswith(
        "No known effect explains the residuals of the five-parameter model (held-out error"
    )
    assert "missing physics" not in text
    assert "it may follow rebounds from the rim" in text


def test_errors_that_noise_does_not_allow_are_not_called_sufficient():
    text = summary([], noise=0.02, before=0.09, after=0.09, heldout=True, rest="noise")
    assert text.startswith("The five parameters leave errors that are larger than their own noise allows")
    assert text.endswith("Therefore nothing is named.")


def test_rebounds_that_nothing_explains_are_mentioned():
    text = summary([], noise=0.001, before=0.01, after=0.01, heldout=True, rest="rim")
    assert text.startswith("Between impacts the five parameters explain the recordings; rebounds")
    assert "(held-out error 1.0 % of the board's edge; tracker noise alone gives 0.080 %)." in text
    assert "no missing physics" not in text
    assert "remain: rebounds" in summary(
        [effect()], noise=0.001, before=0.04, after=0.02, heldout=True, rest="rim"
    )


@pytest.mark.parametrize("rest", ["push", "chance", "rim"])
def test_a_name_that_leaves_much_is_reported_as_such(rest):
    text = summary([effect()], noise=0.001, before=0.04, after=0.02, heldout=True, rest=rest)
    assert "Errors beyond noise remain" in text
    assert "remain" not in summary([effect()], noise=0.001, before=0.04, after=0.002, heldout=True)


def test_what_was_learned_is_described_by_its_variables():
    values = {one.name: one.neutral for one in catalogue.effect(UNLISTED).parameters}
    values |= {"push_1_x_m_per_s2": 0.1, "wave_1_x_per_m": 90.0, "drag_strength": 0.2}
    learned = NamedEffect(
        UNLISTED, "force", {name: Parameter(value) for name, value in values.items()}, {}, 0.04, 0.002
    )
    text = summary([learned], noise=0.001, before=0.04, after=0.002, heldout=True)
    assert "depends on position and speed:" in text
    assert "rate_1" not in text


def test_nothing_missing_claims_no_more_than_was_shown():
    assert "They reveal no missing physics" in summary(
        [], noise=0.001, before=0.001, after=0.001, heldout=True
    )


@pytest.mark.parametrize(
    ("effects", "words"),
    [([], "Larger"), ([effect()], "sharpen"), ([effect("a", ("b",))], "To distinguish a from b")],
)
def test_what_to_record_next_depends_on_the_answer(tmp_path, effects, words):
    assert words in suggestion(effects, tmp_path)


def test_a_rig_in_the_working_directory_is_named_from_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "`irt suggest 'my rig' --models DIR`" in suggestion([effect()], tmp_path / "my rig")
    assert "`irt suggest ../rig --models DIR`" in suggestion([effect()], Path("../rig"))
    assert f"`irt suggest {tmp_path.parent} --models DIR`" in suggestion([effect()], tmp_path.parent)


def test_what_is_in_the_model_but_not_named_is_said():
    settings = {"noise": 0.001, "before": 0.04, "after": 0.002, "heldout": True}
    assert f"with it and {LAW_OF_IMPACTS} and {CORNERS}, the error" in summary(
        [effect()], unnamed=[LAW_OF_IMPACTS, CORNERS], **settings
    )
    assert f"The five parameters and {CORNERS} explain" in summary([], unnamed=[CORNERS], **settings)
    assert "(camera_offset and perspective)" in corners(["camera_offset", "perspective"])


@pytest.mark.parametrize(("rows", "length", "rests"), [(400, 0.4, False), (400, 0.02, True), (20, 0.4, True)])
def test_a_slow_marble_does_not_rest(rows, length, rests):
    path = np.column_stack([np.linspace(0.0, length, rows), np.zeros(rows)])
    path[rows // 2] = np.nan
    rig = SimpleNamespace(recordings=[None] * 3)
    dataset = SimpleNamespace(rig=rig, segments=[SimpleNamespace(observed=path)], noise=0.001, in_parts=False)
    said = list(notes(dataset, SimpleNamespace(effects=()), None, explained=True))
    assert [text.startswith("The marble is seen in only") for text in said] == [True] * rests


def test_it_is_said_that_parts_were_held_out() -> None:
    path = np.random.default_rng(1).uniform(-0.4, 0.4, (400, 2))
    dataset = SimpleNamespace(
        rig=SimpleNamespace(recordings=[None] * 5),
        segments=[SimpleNamespace(observed=path)],
        noise=0.001,
        in_parts=True,
    )
    (said,) = notes(dataset, SimpleNamespace(effects=()), None, explained=True)
    assert "cut into 5 parts, which are held out in turn" in said
