"""The array interface: shapes, units, refusals, threads and Ctrl-C."""

import os
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt import catalogue
from irt.catalogue import effects
from irt.engine import SUBSTEP_S, paper_drive, rollouts
from irt.errors import IrtError
from irt.rig import Board, Marble

PAPER = np.array([[0.05, 0.06, 0.0004, 20.0, 1.0]])


def test_a_tilt_about_y_accelerates_along_x_by_five_sevenths_of_g_sin():
    gear, knob, rows = 0.05, 0.1, 11
    seen = rollouts([[gear, 0.02, 0.0, 24.0, 0.9]], np.tile([0.0, knob], (rows, 1)))
    updates = 24.0 * np.arange(rows)
    pushed = 5 / 7 * 9.81 * np.sin(0.02 * knob) * SUBSTEP_S**2 * updates * (updates + 1) / 2
    np.testing.assert_allclose(seen[0, :, 0], 0.9 * pushed / 0.276, rtol=1e-10)
    assert (seen[0, :, 1] == 0).all()


@pytest.mark.parametrize("engine", ["rolling", "rapier"])
def test_row_zero_is_the_observed_start(engine):
    start = np.array([[0.1, -0.2], [0.3, 0.05]])
    parameters = np.repeat(PAPER, 2, axis=0) * [1, 1, 1, 1, 1.2]
    seen = rollouts(parameters, paper_drive(10), start=start, engine=engine)
    assert seen.shape == (2, 10, 2)
    assert (seen[:, 0] == start).all()


def test_paper_drive_is_one_period_and_literally_a_fraction_of_it():
    t = np.arange(100)
    expected = 0.1 * np.stack([np.sin(2 * np.pi * t / 100), np.cos(2 * np.pi * t / 100)], axis=1)
    np.testing.assert_allclose(paper_drive(), expected, atol=1e-15)
    np.testing.assert_allclose(paper_drive(literal=True)[-1, 0], 0.1 * np.sin(99 / (200 * np.pi)))


def test_the_time_scale_is_rounded_unless_continuous():
    parameters = [[0.05, 0.06, 0.0004, scale, 1.0] for scale in (20.4, 20.0)]
    rounded = rollouts(parameters, paper_drive(30))
    assert (rounded[0] == rounded[1]).all()
    continuous = rollouts(parameters, paper_drive(30), time_step="continuous")
    assert (continuous[1] == rounded[1]).all()
    np.testing.assert_allclose(continuous[0, -1, 0] / continuous[1, -1, 0], (20.4 / 20) ** 2, rtol=0.01)


def test_fixed_substeps_make_the_time_scale_smooth():
    scales = np.linspace(20.4999, 20.5001, 9)
    parameters = [[0.05, 0.06, 0.0004, scale, 1.0] for scale in scales]
    seen = rollouts(parameters, paper_drive(30), time_step="continuous", substeps=[20] * 9)[:, -1, 0]
    second_difference = np.abs(np.diff(seen, 2)).max()
    assert second_difference < 1e-3 * np.abs(np.diff(seen)).min()


def test_durations_replace_the_time_scale():
    steps = np.full(30, 20 * SUBSTEP_S)
    seen = rollouts(PAPER * [1, 1, 1, 0.1, 1], paper_drive(30), durations=steps)
    np.testing.assert_allclose(seen, rollouts(PAPER, paper_drive(30)), atol=1e-12)


def test_start_velocity_is_in_observed_edges_per_second():
    level = np.zeros((5, 2))
    seen = rollouts([[0.05, 0.05, 0.0, 24.0, 1.1]], level, start_velocity=[0.2, -0.1])
    np.testing.assert_allclose(seen[0, -1], [0.2 * 0.4, -0.1 * 0.4], rtol=1e-12)


def test_a_rig_brings_its_board_and_marble():
    rig = SimpleNamespace(board=Board(edge_x_m=0.5, edge_y_m=0.4), marble=Marble(damping_per_s=0.3))
    here = rollouts(PAPER, paper_drive(60))
    there = rollouts(PAPER, paper_drive(60), rig=rig)
    ratio = there[0, 5] / here[0, 5]
    np.testing.assert_allclose(ratio[0], 0.276 / 0.5, rtol=0.1)
    assert np.abs(there[0, :, 0]).max() <= 0.5 - 0.00685 / 0.5


@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_bits_do_not_depend_on_threads_or_company(count, seed):
    rng = np.random.default_rng(seed)
    parameters = rng.random((count, 5)) * [0.1, 0.1, 0.001, 50, 0.4] + [0, 0, 0, 0, 0.8]
    drive = paper_drive(20)
    together = rollouts(parameters, drive, threads=1)
    assert (rollouts(parameters, drive, threads=3) == together).all()
    assert (rollouts(parameters[-1:], drive)[0] == together[-1]).all()


def test_arrays_may_be_strided():
    parameters = np.repeat(PAPER, 4, axis=0)
    drive = paper_drive(40)
    strided = rollouts(np.asfortranarray(parameters)[::2], drive[::2], start=np.zeros((2, 4))[:, ::2])
    assert (strided == rollouts(parameters[:2], drive[::2].copy())).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parameters": PAPER[0]}, r"parameters: expected shape \(n, 5\), got \(5,\)"),
        ({"parameters": np.ones((2, 4))}, r"expected shape \(n, 5\), got \[2, 4\]"),
        ({"parameters": PAPER * np.nan}, "gear_x of rollout 0: expected a finite number, got NaN"),
        ({"parameters": "many"}, "parameters: expected numbers"),
        ({"commands": np.zeros((10, 3))}, "shape"),
        ({"commands": np.zeros((0, 2))}, "at least one row"),
        ({"commands": np.zeros((3, 10, 2))}, "expected one for each of the 1 rollouts, got 3"),
        ({"commands": np.full((10, 2), np.inf)}, "commands of rollout 0: expected finite numbers"),
        ({"start": [0.0, np.nan]}, "start of rollout 0: expected finite numbers"),
        ({"start": [0.0, 0.0, 0.0]}, "start: expected shape"),
        ({"engine": "bullet"}, r"unknown engine 'bullet' \(possible: rolling, rapier\)"),
        ({"durations": np.ones(3)}, "durations: expected 10 rows as in commands, got 3"),
        ({"durations": -np.ones(10)}, "durations of rollout 0: expected 0 to 20 s a row"),
        ({"time_step": "exact"}, 'unknown time_step "'),
        ({"substeps": [0]}, "substeps: expected 1 whole numbers of at least 1"),
        ({"threads": 0}, "threads: expected 1 to 1024, got 0"),
        ({"effects": [{"name": "backlsh"}]}, 'unknown effect "backlsh"'),
        ({"effects": ["bump"]}, "effects: expected mappings with a name and parameters, got 'bump'"),
        (
            {"effects": [{"name": "bump", "hight_m": 0.1}]},
            'unknown parameter of bump "hight_m"; did you mean',
        ),
        (
            {"effects": [{"name": "bump", "height_m": "tall"}]},
            "bump, height_m: expected a number, got 'tall'",
        ),
        ({"effects": [{"name": "bump", "height_m": [1, 2]}]}, "one for each of the 1 rollouts, got shape"),
        (
            {"effects": [{"name": "bump", "width_m": 0.0}]},
            "width_m of bump of rollout 0: expected a number from",
        ),
        ({"effects": [{"name": "lag", "time_constant_s": np.nan}]}, "time_constant_s of lag of rollout 0"),
        ({"first": 10}, "first: expected rows from 0 to 9, got 10 to 10"),
        ({"first": 0.5}, "first: expected a row"),
        ({"first": 4, "rows": 7}, "commands of rollout 0: expected at least 11 rows, got 10"),
        ({"issued": [11]}, "issued: expected 1 to 10 commands, got 11 to 11"),
        ({"issued": 10}, "issued: expected 1 whole numbers"),
        ({"rows": 0}, "rows: expected a whole number of at least 1"),
        ({"seed": -1}, "seed: expected a whole number of at least 0"),
        ({"seed": [0.5]}, "seed: expected a whole number, or one for each"),
        ({"seed": 1.5}, "seed: expected a whole number"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(change, message):
    arguments = {"parameters": PAPER, "commands": np.zeros((10, 2))} | change
    with pytest.raises(IrtError, match=message) as refused:
        rollouts(arguments.pop("parameters"), arguments.pop("commands"), **arguments)
    assert "\n" not in str(refused.value)


def test_effects_act_at_the_values_of_their_rollout():
    bias = {"name": "tilt_bias", "bias_y_rad": [0.0, 0.004, -0.004]}
    seen = rollouts(np.repeat(PAPER, 3, axis=0), np.zeros((20, 2)), effects=[bias])
    assert (seen[0] == 0).all()
    assert seen[1, -1, 0] > 0
    assert (seen[2] == -seen[1]).all()


@pytest.mark.parametrize("engine", ["rolling", "rapier"])
def test_a_marble_let_go_later_sees_what_the_knobs_did_before(engine):
    drive, lag = paper_drive(40), [{"name": "lag", "time_constant_s": 0.4}]
    seen = rollouts(PAPER, drive, effects=lag, first=12, engine=engine)
    assert seen.shape == (1, 28, 2)
    alone = rollouts(PAPER, drive[12:], effects=lag, engine=engine)
    assert np.abs(seen - alone).max() > 1e-3
    settled = rollouts(PAPER, drive[12:], effects=lag, knobs_before=drive[12], engine=engine)
    assert np.abs(seen - settled).max() < np.abs(seen - alone).max()


def test_windows_of_one_batch_may_begin_anywhere():
    drive, lag = paper_drive(40), [{"name": "lag", "time_constant_s": 0.4}]
    together = rollouts(np.repeat(PAPER, 3, axis=0), drive, effects=lag, first=[0, 7, 20], rows=15)
    for seen, first in zip(together, (0, 7, 20), strict=True):
        assert (rollouts(PAPER, drive, effects=lag, first=first, rows=15)[0] == seen).all()


def test_what_fills_shorter_commands_up_does_not_count():
    drive, drift = paper_drive(40), [{"name": "clock_drift", "drift": 0.2}]
    padded = np.stack([drive, np.where(np.arange(40)[:, None] < 25, drive, 0.1)])
    together = rollouts(np.repeat(PAPER, 2, axis=0), padded, effects=drift, issued=[40, 25], rows=20)
    assert (together[0] == rollouts(PAPER, drive, effects=drift, rows=20)[0]).all()
    assert (together[1] == rollouts(PAPER, drive[:25], effects=drift, rows=20)[0]).all()


def test_the_catalogue_has_of_each_effect_what_a_report_needs():
    catalogue = {effect.name: effect for effect in effects()}
    bump = catalogue["bump"]
    assert bump.stage == "board"
    height = next(parameter for parameter in bump.parameters if parameter.name == "height_m")
    assert (height.unit, height.neutral) == ("m", 0.0)
    assert height.least <= height.low < height.neutral < height.high <= height.most
    for effect in catalogue.values():
        assert effect.does in effect.doc
        assert effect.references


def test_optional_parameters_come_last_and_are_neutral_by_themselves():
    info = catalogue.effect("second_order_lag")
    assert [one.name for one in info.required] == ["time_constant_s", "damping_ratio"]
    assert info.used({"y_minus_x_s"}) == info.parameters
    for one in effects():
        assert one.required == one.parameters[: len(one.required)]
        assert all(parameter.optional for parameter in one.parameters[len(one.required) :])


def test_the_diagnosis_tries_some_effects_and_a_fit_goes_beyond_the_range_of_some():
    tried = {one.name for one in catalogue.hypothetical()}
    assert tried < {one.name for one in effects()}
    assert "tilt_bias" in tried
    assert not tried & {"second_order_lag", "gear_matrix", "slope_map", "lean", "tilt_sensor"}
    assert {one.name for one in effects() if one.shrunk} == {"slope_map", "lean"}
    bias = catalogue.effect("tilt_bias").parameters[0]
    assert bias.reach == (-0.06, 0.06)
    for one in effects():
        for parameter in one.parameters:
            assert parameter.reach[0] <= parameter.low <= parameter.high <= parameter.reach[1]


def test_what_the_catalogue_does_not_list_simulates_like_any_effect():
    learned = catalogue.effect("unlisted")
    assert not learned.listed
    assert learned.name not in {one.name for one in effects()}
    neutral, pushed = (
        rollouts(PAPER, paper_drive(20), effects=[{"name": learned.name, "push_1_x_m_per_s2": push}])
        for push in (0.0, 0.1)
    )
    assert (neutral == rollouts(PAPER, paper_drive(20))).all()
    assert (pushed[0, 10:, 0] > neutral[0, 10:, 0]).all()


def test_other_threads_run_during_a_batch():
    beats = []
    running = threading.Event()

    def beat():
        while not running.is_set():
            beats.append(time.perf_counter())
            time.sleep(0.001)

    other = threading.Thread(target=beat)
    other.start()
    started = time.perf_counter()
    rollouts(np.repeat(PAPER, 20_000, axis=0), paper_drive(), threads=1)
    ended = time.perf_counter()
    running.set()
    other.join()
    during = [beat for beat in beats if started < beat < ended]
    assert len(during) > 3


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_ctrl_c_stops_a_long_batch():
    code = (
        "import numpy as np; from irt.engine import *; print('ready', flush=True);"
        "rollouts(np.tile([0.05, 0.05, 0.0, 5000.0, 1.0], (3000, 1)), paper_drive(1000), threads=1)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        time.sleep(0.5)
        child.send_signal(signal.SIGINT)
        try:
            _, errors = child.communicate(timeout=120)
        finally:
            child.kill()
    assert "KeyboardInterrupt" in errors


def test_tilt_comes_beside_the_same_positions():
    commands = paper_drive(30)
    options = {"effects": [{"name": "latency", "latency_s": 0.1}], "knobs_before": [0.02, -0.01]}
    alone = rollouts(np.repeat(PAPER, 2, axis=0), commands, **options)
    positions, tilts = rollouts(np.repeat(PAPER, 2, axis=0), commands, tilt=True, **options)
    assert (positions == alone).all()
    before = np.concatenate([[[0.02, -0.01]], commands[:-1]])
    assert tilts == pytest.approx(np.array([before * PAPER[0, :2]] * 2), abs=1e-15)


def test_first_order_hold_arrives_at_each_command_with_its_row():
    commands = paper_drive(30)
    held, _ = rollouts(PAPER, commands, tilt=True)
    ramped, tilts = rollouts(PAPER, commands, tilt=True, hold="first")
    assert tilts[0, 1:] == pytest.approx(commands[1:] * PAPER[0, :2], abs=1e-15)
    assert not np.array_equal(held, ramped)


def test_unknown_hold_is_refused():
    with pytest.raises(IrtError, match='unknown hold "second"'):
        rollouts(PAPER, paper_drive(5), hold="second")
