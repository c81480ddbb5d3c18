"""Gymnasium's own checks, and that each place of many is the single environment."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="gymnasium is an optional package: labsim-irt[gym]")

import gymnasium
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import irt.environment
from irt.errors import IrtError
from irt.model import Effect, Model, Parameter, save_model
from irt.posterior import Component, Spread
from irt.rig import PARAMETERS, RANGES, Board, Marble

PLAIN = Model(
    board=Board(),
    marble=Marble(),
    start="rest",
    ranges=dict(RANGES),
    parameters={
        name: Parameter(value) for name, value in zip(PARAMETERS, (0.08, 0.07, 3e-4, 12.0, 1.0), strict=True)
    },
    effects=(Effect("delay", {"delay_s": 0.1}),),
)
WIDTH = Spread(0.02, 0.0, 1.0, (0.005,), (0.0,))
MODEL = replace(
    PLAIN,
    posterior=(
        Component(0.6, ("delay",), {"gear_x": Spread(0.08, 0.0, 0.2, (0.01,), (0.0,))}),
        Component(0.4, ("backlash",), {"backlash.width_x_rad": WIDTH}),
    ),
)


def vector(count: int = 4, **options):
    return gymnasium.make_vec(irt.environment.ID, num_envs=count, model=MODEL, **options)


def test_gymnasium_finds_nothing_wrong() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(irt.environment.ID, model=MODEL, noise=0.001)
        check_env(env.unwrapped, skip_render_check=True)


def test_a_model_file_will_do(tmp_path) -> None:
    save_model(tmp_path / "model.toml", MODEL)
    seen, _ = gymnasium.make(irt.environment.ID, model=tmp_path / "model.toml").reset(seed=1)
    assert seen.shape == (8,)


@pytest.mark.parametrize("threads", [1, 2])
def test_place_i_of_many_is_the_single_one_of_seed_plus_i(threads: int) -> None:
    options = {"noise": 0.002, "lost": 0.2, "episode_rows": 25}
    many = vector(3, threads=threads, **options)
    singles = [gymnasium.make(irt.environment.ID, model=MODEL, **options) for _ in range(3)]
    seen, _ = many.reset(seed=7)
    alone = [one.reset(seed=7 + i)[0] for i, one in enumerate(singles)]
    np.testing.assert_array_equal(seen, alone)
    random = np.random.default_rng(0)
    ended = [False] * 3
    for _ in range(40):
        actions = random.uniform(-0.1, 0.1, (3, 2)).astype(np.float32)
        seen, reward, arrived, truncated, infos = many.step(actions)
        for i, one in enumerate(singles):
            if ended[i]:
                expected, ended[i] = one.reset()[0], False
                assert (reward[i], arrived[i], truncated[i]) == (0.0, False, False)
            else:
                expected, gain, *over, info = one.step(actions[i])
                assert (reward[i], arrived[i], truncated[i]) == (gain, *over)
                assert infos["distance"][i] == info["distance"]
                ended[i] = any(over)
            np.testing.assert_array_equal(seen[i], expected)


def test_each_episode_draws_its_simulator() -> None:
    """One command, one start: marbles of other simulators go elsewhere."""
    env = gymnasium.make(irt.environment.ID, model=MODEL)
    plain = gymnasium.make(irt.environment.ID, model=MODEL, randomise=False)

    def moved(one, seed: int) -> float:
        one.reset(seed=seed)
        return float(np.linalg.norm([one.step(np.array([0.05, 0.0]))[0][3] for _ in range(8)]))

    assert len({round(moved(plain, seed), 6) for seed in range(6)}) == 1
    assert len({round(moved(env, seed), 6) for seed in range(6)}) > 2


def test_a_marble_that_comes_near_is_rewarded_and_arrives() -> None:
    """A proportional-derivative controller brings the marble home."""
    env = gymnasium.make(irt.environment.ID, model=PLAIN, goal_radius=0.05)
    successes = 0
    for seed in range(3):
        seen, info = env.reset(seed=seed)
        total, over = 0.0, False
        before = info["distance"]
        while not over:
            pull = 0.25 * (seen[6:] - seen[:2]) - 0.25 * seen[2:4]
            seen, reward, arrived, truncated, info = env.step(np.clip([-pull[1], pull[0]], -0.1, 0.1))
            total, over = total + reward, arrived or truncated
        successes += arrived
        assert total == pytest.approx(before - info["distance"] + arrived)
        assert info["is_success"] == arrived
    assert successes == 3


def test_the_same_step_begins_anew_and_keeps_how_it_ended() -> None:
    many = vector(2, episode_rows=3, autoreset_mode=AutoresetMode.SAME_STEP)
    assert many.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    many.reset(seed=0)
    still = np.zeros((2, 2))
    for _ in range(2):
        _, _, _, truncated, infos = many.step(still)
        assert not truncated.any()
        assert "final_obs" not in infos
    seen, _, _, truncated, infos = many.step(still)
    assert truncated.all()
    assert infos["_final_obs"].all()
    assert not np.array_equal(infos["final_obs"][0], seen[0])
    assert infos["final_info"]["_distance"].all()


def test_without_autoreset_the_caller_resets() -> None:
    many = vector(2, episode_rows=1, autoreset_mode="Disabled")
    many.reset(seed=0)
    many.step(np.zeros((2, 2)))
    with pytest.raises(IrtError, match="episodes 0, 1 have ended"):
        many.step(np.zeros((2, 2)))
    _, infos = many.reset(options={"reset_mask": np.array([True, False])})
    assert infos["_distance"].tolist() == [True, False]
    with pytest.raises(IrtError, match="episodes 1 have ended"):
        many.step(np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "none.toml"}, "none.toml: no such file"),
        ({"model": 3}, "model: expected irt.Model"),
        ({"episode_rows": 0}, "episode_rows"),
        ({"lost": 1.0}, "lost: expected a probability below 1"),
        ({"noise": -1.0}, "noise: expected at least 0"),
        ({"knob_limit": float("nan")}, "knob_limit"),
        ({"row_s": 0.0}, "row_s"),
        ({"randomise": 1}, "randomise"),
        ({"model": PLAIN, "randomise": True}, "no posterior"),
        ({"rows": 3}, "unexpected keyword argument 'rows'"),
        ({"autoreset_mode": "later"}, "autoreset_mode: expected NextStep"),
    ],
)
def test_wrong_options_are_one_line(options, message: str) -> None:
    with pytest.raises(IrtError, match=message):
        irt.environment.LabyrinthVectorEnv(2, **{"model": MODEL, **options})


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0], r"expected shape \(2,\), got \(1,\)"),
        ([np.nan, 0.0], "expected finite numbers"),
        ("left", "expected numbers of shape"),
    ],
)
def test_wrong_actions_are_one_line(action, message: str) -> None:
    env = irt.environment.LabyrinthEnv(MODEL)
    env.reset(seed=0)
    with pytest.raises(IrtError, match=message):
        env.step(action)


def test_clocks_that_drift_are_refused() -> None:
    drifting = replace(PLAIN, effects=(Effect("clock_drift", {"drift": 0.1}),))
    env = irt.environment.LabyrinthEnv(drifting)
    with pytest.raises(IrtError, match="clock_drift"):
        env.reset(seed=0)
