"""Gymnasium's own checks; each marble of many is the single environment; mazes decide how episodes end."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="gymnasium is an optional package: labsim-irt[gym]")

import gymnasium
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import irt.environment
from irt.environment import ENV_ID, LabyrinthEnv, LabyrinthVectorEnv, Reward
from irt.errors import IrtError
from irt.maze import Maze
from irt.model import Effect, Model, Parameter, save_model
from irt.posterior import Component, Spread
from irt.rig import PARAMETERS, RANGES, Board, Marble

VALUES = (0.08, 0.07, 3e-4, 12.0, 1.0)
PLAIN = Model(
    board=Board(),
    marble=Marble(),
    start="rest",
    ranges=dict(RANGES),
    parameters={name: Parameter(value) for name, value in zip(PARAMETERS, VALUES, strict=True)},
    effects=(Effect("delay", {"delay_s": 0.1}),),
)
MODEL = replace(
    PLAIN,
    posterior=(
        Component(0.6, ("delay",), {"gear_x": Spread(0.08, 0.0, 0.2, (0.01,), (0.0,))}),
        Component(0.4, ("backlash",), {"backlash.width_x_rad": Spread(0.02, 0.0, 1.0, (0.005,), (0.0,))}),
    ),
)
STILL = np.zeros((2, 2))


def many(count=4, **options):
    return gymnasium.make_vec(ENV_ID, num_envs=count, model=MODEL, **options)


def alone(**options):
    return gymnasium.make(ENV_ID, model=MODEL, **options)


@pytest.mark.parametrize("observation", ["states", "dict", pytest.param("pictures", marks=pytest.mark.slow)])
def test_gymnasium_finds_nothing_wrong(observation):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = alone(observation=observation, render_mode="rgb_array", lost=0.1, maze="cyberrunner-easy")
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("observation", ["states", "dict", "pictures"])
def test_observations_of_many_lie_in_their_space(observation):
    envs = many(3, observation=observation, maze="cyberrunner-easy")
    seen, _ = envs.reset(seed=3)
    assert seen in envs.observation_space
    for _ in range(8):
        seen, *_ = envs.step(envs.action_space.sample())
        assert seen in envs.observation_space


def test_a_model_file_will_do(tmp_path):
    save_model(tmp_path / "model.toml", MODEL)
    seen, _ = gymnasium.make(ENV_ID, model=tmp_path / "model.toml").reset(seed=1)
    assert seen.shape == (18,)


@pytest.mark.parametrize("threads", [1, 2])
def test_marble_i_of_many_is_the_single_one_of_seed_plus_i(threads):
    options = {"noise": 0.002, "lost": 0.2, "max_episode_steps": 25, "random_start": True}
    envs = many(3, threads=threads, **options)
    singles = [alone(**options) for _ in range(3)]
    seen, _ = envs.reset(seed=7)
    np.testing.assert_array_equal(seen, [one.reset(seed=7 + i)[0] for i, one in enumerate(singles)])
    random = np.random.default_rng(0)
    ended = [False] * 3
    for _ in range(60):
        actions = random.uniform(-1.0, 1.0, (3, 2)).astype(np.float32)
        seen, reward, terminated, truncated, infos = envs.step(actions)
        for i, one in enumerate(singles):
            if ended[i]:
                expected, ended[i] = one.reset()[0], False
                assert (reward[i], terminated[i], truncated[i]) == (0.0, False, False)
            else:
                expected, gain, *over, info = one.step(actions[i])
                assert (reward[i], terminated[i], truncated[i]) == (gain, *over)
                assert infos["progress"][i] == info["progress"]
                ended[i] = any(over)
            np.testing.assert_array_equal(seen[i], expected)


def test_each_episode_draws_its_simulator():
    """One command, one start: marbles of other simulators go elsewhere."""

    def tilts(envs):
        envs.reset(seed=1)
        for _ in range(40):
            seen, *_ = envs.step(np.full((12, 2), 0.7))
        return {round(float(tilt), 5) for tilt in seen[:, 0]}

    assert len(tilts(many(12))) > 4
    assert len(tilts(many(12, randomise=False))) == 1


def follow(seen):
    """Return what brings a marble to the first point of the path ahead: proportional and derivative."""
    goal, speed = seen[..., 8:10], seen[..., 4:6]
    pull = 6.0 * goal - 120.0 * speed
    return np.clip(np.stack([-pull[..., 1], pull[..., 0]], axis=-1), -1.0, 1.0)


def test_whoever_follows_the_path_arrives_and_is_paid():
    envs = LabyrinthVectorEnv(4, PLAIN, noise=0.0, autoreset_mode="Disabled")
    seen, _ = envs.reset(seed=0)
    total = np.zeros(4)
    for _ in range(3000):
        seen, reward, terminated, truncated, infos = envs.step(follow(seen))
        total += reward
        if terminated.any():
            break
    assert terminated.all()
    assert not truncated.any()
    assert infos["success"].all()
    assert infos["_success"].all()
    assert (infos["hole"] == -1).all()
    assert (infos["progress"] > 0.97).all()
    assert (total > 12.0).all()


def test_a_hole_ends_the_episode_and_costs():
    maze = Maze(holes=((0.03, 0.0),), start=(0.0, 0.0), path=((0.0, 0.0), (0.0, 0.05)))
    env = LabyrinthEnv(PLAIN, maze=maze, noise=0.0, reward=Reward(0.0, -3.0, 0.0, 0.0))
    env.reset(seed=0)
    for _ in range(400):
        _, reward, terminated, _, info = env.step(np.array([0.0, 1.0]))
        if terminated:
            break
    assert terminated
    assert reward == -3.0
    assert info["hole"] == 0
    assert info["success"] is False


def test_a_marble_lost_to_the_tracker_stays_where_it_was_seen():
    envs = LabyrinthVectorEnv(64, PLAIN, noise=0.0, lost=0.5, autoreset_mode="Disabled")
    envs.reset(seed=0)
    for _ in range(30):
        seen, *_ = envs.step(np.full((64, 2), 1.0))
    stands = (seen[:, 4:6] == 0.0).all(axis=1)
    assert 0.2 < stands.mean() < 0.8


def test_the_same_step_begins_anew_and_keeps_how_it_ended():
    envs = many(2, max_episode_steps=3, autoreset_mode=AutoresetMode.SAME_STEP)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    envs.reset(seed=0)
    for _ in range(2):
        _, _, _, truncated, infos = envs.step(STILL)
        assert not truncated.any()
        assert "final_obs" not in infos
    seen, _, _, truncated, infos = envs.step(STILL)
    assert truncated.all()
    assert infos["_final_obs"].all()
    assert infos["final_obs"][0].shape == seen[0].shape
    assert not np.array_equal(infos["final_obs"][0], seen[0])
    assert infos["final_info"]["_progress"].all()
    _, _, _, truncated, _ = envs.step(STILL)
    assert not truncated.any()


def test_without_autoreset_the_caller_resets():
    envs = many(2, max_episode_steps=1, autoreset_mode="Disabled")
    with pytest.raises(IrtError, match="reset the environment first"):
        envs.step(STILL)
    envs.reset(seed=0)
    envs.step(STILL)
    with pytest.raises(IrtError, match="marble 0 is over"):
        envs.step(STILL)
    envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(IrtError, match="marble 1 is over"):
        envs.step(STILL)


@pytest.mark.slow
def test_pictures_show_the_marble_in_its_middle():
    env = LabyrinthEnv(PLAIN, observation="pictures", render_mode="rgb_array", noise=0.0)
    seen, _ = env.reset(seed=0)
    image, whole = seen["image"], env.render()
    steel = image[32, 32].astype(int)
    assert abs(steel - [190, 196, 204]).max() < 3
    assert abs(image[32, 50].astype(int) - steel).max() > 10
    assert whole.shape == (231, 276, 3)
    x, y = env.unwrapped.place
    pixel = whole[round(231 / 2 - 1000 * y), round(276 / 2 + 1000 * x)].astype(int)
    assert abs(pixel - steel).max() < 3


def test_the_largest_tilts_of_the_axes_may_differ():
    envs = LabyrinthVectorEnv(1, replace(PLAIN, effects=()), tilt_limit_rad=(0.02, 0.05))
    envs.reset(seed=0)
    seen, *_ = envs.step([[-1.0, 1.0]])
    assert seen[0, :2] == pytest.approx(np.degrees([-0.02, 0.05]) / 10.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "none.toml"}, "none.toml: no such file"),
        ({"model": 3}, "model: expected irt.Model"),
        ({"maze": "cyberrunner"}, "cyberrunner"),
        ({"maze": Maze()}, "maze: it has no path to follow"),
        ({"maze": Maze(walls=((0.0, 0.0, 0.2, 0.0),), path=((0.0, 0.1), (0.1, 0.1)))}, "leaves the board"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"lost": 1.0}, "lost: expected a number from 0 to 0.999"),
        ({"noise": -1.0}, "noise: expected a number from 0"),
        ({"tilt_limit_rad": float("nan")}, "tilt_limit_rad"),
        ({"tilt_limit_rad": (0.05, -0.05)}, "tilt_limit_rad: expected a number from 1e-06"),
        ({"tilt_limit_rad": (0.05, 0.05, 0.05)}, "tilt_limit_rad: expected two numbers"),
        ({"step_s": 0.0}, "step_s"),
        ({"randomise": 1}, "randomise"),
        ({"observation": "pixels"}, "unknown observation"),
        ({"reward": 3.0}, "reward: expected"),
        ({"autoreset_mode": "later"}, "autoreset_mode: expected one of NextStep"),
        ({"num_envs": 0}, "num_envs"),
    ],
)
def test_wrong_options_are_one_line(options, message):
    with pytest.raises(IrtError, match=message) as refused:
        LabyrinthVectorEnv(**{"num_envs": 2, "model": MODEL, **options})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0], r"^action: expected shape \(2,\), got \(1,\)$"),
        (0.0, r"^action: expected shape \(2,\), got \(\)$"),
        ([[0.0, 0.0]], r"^action: expected shape \(2,\), got \(1, 2\)$"),
        ([[0.0], [0.0, 0.0]], "^action must be an array of numbers"),
        ([np.nan, 0.0], "no number"),
        (["left", "right"], "^action must be an array of numbers"),
    ],
)
def test_wrong_actions_are_one_line(action, message):
    env = LabyrinthEnv(MODEL)
    env.reset(seed=0)
    with pytest.raises(IrtError, match=message):
        env.step(action)


def test_lerobot_gets_its_form():
    found = irt.environment.make_env(n_envs=3)
    assert found["labyrinth"][0].num_envs == 3
