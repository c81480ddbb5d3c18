from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irt.errors import IrtError
from irt.fitting.problem import Problem, noise_in
from irt.model import Effect
from irt.rig import PARAMETERS
from irt.segments import segments

TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])


@pytest.mark.parametrize("sd", [1e-4, 1e-3, 1e-2])
def test_the_trackers_noise_shows_in_the_recording_alone(sd):
    random = np.random.default_rng(1)
    time = np.linspace(0.0, 4.0 * np.pi, 400)
    smooth = 0.3 * np.stack([np.sin(time), np.cos(0.7 * time)], axis=1)
    observed = smooth + sd * random.standard_normal(smooth.shape)
    observed[::40] = 0.9
    observed[13:17] = np.nan
    assert noise_in([observed]) == pytest.approx(sd, rel=0.2)


def test_noise_of_next_to_no_rows_is_still_positive():
    assert 0.0 < noise_in([np.zeros((3, 2))]) < 1e-5


def test_segments_of_a_recording_share_it(planted):
    """Effects remember commands from before a window, and its clock is that of the whole recording."""
    rig = planted(2, moving=True)
    asked = Problem.of(rig, segments(rig, 1.0)).asked
    assert len(asked["recordings"]) == 2
    assert {recording for recording, *_ in asked["stretches"]} == {0, 1}
    for (knobs, durations, observed, way, path, tilt), recording, before in zip(
        asked["recordings"], rig.recordings, asked["knobs_before"], strict=True
    ):
        np.testing.assert_array_equal(knobs, recording.knobs)
        assert durations is None
        np.testing.assert_array_equal(observed, recording.marble)
        np.testing.assert_array_equal(way, recording.way)
        np.testing.assert_array_equal(path, recording.rolled_path)
        assert tilt is None
        np.testing.assert_array_equal(before, recording.knobs[0])
    assert not any(at_rest for *_, at_rest in asked["stretches"])


def test_a_board_at_rest_was_level_before(planted):
    rig = planted(1)
    asked = Problem.of(rig, segments(rig)).asked
    assert (asked["knobs_before"] == 0.0).all()
    assert asked["stretches"] == [(0, 0, len(rig.recordings[0].knobs), True)]


def test_effects_have_names_ranges_and_starts(planted):
    rig = planted(1)
    problem = Problem.of(
        rig, segments(rig), effects=[Effect("tilt_bias", {"bias_y_rad": 0.002}), Effect("lag", {})]
    )
    assert problem.names == (
        *PARAMETERS,
        "tilt_bias.bias_x_rad",
        "tilt_bias.bias_y_rad",
        "lag.time_constant_s",
    )
    assert problem.ranges.shape == problem.allowed.shape == (8, 2)
    (_, bias), (_, lag) = problem.asked["effects"]
    np.testing.assert_array_equal(bias[:, 2], [np.nan, 0.002])
    np.testing.assert_array_equal(lag[:, 2], [np.nan, 0.0])
    assert problem.allowed[7, 0] == 0.0


def test_an_optional_parameter_is_neutral_unless_it_is_named(planted):
    rig = planted(1)
    held = {"gear_nonlinearity": {"y_minus_x_per_rad2": 3.0}}
    effects = [Effect("lag", {"y_minus_x_s": 0.05}), Effect("dead_band", {}), Effect("gear_nonlinearity", {})]
    problem = Problem.of(rig, segments(rig), effects=effects, held=held)
    assert problem.names[5:] == (
        "lag.time_constant_s",
        "lag.y_minus_x_s",
        "dead_band.half_width_rad",
        "gear_nonlinearity.cubic_per_rad2",
        "gear_nonlinearity.y_minus_x_per_rad2",
    )
    (_, lag), (_, band), (_, gear) = problem.asked["effects"]
    np.testing.assert_array_equal(lag[1], [-0.5, 0.5, 0.05])
    np.testing.assert_array_equal(band[1], [np.nan, np.nan, 0.0])
    np.testing.assert_array_equal(gear[1], [np.nan, np.nan, 3.0])


def test_what_is_held_at_neutral_is_no_part_of_what_comes_back(planted):
    lag = {"time_constant_s": 0.12, "y_minus_x_s": 0.16}
    rig = planted(3, effects=[{"name": "lag", **lag}])
    tied = Problem.of(
        rig, segments(rig), effects=[Effect("tilt_bias", {}), Effect("lag", {})], time_scale=20.0
    )
    apart = Problem.of(
        rig,
        segments(rig),
        effects=[Effect("lag", {"y_minus_x_s": 0.0}), Effect("tilt_bias", {})],
        time_scale=20.0,
    )
    begin = [*TRUTH, 0.0, 0.0, 0.1]
    (one,) = tied.refine(np.array([begin]))
    (other,) = apart.refine(np.array([[*TRUTH, 0.1, 0.0, 0.0, 0.0]]))
    assert one.values.shape == (8,)
    np.testing.assert_allclose(other.values[5:7], list(lag.values()), rtol=0.1)
    curvature = tied.inform(one.values, 1e-3)
    np.testing.assert_array_equal(curvature.free, [0, 1, 2, 4, 5, 6, 7])


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ([Effect("warp_drive", {})], "unknown effect"),
        ([Effect("lag", {"time": 0.1})], "parameter of lag"),
        ([Effect("lag", {}), Effect("lag", {})], "each one once"),
    ],
)
def test_effects_that_the_engine_does_not_have(planted, effects, message):
    rig = planted(1)
    with pytest.raises(IrtError, match=message):
        Problem.of(rig, segments(rig), effects=effects)


HEAVY = {"offset": 0.003, "phase_rad": 3.0, "lean_rad": 0.2}


@pytest.mark.parametrize("follows", [0.0, 1.0])
def test_a_choice_is_made_by_what_fits_and_is_no_parameter_to_fit(planted, follows):
    effect = Effect("eccentric_marble", HEAVY | {"follows_path": follows})
    rig = planted(3, effects=[{"name": effect.name, **effect.parameters}])
    problem = Problem.of(rig, segments(rig), effects=[Effect("eccentric_marble", {})], time_scale=20.0)
    near = np.array([*TRUTH * 1.05, 0.0025, 3.1, 0.0])
    points = np.array([[*near, answer] for answer in (0.0, 1.0)])
    found = problem.fit(points=points, rounds=0)
    assert found.values[-1] == follows
    assert len(found.values) - 1 not in found.information.free
    assert found.rollouts > problem.fit(points=points[:1], rounds=0).rollouts
    # Each point keeps its own answer, in the order in which they were given.
    assert [one.values[-1] for one in problem.refine(points, iterations=2)] == [0.0, 1.0]
    made = Problem.of(rig, segments(rig), effects=[Effect("eccentric_marble", {"follows_path": follows})])
    assert made.choices == ()


def test_without_a_point_every_answer_is_tried(planted):
    effect = Effect("eccentric_marble", HEAVY | {"follows_path": 0.0})
    rig = planted(3, effects=[{"name": effect.name, **effect.parameters}])
    reports = []
    problem = Problem.of(rig, segments(rig), effects=[Effect("eccentric_marble", {})])
    found = problem.fit(rounds=0, progress=lambda *report: reports.append(report))
    assert found.values[-1] == 0.0
    done, totals = [done for done, *_ in reports], {total for _, total, _ in reports}
    # A bar that has arrived begins no second time.
    assert done == sorted(done)
    assert totals == {done[-1]}


def test_windows_know_how_the_marble_was_turned_before_them(planted):
    effect = Effect("eccentric_marble", HEAVY | {"follows_path": 0.0})
    rig = planted(2, moving=True, effects=[{"name": effect.name, **effect.parameters}])
    truth = np.array([[*TRUTH, *effect.parameters.values()]])
    with_path = Problem.of(rig, segments(rig, 1.0), effects=[effect])
    standing = [(*rest, np.zeros_like(path), tilt) for *rest, path, tilt in with_path.asked["recordings"]]
    without_path = replace(with_path, asked={**with_path.asked, "recordings": standing})
    left = [
        max(float(np.abs(one).max()) for one in problem.judge(truth)[0].residuals)
        for problem in (with_path, without_path)
    ]
    assert left[0] < 0.05 * left[1]
    assert left[1] > 1e-3
