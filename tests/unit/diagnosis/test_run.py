"""The verdict, error budget, held-out errors and reproducibility of a diagnosis."""

from dataclasses import replace

import numpy as np
import pytest

from irt.catalogue import effect
from irt.diagnosis import config
from irt.diagnosis.budget import REST, TRACKER, twins_of
from irt.diagnosis.run import diagnose
from irt.diagnosis.score import Scores
from irt.diagnosis.selection import Selection
from irt.residual import evaluate

BIAS = {"name": "tilt_bias", "bias_x_rad": 0.0015, "bias_y_rad": -0.001}
DRAG = {"name": "viscous_drag", "rate_per_s": 0.8}
DELAY = {"name": "delay", "delay_s": 0.15}
JITTER = {"name": "delay_jitter", "sd_s": 0.08}
WAVE = {"name": "unlisted", "push_1_x_m_per_s2": 0.02, "wave_1_x_per_m": 100.0, "phase_1_rad": 0.5}

RIGS = {
    "nothing": ([], {}),
    "a push": ([], {"pushed": 0.05}),
    "drag": ([DRAG], {}),
    "two": ([DELAY, BIAS], {"pushed": 0.05}),
    "jitter": ([DELAY, JITTER], {"rows": 120}),
    "wave": ([WAVE], {}),
}


@pytest.fixture(scope="module")
def diagnosed():
    """Return a function that diagnoses a rig of `RIGS` once."""
    known = {}

    def of(name, plant):
        if name not in known:
            planted, options = RIGS[name]
            known[name] = diagnose(plant(planted, runs=5, stamped=True, **options).rig)
        return known[name]

    return of


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "verdict", "effects"),
    [
        ("nothing", "sufficient", set()),
        ("a push", "sufficient", set()),
        ("drag", "missing", {"viscous_drag"}),
        ("two", "missing", {"tilt_bias", "delay"}),
        ("jitter", "missing", {"delay_jitter"}),
        ("wave", "unlisted", {"unlisted"}),
    ],
)
def test_the_verdict_is_what_was_planted(diagnosed, plant, name, verdict, effects):
    found = diagnosed(name, plant)
    assert found.verdict == verdict
    assert {one.name for one in found.effects} == effects
    kinds = {one.kind for one in found.where}
    if effects:
        assert "stage" in kinds
    elif name == "nothing":
        assert not kinds


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_the_budget_adds_up_at_each_horizon(diagnosed, plant, name):
    found = diagnosed(name, plant)
    horizons = {one.horizon_s for one in found.budget}
    assert horizons == {None, config.HORIZON_S}
    for horizon in horizons:
        shares = {one.what: one.share for one in found.budget if one.horizon_s == horizon}
        assert set(shares) == {TRACKER, REST, *(one.name for one in found.effects)}
        assert all(0.0 <= share <= 1.0 for share in shares.values())
        assert sum(shares.values()) == pytest.approx(1.0, abs=1e-9)
    # `remains` holds the same number.
    (rest,) = [one.share for one in found.budget if (one.what, one.horizon_s) == (REST, None)]
    assert found.remains.share == rest


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drag", "two", "wave"])
def test_the_budget_gives_most_to_what_was_planted(diagnosed, plant, name):
    found = diagnosed(name, plant)
    names = {one.name for one in found.effects}
    assert sum(one.share for one in found.budget if one.what in names and one.horizon_s is None) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drag", "two", "jitter", "wave"])
def test_every_effect_is_proved_and_distinct_from_none(diagnosed, plant, name):
    found = diagnosed(name, plant)
    assert found.is_held_out
    assert found.final_heldout_mae < 0.6 * found.base_heldout_mae
    for one in found.effects:
        assert one.heldout_mae_with == found.final_heldout_mae
        if one.name == "delay_jitter":
            assert one.parameters["sd_s"].low > 0.0
            continue
        assert one.heldout_mae_without >= one.heldout_mae_with + config.MATTERS * 0.9e-3
        sizes = {each.name: each.neutral for each in effect(one.name).required}
        stated = [(one.parameters[key], sizes[key]) for key in sizes if one.parameters[key].low is not None]
        assert any(not each.low <= neutral <= each.high for each, neutral in stated)


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_the_proof_is_that_of_the_recordings(diagnosed, plant, name):
    found = diagnosed(name, plant)
    assert len(found.runs) == 5
    for one in found.runs:
        errors = np.abs(one.final - one.observed)[1:]
        assert one.final_mae == pytest.approx(np.nanmean(errors), rel=0.05)
    assert found.final_heldout_mae == pytest.approx(np.mean([one.final_mae for one in found.runs]))
    assert found.base_heldout_mae == pytest.approx(np.mean([one.base_mae for one in found.runs]))
    # Clear effects are also selected without any single recording.
    assert all(one.chosen_again == 1.0 for one in found.effects)
    # Beside a push, a set with one effect more may win without a recording, and predicts it worse.
    assert found.nested_heldout_mae == pytest.approx(found.final_heldout_mae, rel=0.25)
    assert all(0.0 <= chance <= 1.0 for chance in found.inclusion.values())
    assert sum(one.probability for one in found.candidates) == pytest.approx(1.0)


@pytest.mark.slow
def test_what_never_repeats_remains_on_the_board(diagnosed, plant):
    remains = diagnosed("a push", plant).remains
    assert remains.stage == "board"
    assert remains.share > 0.8
    assert not remains.repeats
    nothing = diagnosed("nothing", plant).remains
    assert nothing.stage is None
    # The errors of the five parameters are at the noise floor.
    assert nothing.floor_of_the_log > 0.5 * diagnosed("nothing", plant).base_heldout_mae


@pytest.mark.slow
def test_the_floor_of_recordings_in_motion_is_that_of_their_windows(plant, in_motion):
    found = diagnose(in_motion(plant([], runs=4, rows=150, stamped=True), 20).rig)
    assert found.verdict == "sufficient"
    # Where nothing is hidden, the error is that of a perfect simulator.
    assert found.remains.floor_of_the_log == pytest.approx(found.base_heldout_mae, rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nothing", "drag", "wave"])
def test_the_noise_is_the_standard_deviation_of_the_tracker(diagnosed, plant, name):
    found = diagnosed(name, plant)
    assert found.noise == pytest.approx(1e-3, rel=0.15)


@pytest.mark.slow
def test_where_nothing_is_missing_most_of_the_error_is_the_trackers(diagnosed, plant):
    shares = {one.what: one.share for one in diagnosed("nothing", plant).budget if one.horizon_s is None}
    assert shares[TRACKER] > 0.6


@pytest.mark.slow
def test_spread_of_delays_is_stated_and_not_simulated(diagnosed, plant):
    found = diagnosed("jitter", plant)
    (one,) = found.effects
    assert one.stage == effect("delay_jitter").stage
    assert set(one.parameters) == {"sd_s", "mean_s"}
    assert 0.5 < one.parameters["sd_s"].value / 0.08 < 2.0
    assert [each.name for each in found.model.effects] == ["delay", "lag"]
    assert any("replace lag in model.toml" in note for note in found.notes)


@pytest.mark.slow
def test_physics_that_has_no_name_is_stated_as_a_formula(diagnosed, plant):
    found = diagnosed("wave", plant)
    assert any("cos(" in note for note in found.notes)
    assert any("position" in one.what for one in found.where if one.kind == "region")
    assert found.power == ()
    assert [one.name for one in found.model.effects] == ["unlisted"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nothing", "drag"])
def test_what_may_be_true_begins_with_the_answer(diagnosed, plant, name):
    found = diagnosed(name, plant)
    first, *others = found.plausible
    assert [one.name for one in first.model.effects] == [one.name for one in found.model.effects]
    assert sum(one.probability for one in found.plausible) == pytest.approx(1.0)
    assert all(0.0 < one.probability <= first.probability for one in others)


@pytest.mark.slow
def test_power_is_stated_where_nothing_is_named(diagnosed, plant):
    found = diagnosed("nothing", plant)
    assert {one.effect for one in found.power} >= {"lag", "bump", "parallax"}


@pytest.mark.slow
def test_the_same_seed_gives_the_same_answer_for_any_number_of_threads(plant):
    rig = plant([DRAG], runs=3, stamped=True).rig
    found = [diagnose(rig, seed=5, threads=threads) for threads in (1, 2)]
    stated = [repr(replace(one, seconds=0.0).as_dict()) for one in found]
    assert stated[0] == stated[1]


@pytest.mark.slow
def test_one_recording_is_diagnosed_and_not_proved(plant):
    found = diagnose(plant([DRAG], runs=1, rows=120, stamped=True).rig)
    assert not found.is_held_out
    assert found.budget == ()
    assert found.remains is None
    assert len(found.runs) == 1


def test_a_model_predicts_its_own_twins_as_well_as_noise_allows(plant):
    dataset = plant(stamped=True)
    model = dataset.fit().model
    twins = twins_of(dataset.rig, model, (2e-3, 0.0, 1.0), 0)
    # The observed start contains noise too.
    assert evaluate(model, twins).mae == pytest.approx(2e-3 * np.sqrt(2.0) * np.sqrt(2.0 / np.pi), rel=0.15)
    for twin, recording in zip(twins, dataset.rig.recordings, strict=True):
        np.testing.assert_array_equal(twin.knobs, recording.knobs)


def test_errors_of_the_tracker_that_last_are_simulated_as_such(plant):
    dataset = plant(runs=20, rows=100, stamped=True)
    model = dataset.fit().model
    exact, twins = (twins_of(dataset.rig, model, (0.0, size, 0.4), 0) for size in (0.0, 2e-3))
    off = np.array([twin.marble - one.marble for twin, one in zip(twins, exact, strict=True)])
    assert off.std() == pytest.approx(2e-3, rel=0.1)
    step_s = float(np.median(dataset.rig.recordings[0].durations))
    alike = float(np.mean(off[:, 1:] * off[:, :-1]) / np.mean(off**2))
    assert alike == pytest.approx(np.exp(-step_s / 0.4), abs=0.05)


@pytest.mark.slow
def test_an_answer_without_effects_predicts_as_well_as_least_squares(plant):
    """Under a push that outweighs the drive, the likeliest five parameters predict worse."""
    dataset = plant(runs=3, rows=60, seed=9, pushed=2.0)
    selection = Selection(Scores(dataset), (), lambda _text: None)
    likeliest, predicts = (
        selection.validation.of(one).mae for one in (selection.scores.base(), selection.baseline)
    )
    assert predicts < 0.9 * likeliest
    found = diagnose(dataset.rig)
    assert found.effects == ()
    assert found.final_heldout_mae == found.base_heldout_mae == pytest.approx(predicts)
