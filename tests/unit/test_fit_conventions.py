"""Each of the eight symmetries, planted in simulated recordings, comes back; noise shows none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irt.conventions import CONVENTIONS, Signals, fit_acceleration, fit_level, resampled

DELAYS = np.arange(7.0)


def rolling(seed, rows=200, delay=2, gain=0.02, noise=0.0003):
    """Return commands and a marble that rolls freely: x by +command y, y by -command x."""
    random = np.random.default_rng(seed)
    commands = np.zeros((rows, 2))
    for row in range(1, rows):
        commands[row] = 0.9 * commands[row - 1] + 0.02 * random.standard_normal(2)
    late = np.vstack([np.zeros((delay, 2)), commands[: rows - delay]])
    push = gain * late[:, ::-1] * [1.0, -1.0]
    velocity = np.cumsum(push, axis=0)
    marble = np.vstack([np.zeros(2), np.cumsum(velocity - 0.5 * push, axis=0)[:-1]])
    return commands, marble + noise * random.standard_normal(marble.shape)


def planted(convention, seeds=range(4), **options):
    runs = []
    for seed in seeds:
        commands, marble = rolling(seed, **options)
        if convention.swapped:
            commands = commands[:, ::-1]
        runs.append(Signals(commands, marble * convention.signs))
    return runs


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_a_planted_convention_comes_back(convention):
    found = fit_acceleration(planted(convention), DELAYS)
    assert found.best == convention
    assert found.contradicts(z=1.6, share=0.15) == (not convention.is_declared)


def test_gains_delays_and_their_errors_come_back():
    found = fit_acceleration(planted(CONVENTIONS[0]), DELAYS)
    assert found.gain[0, 1] == pytest.approx(0.02, abs=4.0 * found.error[0, 1])
    assert found.gain[1, 0] == pytest.approx(-0.02, abs=4.0 * found.error[1, 0])
    assert np.abs([found.gain[0, 0], found.gain[1, 1]]).max() < 0.002
    assert found.delay.tolist() == [2.0, 2.0]
    assert found.explained.min() > 0.9


@given(st.integers(0, 2**32))
@settings(max_examples=20, deadline=None)
def test_a_marble_that_does_not_follow_contradicts_nothing(seed):
    random = np.random.default_rng(seed)
    runs = [Signals(rolling(one)[0], 0.001 * random.standard_normal((200, 2))) for one in range(3)]
    assert not fit_acceleration(runs, DELAYS).contradicts(z=1.6, share=0.15)


def test_gaps_walls_and_a_wild_stretch_do_not_turn_the_answer():
    runs = []
    for run in planted(CONVENTIONS[0]):
        outputs = run.outputs.copy()
        outputs[40:50] = np.nan
        outputs[120:124] += 0.3
        used = np.ones(outputs.shape, dtype=bool)
        used[150:] = False
        runs.append(Signals(run.inputs, outputs, used))
    found = fit_acceleration(runs, DELAYS)
    assert found.best.is_declared
    assert found.gain[0, 1] == pytest.approx(0.02, rel=0.1)


def test_an_axis_that_never_moves_is_left_out():
    runs = [Signals(run.inputs * [0.0, 1.0], run.outputs * [1.0, 0.0]) for run in planted(CONVENTIONS[0])]
    found = fit_acceleration(runs, DELAYS)
    assert found.best.is_declared
    assert np.isnan(found.gain[1]).all()
    assert np.isnan(found.gain[0, 0])
    assert found.gain[0, 1] == pytest.approx(0.02, rel=0.05)


def test_too_short_runs_give_nothing():
    assert fit_acceleration([Signals(np.zeros((4, 2)), np.zeros((4, 2)))], DELAYS) is None


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_the_level_of_a_tilt_follows_its_commands(convention):
    runs = []
    for seed in range(3):
        commands, _ = rolling(seed)
        tilt = 0.3 * np.vstack([np.zeros((3, 2)), commands[:-3]]) + [0.02, -0.04]
        tilt += 0.0005 * np.random.default_rng(seed).standard_normal(tilt.shape)
        tilt = tilt * convention.signs
        runs.append(Signals(commands[:, ::-1] if convention.swapped else commands, tilt))
    found = fit_level(runs, DELAYS)
    assert found.best == convention
    assert found.delay.tolist() == [3.0, 3.0]


def test_uneven_stamps_are_put_on_even_ones():
    random = np.random.default_rng(0)
    times = np.cumsum(0.03 * random.uniform(0.9, 1.1, 300))
    smooth = np.stack([np.sin(times), np.cos(times)], axis=1)
    held, path = resampled(times, smooth, smooth, held=(True, False))
    step = np.median(np.diff(times))
    grid = times[0] + step * np.arange(len(path))
    assert np.abs(path - np.stack([np.sin(grid), np.cos(grid)], axis=1)).max() < 1e-3
    assert np.abs(held - path).max() < 0.04
