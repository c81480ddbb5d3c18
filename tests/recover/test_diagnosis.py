"""Rigs with hidden physics, diagnosed: named by its name, modelled, and proved on runs held out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irt
from irt.diagnosis import config
from irt.diagnosis.dataset import Dataset
from irt.diagnosis.relevance import Relevance
from irt.diagnosis.score import Scores
from irt.diagnosis.selection import Selection
from irt.diagnosis.terms import AT_RIM
from irt.dimensions import Commands
from irt.recording import CMD, Recording
from irt.rig import RANGES, Board, Marble, Rig

TRUTH = (0.06, 0.05, 4e-4, 15.0, 1.03)
NOISE = 1e-3
FLOOR = NOISE * np.sqrt(2 / np.pi)


#: Deviations of a rim's restitution in six recordings.
REBOUNDS = (-0.35, 0.35, -0.25, 0.25, -0.15, 0.15)


def hidden(*effects, engine="rolling", runs=5, rows=90, seed=3, size=1.0, limit=None, board=None, each=None):
    """Return a rig whose recordings have these effects, one of `each` besides, and commands of that size.

    With a limit the commands are always at one of its signs, and rows have stamps.
    """
    stamps = None if limit is None else np.arange(rows) * TRUTH[3] / 240.0
    rig = Rig(Path("rig"), board or Board(), Marble(), "rest", dict(RANGES), ())
    random = np.random.default_rng(seed)
    recordings = []
    for index in range(runs):
        time = np.arange(rows)[:, None, None] / rows
        waves = np.sin(2 * np.pi * (time * random.uniform(0.7, 5.0, (2, 3)) + random.random((2, 3))))
        knobs = size * (waves * random.uniform(0.01, 0.05, (2, 3))).sum(axis=2)
        if limit is not None:
            knobs = limit * np.sign(knobs)
        start = random.uniform(-0.1, 0.1, 2)
        own = [*effects, *(each[index : index + 1] if each else ())]
        marble = irt.rollouts(
            [TRUTH], knobs, rig=rig, effects=own, start=start, engine=engine, seed=[100 + index]
        )[0]
        marble = marble + NOISE * random.standard_normal(marble.shape)
        recordings.append(Recording(f"run-{index}", Path(f"run-{index}.csv"), knobs, marble, stamps=stamps))
    return replace(rig, recordings=tuple(recordings))


def names(found):
    """Return the effects named, each with those it is confused with."""
    return [{one.name, *one.confusable_with} for one in found.effects]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "variable"),
    [
        ({"shape_1": 5.0, "brake_1_m_per_s2": 0.04, "way_1_per_m": 3.0, "drag_power": 0.0}, "path length"),
        ({"mode_gain": 1.0, "mode_rate_rad_per_s": 5.0, "mode_damping": 0.1}, "tilt"),
        ({"picture_turn_x": -36.0, "picture_turn_y": 24.0}, "a picture that turns or grows with the tilt"),
    ],
    ids=["resistance that grows with the path", "resonance", "picture that turns"],
)
def test_physics_outside_the_catalogue_is_learned_and_not_named(values, variable):
    """No other effect stands in for it, although a random push hides on what the push depends."""
    found = irt.diagnose(hidden({"name": "unlisted", **values}))
    assert found.verdict == "unlisted"
    assert [one.name for one in found.effects] == ["unlisted"]
    assert variable in found.summary
    assert found.inclusion == {}
    assert found.final_heldout_mae < 2.0 * FLOOR
    assert found.final_heldout_mae < 0.3 * found.base_heldout_mae


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values", "engine"),
    [
        ("backlash", {"width_x_rad": 0.03, "width_y_rad": 0.05}, "rapier"),
        ("bump", {"x_m": 0.02, "y_m": -0.01, "height_m": 1.2e-4, "width_m": 0.02}, "rolling"),
        ("perspective", {"slope_x": 0.25, "slope_y": -0.15, "distance_edges": 2.2}, "rapier"),
    ],
)
def test_one_effect_is_named_and_modelled(name, values, engine):
    found = irt.diagnose(hidden({"name": name, **values}, engine=engine))
    assert found.verdict == "missing"
    assert len(found.effects) == 1
    assert name in names(found)[0]
    assert found.final_heldout_mae < 4.0 * FLOOR
    assert found.final_heldout_mae < 0.6 * found.base_heldout_mae


@pytest.mark.slow
def test_nothing_is_named_if_commands_belong_to_other_recordings():
    """A push or a drag would account for the motion that the commands do not explain."""
    rig = hidden(seed=4)
    others = [*rig.recordings[1:], rig.recordings[0]]
    mixed = [replace(one, knobs=other.knobs) for one, other in zip(rig.recordings, others, strict=True)]
    found = irt.diagnose(replace(rig, recordings=tuple(mixed)))
    assert (found.verdict, found.effects) == ("unlisted", ())
    assert "leave most of the motion unexplained" in found.summary
    assert "Check that the commands belong to these recordings" in found.suggestion
    assert found.inclusion == {}
    assert found.where


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values", "power"),
    [
        ("dead_band", {"half_width_rad": 0.02}, 1),
        ("backlash", {"width_x_rad": 0.03, "width_y_rad": 0.05}, 1),
        ("gear_nonlinearity", {"cubic_per_rad2": 40.0}, -2),
    ],
)
def test_effects_at_the_knob_are_found_in_the_unit_of_the_commands(name, values, power):
    """Commands in microseconds of pulse width, one of them the other way around."""
    rig, per_rad = hidden({"name": name, **values}), 900.0
    stamps = TRUTH[3] / 240.0 * np.arange(90)
    runs = [
        replace(one, knobs=per_rad * one.knobs * [1.0, -1.0], columns=CMD, stamps=stamps)
        for one in rig.recordings
    ]
    found = irt.diagnose(Rig.from_recordings(runs, commands=Commands("us")))
    (effect,) = found.effects
    assert name in {effect.name, *effect.confusable_with}
    if effect.name == name:
        for key, value in values.items():
            assert effect.parameters[key].value == pytest.approx(value * per_rad**power, rel=0.1)
            assert "us" in effect.units[key]
    assert found.final_heldout_mae < 4.0 * FLOOR


@pytest.mark.slow
def test_a_law_of_impacts_that_depends_on_the_speed_is_found():
    """Rapier's rim returns more of a slow marble's speed, and rubs more, than the rig file says."""
    law = {"increase": 0.3, "falloff": 0.5, "friction_increase": 0.3}
    found = irt.diagnose(hidden({"name": "wall_restitution", **law}, runs=8, size=4.0, engine="rapier"))
    (effect,) = found.effects
    assert (effect.name, effect.stage) == ("wall_restitution", "contact")
    for name, value in law.items():
        one = effect.parameters[name]
        assert one.low <= value <= one.high
    assert effect.parameters["increase"].value == pytest.approx(0.3, abs=0.05)
    assert effect.parameters["falloff"].value == pytest.approx(0.5, abs=0.1)
    assert found.final_heldout_mae < 0.7 * found.base_heldout_mae


@pytest.mark.slow
def test_a_law_of_impacts_as_engines_differ_by_is_modelled_and_not_named():
    law = {"increase": 0.12, "falloff": 0.6, "friction_increase": 0.4}
    found = irt.diagnose(hidden({"name": "wall_restitution", **law}, runs=8, size=6.0))
    assert (found.verdict, found.effects, found.inclusion) == ("sufficient", (), {})
    (modelled,) = found.model.effects
    assert modelled.name == "wall_restitution"
    assert modelled.parameters["friction_increase"] == pytest.approx(0.4, abs=0.15)
    assert found.summary.startswith("The five parameters and a law of impacts explain the recordings")
    assert any("Rebounds from the rim are predicted better" in note for note in found.notes)
    assert found.base_heldout_mae == found.final_heldout_mae < 4.0 * FLOOR


@pytest.mark.slow
@pytest.mark.parametrize("gear_y_by_x", [0.0, 0.15], ids=["nothing hidden", "coupled axes"])
def test_inertial_forces_of_a_turning_board_are_modelled_and_not_named(gear_y_by_x):
    """Under commands that jump from limit to limit, as those of a controller often do."""
    coupled = [{"name": "cross_coupling", "x_from_y": gear_y_by_x, "y_from_x": 0.0}] if gear_y_by_x else []
    inertia = {"name": "inertial_forces", "rate_per_s": 60.0}
    found = irt.diagnose(hidden(inertia, *coupled, engine="rapier", limit=0.12))
    assert [one.name for one in found.effects] == [one["name"] for one in coupled]
    assert "inertial_forces" not in found.inclusion
    (modelled,) = [one for one in found.model.effects if one.name == "inertial_forces"]
    assert modelled.parameters["rate_per_s"] == pytest.approx(60.0, rel=0.3)
    assert "inertial forces of the turning board" in found.summary
    assert any("the turning board throws the marble" in note for note in found.notes)
    assert found.final_heldout_mae < 3.0 * FLOOR


@pytest.mark.slow
@pytest.mark.parametrize("turns", [True, False])
def test_inertial_forces_are_added_to_a_set_where_they_act(turns):
    inertia = [{"name": "inertial_forces", "rate_per_s": 60.0}] if turns else []
    scores = Scores(Dataset.of(hidden(*inertia, runs=3, limit=0.12), seed=0, threads=1))
    selection, base = Selection(scores, ("inertial_forces",), lambda _: None), scores.base()
    found = selection.with_inertia(base)
    assert found.effects == (("inertial_forces",) if turns else ())
    assert found.score >= base.score
    # They need no proof by held-out recordings, but some other fit may have undone them.
    relevance = Relevance(selection, selection.run())
    assert relevance.kept(found)[0] is found
    if turns:
        values = found.top.values.copy()
        values[found.names.index("inertial_forces.rate_per_s")] = 0.0
        undone = replace(found, top=replace(found.top, values=values))
        assert relevance.kept(undone)[0].effects == ()


@pytest.mark.slow
def test_where_nothing_is_hidden_nothing_is_named():
    found = irt.diagnose(hidden(seed=4))
    assert (found.verdict, found.effects, found.where) == ("sufficient", (), ())
    assert {one.effect for one in found.power} >= {"lag", "bump", "parallax"}
    seen = [one for one in found.power if one.least is not None]
    assert seen
    assert all(0.0 < one.least <= one.largest for one in seen)


@pytest.mark.slow
@pytest.mark.parametrize(
    "force",
    [
        {"rim_hold_m_per_s2": 0.1},
        {"rim_drag_per_s": 4.0},
        {"rim_brake_m_per_s2": 0.04, "rim_drag_per_s": 3.0},
    ],
)
def test_forces_at_the_rim_are_learned(force):
    """A rim that is sticky, rough or of felt has no name; late departures and rebounds show it."""
    found = irt.diagnose(hidden({"name": "unlisted", **force}, runs=6, size=4.0))
    assert [one.name for one in found.effects] == ["unlisted"]
    assert "a force at the rim that is not in the catalogue" in found.summary
    assert found.effects[0].stage == "contact"
    values = found.effects[0].parameters
    assert [name for name in AT_RIM if values[name].value > 0.0] == list(force)
    assert found.final_heldout_mae < 0.8 * found.base_heldout_mae


@pytest.mark.slow
def test_rebounds_that_vary_are_neither_named_nor_called_explained():
    """The rim gives back another part of the speed in each recording, on average what the rig file says."""
    half = Board(wall_restitution=0.4)
    each = [{"name": "wall_restitution", "increase": one} for one in REBOUNDS]
    rig = hidden(runs=len(each), size=2.5, board=half, each=each)
    found = irt.diagnose(rig)
    assert found.effects == ()
    assert found.verdict == "sufficient"
    assert found.base_heldout_mae > 2.0 * FLOOR
    assert found.remains.stage == "contact"
    assert "Between impacts the five parameters explain the recordings; rebounds" in found.summary


@pytest.mark.slow
def test_wild_rows_are_no_physics():
    rig = hidden(runs=6)
    random = np.random.default_rng(0)
    wild = []
    for one in rig.recordings:
        marble = one.marble.copy()
        jumps = random.choice(np.arange(1, len(marble)), 4, replace=False)
        marble[jumps] = random.uniform(-0.4, 0.4, (4, 2))
        wild.append(replace(one, marble=marble))
    assert irt.diagnose(replace(rig, recordings=tuple(wild))).verdict == "sufficient"


@pytest.mark.slow
def test_no_further_start_improves_the_five_parameters_under_a_strong_field():
    """A field stronger than the drive gives the likelihood many local maxima, hundreds of nats apart."""
    field = {"name": "point_field", "x_m": 0.2, "y_m": -0.17, "strength_m3_per_s2": 0.0028}
    scores = Scores(Dataset.of(hidden(field, engine="rapier")))
    base = scores.base()
    noise = np.stack([scores.noise(push) for push in config.PUSHES])
    values = np.tile(base.top.values, (len(noise), 1))
    found = scores.ascend((), values, noise, base.top.states, iterations=config.THOROUGH)
    assert max(one.score for one in found) < base.score + config.SURE
