"""Planted faults come back as findings, and right recordings have none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irt
from irt.checking import check, page
from irt.cli.demo import data
from irt.engine import rollouts
from irt.errors import IrtError
from irt.recording import CMD, Recording
from irt.rig import Commands, load_rig
from simulated_rigs import NOISE, STEP_S, TRUTH, rig_of


def changed(rig, **arrays):
    """Return a rig whose recordings have other arrays; each value is a function of the recording."""
    return replace(
        rig,
        recordings=tuple(
            replace(one, **{name: change(one) for name, change in arrays.items()}) for one in rig.recordings
        ),
    )


def warned(found):
    return [one for one in found.findings if one.severity != "note"]


def test_right_recordings_have_no_warning_and_are_identified(make_rig):
    # Large enough to meet the rim, which says how large the picture is.
    found = check(make_rig(amplitude=0.12))
    assert warned(found) == []
    assert found.identified is not None
    assert found.identified.values["gear_x"] == pytest.approx(0.07, rel=0.05)
    assert all(half is not None for half in found.identified.intervals.values())
    assert {one.column: one.noise for one in found.signals} == {
        "marble_x": pytest.approx(NOISE, rel=0.15),
        "marble_y": pytest.approx(NOISE, rel=0.15),
    }


def test_the_package_offers_it(make_rig):
    assert irt.check(make_rig(runs=2)).findings == check(make_rig(runs=2)).findings


def test_values_are_those_that_a_fit_from_many_starts_finds():
    """Without stamps only products with the square of the time scale are known."""
    rig = load_rig(data("labyrinth"))
    tuned = irt.tune(rig).model.parameters
    found = [check(rig).identified.values, {name: one.value for name, one in tuned.items()}]
    gears = [[one["time_scale"] ** 2 * one[name] for name in ("gear_x", "gear_y")] for one in found]
    np.testing.assert_allclose(gears[0], gears[1], rtol=0.01)


def test_a_fit_that_misses_says_so(make_rig):
    drag = [{"name": "viscous_drag", "rate_per_s": 0.3}]
    found = check(make_rig(effects=drag))
    assert found.identified.misses > 2.0
    assert f"misses by {found.identified.misses:.2g} times the noise" in page(found)


def test_without_stamps_the_time_scale_is_not_identified(make_rig):
    found = check(make_rig(stamped=False))
    assert found.identified is not None
    assert found.identified.intervals["time_scale"] is None
    assert any("time_scale" in one for one in found.identified.unidentifiable)
    assert "t_s" in found.next_recording


def test_more_noise_hides_more(make_rig):
    sizes = []
    for noise in (0.0005, 0.005):
        identified = check(make_rig(noise=noise)).identified
        sizes.append({one.effect: one.smallest for one in identified.effects if one.smallest is not None})
    assert sizes[1]["delay"] == pytest.approx(10 * sizes[0]["delay"], rel=0.5)
    assert all(sizes[1][name] >= 0.99 * sizes[0][name] for name in sizes[1])


def test_a_marble_that_never_moves_is_an_error(make_rig):
    rig = changed(
        make_rig(), marble=lambda one: NOISE * np.random.default_rng(len(one.name)).standard_normal((120, 2))
    )
    found = check(rig)
    assert [one.severity for one in warned(found)] == ["error"]
    assert found.identified is None
    with pytest.raises(IrtError, match="the marble never moves"):
        found.require()


def test_exactly_constant_places_are_an_error_too(make_rig):
    with pytest.raises(IrtError, match="the marble never moves"):
        check(changed(make_rig(), marble=lambda one: np.full((120, 2), 0.1))).require()


def test_commands_that_never_change_are_an_error(make_rig):
    with pytest.raises(IrtError, match="no command ever changes"):
        check(changed(make_rig(), knobs=lambda one: np.zeros((120, 2)))).require()


def test_too_few_rows_are_an_error():
    run = Recording("a", Path("a.csv"), np.eye(3, 2), np.eye(3, 2) * 0.1)
    found = check(rig_of([run]))
    with pytest.raises(IrtError, match="3 rows"):
        found.require()
    assert [(one.noise, one.moves) for one in found.signals] == [(None, True)] * 2
    assert "never moves" not in page(found)


def test_a_short_run_among_others_is_a_warning(make_rig):
    rig = make_rig()
    short = replace(
        rig.recordings[0],
        name="short",
        **{name: getattr(rig.recordings[0], name)[:3] for name in ("knobs", "marble", "stamps")},
    )
    found = check(replace(rig, recordings=(*rig.recordings, short)))
    assert [(one.severity, one.where) for one in warned(found)] == [("warning", "short")]


def test_runs_with_and_without_stamps_are_an_error(make_rig):
    rig = make_rig()
    found = check(replace(rig, recordings=(replace(rig.recordings[0], stamps=None), *rig.recordings[1:])))
    with pytest.raises(IrtError, match="no stamps"):
        found.require()


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"knobs": lambda one: np.degrees(one.knobs)}, "degrees"),
        ({"marble": lambda one: one.marble * 0.5 + [0.55, 0.48]}, "corner"),
        ({"stamps": lambda one: 100.0 * one.stamps}, "milliseconds"),
        ({"stamps": lambda one: 4.0 * one.stamps}, "outside the range of 0 to 50"),
        ({"marble": lambda one: 1.6 * one.marble}, "beyond the rim"),
    ],
)
def test_units_that_look_wrong_are_warned_of(make_rig, arrays, words):
    rig = make_rig()
    if words == "beyond the rim":
        rig = changed(rig, marble=lambda one: 0.45 * one.marble / np.abs(one.marble).max())
    found = check(changed(rig, **arrays))
    assert any(words in str(one) for one in warned(found)), [str(one) for one in warned(found)]


def test_knobs_in_degrees_are_refused_unless_the_range_of_the_gears_says_otherwise(make_rig):
    rig = changed(make_rig(), knobs=lambda one: np.degrees(one.knobs))
    (error,) = warned(check(rig))
    assert error.severity == "error"
    assert "they are degrees" in error.advice
    radians = {"gear_x": (0.0, 0.0005), "gear_y": (0.0, 0.0005)}
    (warning,) = warned(check(replace(rig, ranges={**rig.ranges, **radians})))
    assert warning.severity == "warning"


@pytest.mark.parametrize(
    ("amplitude", "ranges", "severity"),
    [(0.02, {}, "warning"), (0.1, {}, "error"), (0.1, {"gear_x": (0.0, 0.01)}, "warning")],
)
def test_without_stamps_knobs_beyond_half_a_turn_are_refused(make_rig, amplitude, ranges, severity):
    rig = changed(make_rig(stamped=False, amplitude=amplitude), knobs=lambda one: np.degrees(one.knobs))
    (found,) = warned(check(replace(rig, ranges={**rig.ranges, **ranges})))
    assert "degrees" in found.what
    assert found.severity == severity


def test_a_measured_tilt_proves_degrees_without_stamps(make_rig):
    rig = changed(
        make_rig(stamped=False, amplitude=0.02),
        tilt=lambda one: 0.07 * one.knobs,
        knobs=lambda one: np.degrees(one.knobs),
    )
    (found,) = warned(check(rig))
    assert found.severity == "error"
    assert "0.0012 if they are radians, 0.07 if they are degrees" in found.what


def test_small_knobs_in_degrees_show_by_their_gears(make_rig):
    # 1 degree at most: as radians no impossible knob, but gears a 57th of what is searched.
    rig = changed(make_rig(), knobs=lambda one: np.degrees(one.knobs) / np.degrees(one.knobs).max())
    gears = {"gear_x": (0.0, 2.0), "gear_y": (0.0, 2.0)}
    found = check(replace(rig, ranges={**rig.ranges, **gears}))
    assert any("degrees" in str(one) for one in warned(found))


def test_a_marble_that_rolls_in_row_0_is_warned_of(make_rig):
    rig = make_rig()
    velocity = [0.15, -0.1]  # board edges a second
    moving = changed(
        rig,
        marble=lambda one: rollouts(
            TRUTH, 0.1 * one.knobs, start=[-0.3, 0.2], start_velocity=velocity, time_step="continuous"
        )[0],
        knobs=lambda one: 0.1 * one.knobs,
    )
    assert any('start = "moving"' in str(one) for one in warned(check(moving)))
    assert not any('start = "moving"' in str(one) for one in warned(check(replace(moving, start="moving"))))


def test_held_places_and_jumps_are_warned_of(make_rig):
    def hold(one):
        marble = one.marble.copy()
        marble[30:40] = marble[30]
        return marble

    found = check(changed(make_rig(), marble=hold))
    assert found.runs[0].held == pytest.approx(9 / 120)
    assert [str(one) for one in warned(found) if "held" in str(one)]


def test_an_idle_axis_counts_for_nothing(make_rig):
    rig = make_rig()
    ball_and_beam = changed(
        rig,
        knobs=lambda one: one.knobs * [0.0, 1.0],
        marble=lambda one: one.marble * [1.0, 0.0],
    )
    found = check(ball_and_beam)
    noise = {one.column: one.noise for one in found.signals}
    assert noise == {"marble_x": pytest.approx(NOISE, rel=0.15), "marble_y": None}
    assert warned(found) == []
    assert {one.where for one in found.findings} >= {"knob_x_rad", "marble_y"}
    assert found.identified is not None
    assert found.identified.intervals["gear_x"] is None
    assert any("gear_x" in one for one in found.identified.unidentifiable)
    assert "knob_x_rad" in found.next_recording


def test_tilt_alone_is_checked(make_rig):
    rig = make_rig()
    tilt_alone = changed(
        rig,
        tilt=lambda one: (
            0.3 * np.roll(one.knobs, 2, axis=0) + 0.0005 * np.sin(np.arange(240.0)).reshape(120, 2)
        ),
    )
    tilt_alone = changed(tilt_alone, marble=lambda one: np.full((120, 2), np.nan))
    found = check(tilt_alone)
    assert warned(found) == []
    assert found.identified is None
    (response,) = found.responses
    assert response.gain[0][0] == pytest.approx(0.3, rel=0.05)
    assert response.delay[0] == pytest.approx(2 * STEP_S, abs=STEP_S)


@pytest.mark.slow
def test_practice_and_real_rigs_raise_no_alarm(shared):
    # Every seventh practice rig: `irt check` takes half a second each.
    rigs = [*sorted((shared / "rigs").glob("rig-*"))[::7], *(shared / "real").glob("*/")]
    for path in rigs:
        found = check(load_rig(path))
        assert warned(found) == [], path.name
        assert all(one.best == "" for one in found.responses), path.name


def test_effects_at_the_knob_are_sized_in_the_unit_of_the_commands(make_rig):
    rig, factor = make_rig(), 2000.0
    runs = tuple(replace(one, knobs=factor * one.knobs, columns=CMD) for one in rig.recordings)
    # As steep as knobs that bring the board to its stops at 0.2 rad.
    ranges = {**rig.ranges, "gear_x": (0.0, 0.7), "gear_y": (0.0, 0.7)}
    own_ranges = {**rig.ranges, **dict.fromkeys(("gear_x", "gear_y"), (0.0, 0.7 / factor))}
    angles = check(replace(rig, ranges=ranges)).identified
    own = check(replace(rig, recordings=runs, commands=Commands("us"), ranges=own_ranges)).identified
    assert angles is not None
    assert own is not None
    for of_angles, of_own in zip(angles.effects, own.effects, strict=True):
        assert of_angles.effect == of_own.effect
        if of_angles.effect in {"backlash", "dead_band", "command_quantisation"}:
            assert (of_angles.unit, of_own.unit) == ("rad", "us")
            assert of_own.usual == pytest.approx(factor * of_angles.usual)
            assert of_own.smallest == pytest.approx(factor * of_angles.smallest, rel=0.1)
