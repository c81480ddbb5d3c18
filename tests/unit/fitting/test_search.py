from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.errors import IrtError
from irt.fitting.search import Search, space_filling
from irt.residual import segments

TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])


def searched(rig, starts=2, progress=None, time_scale=None):
    search = Search(rig, segments(rig), time_scale, engine="rolling", threads=None, progress=progress)
    return search, search.run(starts, 0)


@given(st.integers(1, 300), st.integers(0, 2**32 - 1))
def test_a_draw_fills_the_cube(count, seed):
    points = space_filling(count, seed)
    assert points.shape == (count, 5)
    assert ((points >= 0.0) & (points < 1.0)).all()
    np.testing.assert_array_equal(points, space_filling(count, seed))
    for axis in points.T:
        gaps = np.diff(np.sort(axis), append=1.0 + axis.min())
        assert gaps.max() <= 8.0 / count


def test_the_first_is_the_best_and_every_path_begins_with_its_start(planted):
    rig = planted(2, noise=1e-3)
    search, candidates = searched(rig, starts=4)
    assert len(candidates) == 4
    losses = [np.abs(candidate.residual).sum() for candidate in candidates]
    assert losses[0] <= min(losses) * 1.05
    for candidate in candidates:
        assert (candidate.path[-1] == candidate.z).all()
        assert len(candidate.path) > 2
        assert search.errors(candidate)[-1] == pytest.approx(
            np.abs(candidate.residual).sum() / search.whole.known.sum()
        )


def test_a_whole_number_of_physics_steps_is_taken_where_nothing_speaks_against_it(planted):
    search, candidates = searched(planted(2, noise=1e-3))
    time_scale = search.coordinates.to_p(candidates[0].z)[3]
    assert time_scale == pytest.approx(round(time_scale), abs=1e-9)


def test_of_equal_motions_one_within_the_ranges_is_taken(planted):
    """The truth has a gear of 0.12; with a longer time scale a smaller one does the same."""
    rig = planted(2, truth=np.array([0.12, 0.1, 0.0008, 14.0, 1.0]), noise=1e-4)
    search, candidates = searched(rig, starts=3)
    found = search.coordinates.to_p(candidates[0].z)
    for value, (low, high) in zip(found, rig.ranges.values(), strict=True):
        assert low <= value <= high
    assert found[0] * found[3] ** 2 * found[4] == pytest.approx(0.12 * 14.0**2, rel=0.01)


def test_a_truth_outside_the_ranges_is_found_where_stamps_leave_no_choice(planted):
    rig = planted(3, truth=np.array([0.16, 0.05, 0.0004, 12.0, 1.0]), noise=1e-4, stamped=True)
    search, candidates = searched(rig, starts=3, time_scale=12.0)
    found = search.coordinates.to_p(candidates[0].z)
    assert found[0] * found[4] == pytest.approx(0.16, rel=0.01)
    assert found[0] > 0.1


@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_the_sense_of_a_gear_shows_where_the_range_allows_both(planted, sense):
    truth = TRUTH * [sense, 1, 1, 1, 1]
    rig = planted(2, truth=truth, noise=1e-4)
    rig = replace(rig, ranges={**rig.ranges, "gear_x": (-0.1, 0.1)})
    search, candidates = searched(rig)
    found = search.coordinates.to_p(candidates[0].z)
    assert found[0] * found[3] ** 2 * found[4] == pytest.approx(truth[0] * 400.0 * 1.05, rel=0.01)


def test_ranges_that_hold_no_gear(planted):
    rig = planted(1)
    rig = replace(rig, ranges={**rig.ranges, "gear_x": (0.0, 0.0)})
    with pytest.raises(IrtError, match="gear_x and gear_y leave nothing to search"):
        searched(rig)


def test_a_marble_that_was_never_seen(planted):
    rig = planted(1)
    marble = rig.recordings[0].marble.copy()
    marble[2:] = np.nan
    rig = replace(rig, recordings=(replace(rig.recordings[0], marble=marble),))
    with pytest.raises(IrtError, match="too few rows"):
        searched(rig)


@pytest.mark.parametrize("time_scale", [None, 20.0])
def test_progress_goes_up_and_arrives(planted, time_scale):
    reports = []
    rig = planted(1, stamped=time_scale is not None)
    searched(rig, progress=lambda *report: reports.append(report), time_scale=time_scale)
    done = [report[0] for report in reports]
    assert done == sorted(done)
    assert {report[1] for report in reports} == {done[-1]}
    assert all("rows" in report[2] for report in reports)
