from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from irt.fitting.coordinates import SCALE, TIME, Coordinates
from irt.fitting.shooting import Shooting, cut
from irt.residual import Segment, segments
from irt.rig import RANGES

COORDINATES = Coordinates.of(RANGES, np.ones(5))


def segment(observed, first_row=0):
    observed = np.asarray(observed, dtype=float)
    knobs = np.arange(2.0 * len(observed)).reshape(-1, 2)
    return Segment("run", first_row, knobs, None, observed, observed[0], np.zeros(2))


@given(st.lists(st.integers(3, 50), min_size=1, max_size=4), st.integers(3, 60))
def test_windows_hold_every_row_once_and_no_other(lengths, rows):
    pieces = [segment(np.random.default_rng(n).random((n, 2))) for n in lengths]
    windows = cut(pieces, rows, at_rest=True)
    for index, piece in enumerate(pieces):
        own = np.flatnonzero(windows.origin[:, 0] == index)
        seen = [windows.observed[w][windows.known[w]].reshape(-1, 2) for w in own]
        firsts = windows.origin[own, 1]
        left_out = len(piece.knobs) % rows if 0 < len(piece.knobs) % rows < 3 else 0
        np.testing.assert_array_equal(np.concatenate(seen), piece.observed[: len(piece.knobs) - left_out])
        np.testing.assert_array_equal(windows.knobs[own, 0], piece.knobs[firsts])
    assert (windows.observed[~windows.known] == 0.0).all()


def test_only_the_first_window_of_a_recording_starts_at_rest():
    windows = cut([segment(np.zeros((20, 2))), segment(np.zeros((20, 2)), first_row=20)], 10, at_rest=True)
    assert windows.at_rest.tolist() == [True, False, False, False]
    assert windows.unknowns == 2 + 3 * 4
    assert not cut([segment(np.zeros((20, 2)))], 10, at_rest=False).at_rest.any()


def test_a_window_that_the_tracker_hardly_saw_is_left_out():
    observed = np.zeros((30, 2))
    observed[10:18] = np.nan
    assert cut([segment(observed)], 10, at_rest=True).origin[:, 1].tolist() == [0, 20]


def test_the_first_guess_is_on_the_path_whatever_one_row_does():
    time = np.arange(20.0)[:, None]
    observed = np.array([0.1, -0.2]) + time * np.array([0.01, -0.02])
    observed[10] = 0.9
    observed[12] = np.nan
    windows = cut([segment(observed)], 10, at_rest=False)
    np.testing.assert_allclose(windows.guess[1], [0.2, -0.4, 0.01, -0.02], atol=0.005)


def test_the_planted_truth_leaves_no_residual(planted):
    rig = planted()
    windows = cut(segments(rig), 100, at_rest=True)
    truth = COORDINATES.to_z(np.array([[0.06, 0.05, 0.0004, 20.0, 1.05]]))
    starts = np.zeros((1, 2, 4))
    starts[0, :, :2] = windows.observed[:, 0]
    assert np.abs(Shooting(rig, COORDINATES, windows).residuals(truth, starts)).max() < 1e-9


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(0.2, 0.8), min_size=5, max_size=5).map(np.array))
def test_slopes_foresee_small_changes_and_vanish_along_the_symmetries(planted, unit):
    """Away from the walls both symmetries hold: 0.1 rad of knob at most, from the centre."""
    rig = planted()
    windows = cut(segments(rig), 100, at_rest=True)
    shooting = Shooting(rig, COORDINATES, windows)
    low, high = np.array([0.03, 0.03, 0.0, 10.0, 0.9]), np.array([0.06, 0.06, 0.001, 15.0, 1.1])
    z, states = COORDINATES.to_z(low + unit * (high - low))[None], np.zeros((1, 2, 4))
    line = shooting.linearise(z, states)
    for axis in (TIME, SCALE):
        assert np.abs(line.by_z[0] @ COORDINATES.axes[axis]).max() < 1e-3
    change = np.array([2e-4, -1e-4, 0.0, 0.0, 3e-4])
    foreseen = line.residual[0] + line.by_z[0] @ change
    np.testing.assert_allclose(shooting.residuals(z + change, states)[0], foreseen, atol=2e-6)


def test_a_start_state_moves_its_own_window_only(planted):
    rig = planted(moving=True)
    windows = cut(segments(rig, 1.0), 12, at_rest=False)
    shooting = Shooting(rig, COORDINATES, windows)
    z = COORDINATES.to_z(np.array([[0.06, 0.05, 0.0004, 20.0, 1.05]]))
    states = windows.guess[None].copy()
    before, line = shooting.residuals(z, states), shooting.linearise(z, states)
    states[0, 1] += [2e-4, 0.0, 0.0, 1e-4]
    moved = shooting.residuals(z, states)[0] - before[0]
    assert (moved[[0, *range(2, len(moved))]] == 0.0).all()
    np.testing.assert_allclose(moved[1], line.by_state[0, 1] @ [2e-4, 0.0, 0.0, 1e-4], atol=1e-5)


def test_a_marble_at_rest_has_no_velocity_to_estimate(planted):
    rig = planted()
    shooting = Shooting(rig, COORDINATES, cut(segments(rig), 20, at_rest=True))
    z = COORDINATES.to_z(np.array([[0.06, 0.05, 0.0004, 20.0, 1.05]]))
    by_state = shooting.linearise(z, shooting.windows.guess[None]).by_state[0]
    at_rest = shooting.windows.at_rest
    assert (by_state[at_rest][..., 2:] == 0.0).all()
    assert np.abs(by_state[~at_rest][..., 2:]).max() > 1.0


def test_more_physics_steps_change_little(planted):
    rig = planted()
    shooting = Shooting(rig, COORDINATES, cut(segments(rig), 100, at_rest=True))
    z, states = COORDINATES.to_z(np.array([[0.06, 0.05, 0.0004, 20.0, 1.05]])), shooting.windows.guess[None]
    finer = np.abs(shooting.residuals(z, states, 1) - shooting.residuals(z, states)).max()
    assert 0.0 < finer < 1e-3


def test_coarse_steps_are_close_to_the_engines(planted):
    rig = planted()
    windows = cut(segments(rig), 10, at_rest=True)
    z, states = COORDINATES.to_z(np.array([[0.06, 0.05, 0.0004, 20.0, 1.05]])), windows.guess[None]
    coarse = Shooting(rig, COORDINATES, windows, coarseness=5).residuals(z, states)
    assert np.abs(coarse - Shooting(rig, COORDINATES, windows).residuals(z, states)).max() < 0.02


@pytest.mark.parametrize("stamped", [False, True])
def test_every_call_counts_its_rollouts(planted, stamped):
    rig = planted(3, stamped=stamped)
    shooting = Shooting(rig, COORDINATES, cut(segments(rig), 100, at_rest=True))
    shooting.residuals(np.repeat(COORDINATES.to_z(np.full((1, 5), 0.05)), 4, axis=0), np.zeros((4, 3, 4)))
    assert shooting.rollouts == 4 * 3
