from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irt.engine import rollouts
from irt.errors import IrtError
from irt.fitting.least_squares import least_squares
from irt.model import Effect
from irt.residual import predict
from irt.segments import segments

TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])


def test_the_first_estimate_is_the_models_and_every_path_begins_with_its_start(planted):
    fit = least_squares(planted(2, noise=1e-3), starts=4)
    assert len(fit.estimates) == 4
    errors = [estimate.final.mae for estimate in fit.estimates]
    assert errors[0] <= min(errors) * 1.05
    np.testing.assert_array_equal(fit.history[-1].parameters, fit.model.values)
    for estimate in fit.estimates:
        assert len(estimate.history) > 2
    assert fit.history[0].mae > fit.history[-1].mae


def test_residuals_are_those_of_the_model(planted):
    rig = planted(2, noise=1e-3)
    seen = rig.recordings[1].marble.copy()
    seen[5] = np.nan
    rig = replace(rig, recordings=(rig.recordings[0], replace(rig.recordings[1], marble=seen)))
    fit = least_squares(rig, starts=2)
    stretches = segments(rig)
    assert [residual.shape for residual in fit.residuals] == [one.observed.shape for one in stretches]
    assert np.isnan(fit.residuals[1][5]).all()
    left = np.concatenate(fit.residuals)
    assert np.nanstd(left) == pytest.approx(fit.noise, rel=0.2)
    assert fit.history[-1].mae == pytest.approx(np.nanmean(np.abs(left)))
    placed = [
        replace(one, start=one.observed[0] + residual[0])
        for one, residual in zip(stretches, fit.residuals, strict=True)
    ]
    for predicted, one, residual in zip(predict(fit.model, placed), stretches, fit.residuals, strict=True):
        np.testing.assert_allclose(predicted - one.observed, residual, atol=1e-9)


def test_a_whole_number_of_physics_steps_is_taken_where_nothing_speaks_against_it(planted):
    time_scale = least_squares(planted(2, noise=1e-3), starts=2).model.values[3]
    assert time_scale == pytest.approx(round(time_scale), abs=1e-9)


def test_of_equal_motions_one_within_the_ranges_is_taken(planted):
    """The truth has a gear of 0.12; with a longer time scale a smaller one does the same."""
    rig = planted(2, truth=np.array([0.12, 0.1, 0.0008, 14.0, 1.0]), noise=1e-4)
    found = least_squares(rig, starts=3).model.values
    for value, (low, high) in zip(found, rig.ranges.values(), strict=True):
        assert low <= value <= 1.001 * high
    assert found[0] * found[3] ** 2 * found[4] == pytest.approx(0.12 * 14.0**2, rel=0.01)


def test_a_truth_outside_the_ranges_is_found_where_stamps_leave_no_choice(planted):
    rig = planted(3, truth=np.array([0.16, 0.05, 0.0004, 12.0, 1.0]), noise=1e-4, stamped=True)
    fit = least_squares(rig, starts=3)
    found = fit.model.values
    assert found[0] * found[4] == pytest.approx(0.16, rel=0.01)
    assert found[0] > 0.1
    assert any("gear_x" in note and "outside its range" in note for note in fit.notes)
    assert found[3] == pytest.approx(12.0)


@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_the_sense_of_a_gear_shows_where_the_range_allows_both(planted, sense):
    truth = TRUTH * [sense, 1, 1, 1, 1]
    rig = planted(2, truth=truth, noise=1e-4)
    rig = replace(rig, ranges={**rig.ranges, "gear_x": (-0.1, 0.1)})
    found = least_squares(rig, starts=2).model.values
    assert found[0] * found[3] ** 2 * found[4] == pytest.approx(truth[0] * 400.0 * 1.05, rel=0.01)


def test_effects_are_fitted_along_and_belong_to_the_model(planted):
    rig = planted(3, noise=3e-4, stamped=True)
    lag = {"name": "lag", "time_constant_s": 0.15}
    recordings = []
    for recording in rig.recordings:
        marble = rollouts(
            [TRUTH],
            recording.knobs,
            effects=[lag],
            start=recording.marble[0],
            durations=recording.durations,
        )[0]
        noise = 3e-4 * np.random.default_rng(len(recordings)).standard_normal(marble.shape)
        recordings.append(replace(recording, marble=marble + noise))
    rig = replace(rig, recordings=tuple(recordings))
    fit = least_squares(rig, starts=3, effects=[Effect("lag", {"time_constant_s": 0.3})])
    found = fit.effects["lag"]["time_constant_s"]
    assert found.value == pytest.approx(0.15, rel=0.05)
    assert found.low <= 0.15 <= found.high
    assert fit.model.effects == (Effect("lag", {"time_constant_s": found.value}),)
    assert fit.noise == pytest.approx(3e-4, rel=0.2)
    without = least_squares(rig, starts=3)
    assert without.noise > 1.5 * fit.noise
    assert without.effects == {}


def test_ranges_that_hold_no_gear(planted):
    rig = planted(1)
    with pytest.raises(IrtError, match=r"gear_x: the range .* is empty"):
        replace(rig, ranges={**rig.ranges, "gear_x": (0.0, 0.0)})


def test_a_marble_that_was_never_seen(planted):
    rig = planted(1)
    marble = rig.recordings[0].marble.copy()
    marble[2:] = np.nan
    rig = replace(rig, recordings=(replace(rig.recordings[0], marble=marble),))
    with pytest.raises(IrtError, match="at least three rows"):
        least_squares(rig)


def test_no_start_points(planted):
    with pytest.raises(IrtError, match="starts: expected at least 1"):
        least_squares(planted(1), starts=0)


@pytest.mark.parametrize("stamped", [False, True])
def test_progress_goes_up_and_arrives(planted, stamped):
    reports = []
    least_squares(planted(1, stamped=stamped), starts=2, progress=lambda *report: reports.append(report))
    done = [report[0] for report in reports]
    assert done == sorted(done)
    assert {report[1] for report in reports} == {done[-1]}
    assert all("rows" in report[2] for report in reports)
