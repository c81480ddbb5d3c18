"""The model-predictive controller: it arrives in its own world, and a delay that it knows costs it little."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import irt

pytest.importorskip("gymnasium")

import mpc
from irt.environment import LabyrinthVectorEnv, Task
from irt.environment.vector import default_model

ROW_S = 0.06
TILT = 0.02
QUICK = mpc.Config(horizon=16, plans=48)


def bend(*corners):
    return irt.Maze(path=corners, start=corners[0])


def led(model, world, maze, rows=80, marbles=2):
    """Return the rows until the last marble arrived, and the mean distance from the path [m]."""
    options = {"step_s": ROW_S, "tilt_limit_rad": TILT, "noise": 0.0}
    envs = LabyrinthVectorEnv(marbles, world, maze=maze, max_episode_steps=rows, **options)
    task = Task.of(maze)
    largest = TILT / np.abs(world.values[:2])
    controller = mpc.Controller([model], task, largest, ROW_S, marbles=marbles, config=QUICK)
    seen, _ = envs.reset(seed=0)
    arrived, beside = np.zeros(marbles, dtype=bool), []
    for _ in range(rows):
        places = envs.places.copy()
        beside.append(np.linalg.norm(task.points - places[:, None], axis=2).min(axis=1).mean())
        seen, _, terminated, truncated, _ = envs.step(controller.act(seen[:, 2:4].astype(float)) / largest)
        arrived |= terminated
        if arrived.all() or truncated.any():
            break
    return len(beside) if arrived.all() else np.inf, float(np.mean(beside))


def test_it_arrives_at_a_near_goal_in_its_own_world():
    rows, beside = led(default_model(), default_model(), bend((-0.05, 0.0), (0.05, 0.0)))
    # With the largest tilt all the way it would take 1.2 s.
    assert 1.2 / ROW_S < rows < 2.5 / ROW_S
    assert beside < 0.002


def test_a_delay_that_the_model_knows_beats_one_that_it_does_not_know():
    maze = bend((-0.06, 0.05), (0.06, 0.05), (0.06, -0.06))
    late = replace(default_model(), effects=(irt.Effect("delay", {"delay_s": 0.3}),))
    known, unknown = (led(model, late, maze) for model in (late, default_model()))
    assert known[0] < unknown[0]
    assert known[1] < 0.5 * unknown[1]


def test_plans_keep_off_a_hole_beside_the_path():
    maze = irt.Maze(holes=((0.0, -0.012),), path=((-0.05, 0.0), (0.05, 0.0)), start=(-0.05, 0.0))
    controller = mpc.Controller([default_model()], Task.of(maze), np.ones(2), ROW_S)
    rows = np.linspace(-0.05, 0.05, 12)
    straight = np.stack([rows, np.full(12, 0.0)], axis=1)
    astray = np.stack([rows, np.full(12, -0.004)], axis=1)
    fallen = np.where(np.arange(12)[:, None] > 6, np.nan, straight)
    good, worse, worst = controller._score(np.stack([straight, astray, fallen]), 0)
    assert good > worse
    assert good > worst + 100.0


def test_progress_stays_where_a_marble_left_the_path():
    points = Task.of(bend((-0.05, 0.0), (0.05, 0.0))).points
    at = mpc.passed(points, np.array([[0.0, 0.01], [0.0, 0.03]]), np.array([20, 20]))
    assert at.tolist() == [50, 20]


def test_the_example_says_how_far_it_came(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["mpc.py", "--rows", "4"])
    mpc.main()
    assert capsys.readouterr().out.startswith("gave up after 0.4 s, ")
