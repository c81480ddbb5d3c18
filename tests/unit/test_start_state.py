from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from irt.engine import rollouts, turned
from irt.errors import IrtError
from irt.model import Effect, Model, Parameter
from irt.recording import Recording
from irt.rig import PARAMETERS, RANGES, Board, Marble
from irt.segments import inputs_of, segment_of
from irt.start_state import Inputs, estimate_start_states, simulate

VALUES = (0.07, 0.06, 0.0005, 12.4, 1.05)
ROWS = 5


def model(**changes: float) -> Model:
    values = dict(zip(PARAMETERS, VALUES, strict=True)) | changes
    return Model(
        board=Board(),
        marble=Marble(),
        start="moving",
        ranges=dict(RANGES),
        parameters={name: Parameter(value) for name, value in values.items()},
    )


@pytest.fixture
def knobs() -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.1, 0.1, (6, ROWS, 2))


@pytest.fixture
def states() -> np.ndarray:
    rng = np.random.default_rng(2)
    return np.hstack([rng.uniform(-0.2, 0.2, (6, 2)), rng.uniform(-0.5, 0.5, (6, 2))])


@pytest.mark.parametrize("time_step", ["rounded", "continuous"])
def test_simulate_honours_the_model(knobs, states, time_step) -> None:
    wide = dataclasses.replace(model(), board=Board(edge_x_m=0.5, edge_y_m=0.5), time_step=time_step)
    expected = rollouts(
        [VALUES],
        knobs[:1],
        rig=wide,
        start=states[:1, :2],
        start_velocity=states[:1, 2:],
        time_step=time_step,
    )
    np.testing.assert_array_equal(simulate(wide, Inputs.of_whole(knobs), states)[:1], expected)


def test_simulate_takes_time_from_durations(knobs, states) -> None:
    durations = np.full((6, ROWS), 0.1)
    slow, fast = (
        simulate(model(time_scale=scale), Inputs.of_whole(knobs, durations), states) for scale in (5.0, 50.0)
    )
    np.testing.assert_array_equal(slow, fast)


def test_simulate_passes_effects_on(knobs, states) -> None:
    unheard_of = dataclasses.replace(model(), effects=(Effect("unheard_of", {"strength": 1.0}),))
    with pytest.raises(IrtError, match="unheard_of"):
        simulate(unheard_of, Inputs.of_whole(knobs), states)


def test_effects_remember_what_was_commanded_before_a_window(knobs, states) -> None:
    slow = dataclasses.replace(model(), effects=(Effect("lag", {"time_constant_s": 0.3}),))
    long = np.concatenate([knobs, knobs[::-1]], axis=1)
    inputs = Inputs(long, None, np.arange(6) % 3 + 2, np.full(6, 2 * ROWS), ROWS, np.zeros(6))
    seen = simulate(slow, inputs, states)
    for i, first in enumerate(inputs.first):
        # What comes after a window does not matter to it, what was before does.
        rows = np.array([first + ROWS])
        cut = Inputs(long[i : i + 1, : first + ROWS], None, inputs.first[i : i + 1], rows, ROWS, np.zeros(1))
        np.testing.assert_array_equal(simulate(slow, cut, states[i : i + 1])[0], seen[i])
        forgetful = Inputs.of_whole(long[i : i + 1, first : first + ROWS])
        assert np.abs(simulate(slow, forgetful, states[i : i + 1])[0] - seen[i]).max() > 1e-5
    found = estimate_start_states(slow, inputs, seen, np.zeros((6, 4)))
    np.testing.assert_allclose(found, states, atol=1e-6)


@pytest.mark.parametrize("follows", [0, 1])
@pytest.mark.parametrize("engine", ["rolling", "rapier"])
def test_a_marble_is_turned_as_far_as_it_has_rolled(engine, follows) -> None:
    """A window that begins half-way goes on as the whole run does, given the path up to there."""
    values = [[0.05, 0.04, 2e-4, 1.0, 1.0]]
    knobs = np.array([[0.03, 0.05]]).repeat(300, axis=0)
    knobs[80:] = [-0.03, 0.06]
    effect = {"name": "eccentric_marble", "offset": 0.002, "phase_rad": 1.0, "lean_rad": 0.4}
    heavy = {"effects": [{**effect, "follows_path": follows}], "engine": engine}
    whole = rollouts(values, knobs, **heavy)[0]
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(whole, axis=0).T))) * Board().edge_x_m
    half = 200
    begun = {
        "start": whole[half],
        "start_velocity": (whole[half + 1] - whole[half - 1]) * 120.0,
        "knobs_before": knobs[0],
    }
    before = {
        "rolled": way[half],
        "turned": turned(whole * Board().edge_x_m, Marble().radius_m)[half],
    }
    played = rollouts(values, knobs[half:], **before, **begun, **heavy)[0]
    unplayed = rollouts(values, knobs[half:], **begun, **heavy)[0]
    gone = np.abs(whole[half:] - whole[half]).max()
    assert np.abs(played - whole[half:]).max() < 0.01 * gone
    assert np.abs(unplayed - whole[half:]).max() > 0.05 * gone


def test_a_segment_knows_how_the_marble_was_turned_before_it() -> None:
    """By the path of its own recording; without it the heavy side is somewhere else."""
    effect = {"offset": 0.002, "phase_rad": 1.0, "lean_rad": 0.4, "follows_path": 0.0}
    level = model(gear_x=0.05, gear_y=0.04, rolling_friction=2e-4, time_scale=1.0, observation_scale=1.0)
    heavy = dataclasses.replace(level, effects=(Effect("eccentric_marble", effect),), start="rest")
    knobs = np.array([[0.03, 0.05]]).repeat(300, axis=0)
    knobs[80:] = [-0.03, 0.06]
    whole = simulate(heavy, Inputs.of_whole(knobs[None]), np.zeros((1, 4)))[0]
    half = 200
    state = np.append(whole[half], (whole[half + 1] - whole[half - 1]) * 120.0)
    segment = segment_of(Recording("run", Path("run.csv"), knobs, whole), slice(half, 300), state)
    inputs = inputs_of([segment], whole=True)
    unplayed = dataclasses.replace(inputs, paths=(), path=None)
    missed, astray = (
        np.abs(simulate(heavy, one, state[None])[0] - whole[half:]).max() for one in (inputs, unplayed)
    )
    gone = np.abs(whole[half:] - whole[half]).max()
    assert missed < 0.01 * gone
    assert astray > 0.05 * gone
    # Windows that are repeated, as for finite differences, keep their paths.
    twice = simulate(heavy, inputs.repeated(2), np.tile(state, (2, 1)))
    np.testing.assert_array_equal(twice, simulate(heavy, inputs, state[None]).repeat(2, axis=0))


@pytest.mark.parametrize("stamped", [False, True])
def test_finds_planted_states(knobs, states, stamped) -> None:
    durations = np.full((6, ROWS), 0.08) if stamped else None
    observed = simulate(model(), Inputs.of_whole(knobs, durations), states)
    found = estimate_start_states(model(), Inputs.of_whole(knobs, durations), observed, np.zeros((6, 4)))
    np.testing.assert_allclose(found, states, atol=1e-6)


def test_lost_rows_are_left_out(knobs, states) -> None:
    observed = simulate(model(), Inputs.of_whole(knobs), states)
    observed[:, 2] = np.nan
    observed[0, 0] = np.nan
    found = estimate_start_states(model(), Inputs.of_whole(knobs), observed, np.zeros((6, 4)))
    np.testing.assert_allclose(found, states, atol=1e-6)


def test_noise_is_averaged_over_the_rows(knobs, states) -> None:
    observed = simulate(model(), Inputs.of_whole(knobs), states)
    noisy = observed + np.random.default_rng(3).normal(0.0, 0.002, observed.shape)
    found = estimate_start_states(model(), Inputs.of_whole(knobs), noisy, np.zeros((6, 4)))
    error = np.linalg.norm(simulate(model(), Inputs.of_whole(knobs), found) - noisy)
    assert error < np.linalg.norm(observed - noisy)
    np.testing.assert_allclose(found[:, :2], states[:, :2], atol=0.006)
    np.testing.assert_allclose(found[:, 2:], states[:, 2:], atol=0.06)  # five standard errors


def test_a_wall_inside_the_rows_is_no_obstacle() -> None:
    # The marble rolls to the wall in x, meets it after two rows and stays there; in y it rolls on.
    knobs = np.zeros((1, ROWS, 2))
    planted = np.array([[0.42, -0.1, 0.6, 0.3]])
    observed = simulate(model(), Inputs.of_whole(knobs), planted)
    assert observed[0, -1, 0] == observed[0, -2, 0]
    guess = np.hstack([observed[:, 0], (observed[:, 1] - observed[:, 0]) / 0.05])
    found = estimate_start_states(model(), Inputs.of_whole(knobs), observed, guess)
    np.testing.assert_allclose(found, planted, atol=1e-4)


def test_the_marble_stays_between_the_walls(knobs) -> None:
    beyond = np.array([0.7, -0.6]) + np.zeros((6, ROWS, 2))
    found = estimate_start_states(
        model(), Inputs.of_whole(knobs), beyond, np.tile([0.7, -0.6, 0.0, 0.0], (6, 1))
    )
    reach = 1.05 * (np.array([0.276, 0.231]) / 2 - 0.00685) / 0.276
    np.testing.assert_allclose(found[:, :2], np.tile(reach * [1, -1], (6, 1)))


def test_a_marble_that_friction_holds() -> None:
    # Any velocity too small to leave its place explains the observations; the place is what counts.
    observed = np.tile([0.1, 0.2], (1, ROWS, 1))
    sticky, still = model(rolling_friction=0.5), Inputs.of_whole(np.zeros((1, ROWS, 2)))
    found = estimate_start_states(sticky, still, observed, np.zeros((1, 4)))
    np.testing.assert_allclose(simulate(sticky, still, found), observed, atol=1e-5)


def test_a_window_does_not_depend_on_its_batch(knobs, states) -> None:
    observed = simulate(model(), Inputs.of_whole(knobs), states) + 0.001
    together = estimate_start_states(model(), Inputs.of_whole(knobs), observed, np.zeros((6, 4)))
    for i in range(6):
        one = slice(i, i + 1)
        alone = estimate_start_states(model(), Inputs.of_whole(knobs[one]), observed[one], np.zeros((1, 4)))
        np.testing.assert_array_equal(alone, together[one])
