from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.fitting import robust
from irt.fitting.coordinates import Coordinates
from irt.fitting.shooting import Linearisation, Shooting, cut
from irt.fitting.solver import Normal, minimise, search_nearby
from irt.residual import segments
from irt.rig import RANGES

COORDINATES = Coordinates.of(RANGES, np.ones(5))
TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])


def linearisation(seed, windows=3, rows=8, components=4):
    random = np.random.default_rng(seed)
    return Linearisation(
        random.standard_normal((1, windows, rows)),
        random.standard_normal((1, windows, rows, 5)),
        random.standard_normal((1, windows, rows, components)),
    )


@given(st.integers(0, 2**32 - 1))
def test_eliminating_the_states_gives_the_step_of_the_whole_system(seed):
    """Beside it the dense Jacobian, in which each window's states have columns of their own."""
    line, scale = linearisation(seed), np.array([0.7])
    none = np.zeros((1, 5)), np.zeros((1, 5, 5))
    dz, dstate = Normal.of(line, scale, *none).step(np.zeros(1), np.ones((1, 5), dtype=bool))
    dense = np.zeros((24, 5 + 12))
    dense[:, :5] = line.by_z.reshape(24, 5)
    for window in range(3):
        dense[8 * window : 8 * window + 8, 5 + 4 * window : 9 + 4 * window] = line.by_state[0, window]
    root = np.sqrt(robust.weight(line.residual, 0.7)).ravel()
    whole = np.linalg.lstsq(root[:, None] * dense, -root * line.residual.ravel(), rcond=None)[0]
    np.testing.assert_allclose(dz[0], whole[:5], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(dstate.ravel(), whole[5:], rtol=1e-4, atol=1e-6)


def test_what_may_not_move_stays():
    equations = Normal.of(linearisation(1), np.ones(1), np.zeros((1, 5)), np.zeros((1, 5, 5)))
    free = np.array([[True, False, True, True, False]])
    dz, _ = equations.step(np.full(1, 0.1), free)
    assert (dz[0, [1, 4]] == 0.0).all()
    assert (dz[0, [0, 2, 3]] != 0.0).all()


def test_a_coordinate_at_its_bound_is_free_only_inwards():
    equations = Normal.of(linearisation(2), np.ones(1), np.zeros((1, 5)), np.zeros((1, 5, 5)))
    dz, _ = equations.step(np.zeros(1), np.ones((1, 5), dtype=bool))
    root, _ = equations.spread()
    downhill = np.linalg.solve(root[0] @ root[0].T, dz[0])
    z = np.zeros((1, 5))
    np.testing.assert_array_equal(equations.free(z, z + 1.0, z)[0], downhill > 0.0)
    np.testing.assert_array_equal(equations.free(z - 1.0, z, z)[0], downhill < 0.0)
    assert equations.free(z - 1.0, z + 1.0, z).all()


def test_the_spread_is_the_covariance_of_the_whole_system():
    line = linearisation(3)
    spread, _ = Normal.of(line, np.array([1e3]), np.zeros((1, 5)), np.zeros((1, 5, 5))).spread()
    dense = np.zeros((24, 17))
    dense[:, :5] = line.by_z.reshape(24, 5)
    for window in range(3):
        dense[8 * window : 8 * window + 8, 5 + 4 * window : 9 + 4 * window] = line.by_state[0, window]
    covariance = np.linalg.inv(dense.T @ dense)[:5, :5] * 1e6 * robust.TAIL / (robust.TAIL + 1)
    np.testing.assert_allclose(spread[0] @ spread[0].T, covariance, rtol=1e-3, atol=1e-3 * covariance.max())


@pytest.mark.parametrize("stamped", [False, True])
def test_descent_finds_the_truth_from_nearby(planted, stamped):
    rig = planted(3, stamped=stamped)
    coordinates = Coordinates.of(RANGES, np.ones(5), TRUTH[3] if stamped else None)
    windows = cut(segments(rig), 100, at_rest=True)
    z = coordinates.to_z(TRUTH * [1.1, 0.9, 1.2, 1.0, 1.0])[None]
    solution = minimise(
        Shooting(rig, coordinates, windows), z, windows.guess[None], noise=1e-6, iterations=20
    )
    assert np.abs(solution.residual).max() < 1e-5
    found = coordinates.to_p(solution.z[0])
    np.testing.assert_allclose(found[:3] * found[3] ** 2 * found[4], TRUTH[:3] * 20.0**2 * 1.05, rtol=1e-3)
    assert (solution.path[0] == z).all()
    assert (solution.path[-1] == solution.z).all()


def test_held_coordinates_leave_the_states_to_move(planted):
    rig = planted(2, moving=True)
    windows = cut(segments(rig), 100, at_rest=False)
    z = COORDINATES.to_z(TRUTH)[None]
    start = windows.guess[None] + 0.01
    solution = minimise(Shooting(rig, COORDINATES, windows), z, start, noise=1e-6, iterations=12, held=True)
    assert (solution.z == z).all()
    assert np.abs(solution.residual).max() < 1e-5


def test_candidates_in_lockstep_end_where_they_end_alone(planted):
    """But for the draws around them, which keep to the solution where nothing is rough."""
    rig = planted(2)
    windows = cut(segments(rig), 100, at_rest=True)
    z = COORDINATES.to_z(TRUTH * np.array([[1.05, 1, 1, 1, 1], [1, 0.95, 1, 1, 1]]))
    states = np.repeat(windows.guess[None], 2, axis=0)
    together = minimise(Shooting(rig, COORDINATES, windows), z, states, noise=1e-6, iterations=15)
    for index in range(2):
        alone = minimise(
            Shooting(rig, COORDINATES, windows), z[[index]], states[[index]], noise=1e-6, iterations=15
        )
        np.testing.assert_allclose(alone.residual[0], together.residual[index], atol=1e-5)


def test_the_search_nearby_never_ends_worse(planted):
    rig = planted(2, noise=0.002)
    windows = cut(segments(rig), 100, at_rest=True)
    shooting = Shooting(rig, COORDINATES, windows)
    z, states = COORDINATES.to_z(TRUTH * [1.02, 1, 1, 1, 1]), windows.guess

    def loss(z, states):
        return robust.loss(shooting.residuals(z[None], states[None]), 0.002).sum()

    found = search_nearby(shooting, z, states, noise=0.002, rounds=3, rng=np.random.default_rng(0))
    assert loss(*found) < loss(z, states)
