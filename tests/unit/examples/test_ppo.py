"""Proximal policy optimisation: its arithmetic, what a policy sees, and that it learns a short path."""

import sys

import numpy as np
import pytest

import irt

pytest.importorskip("gymnasium")
torch = pytest.importorskip("torch")

import ppo  # noqa: E402
from irt.environment.vector import default_model  # noqa: E402

SHORT = irt.Maze(path=((-0.04, 0.0), (0.04, 0.0)), start=(-0.04, 0.0))


class Recorded:
    """Two marbles that see how often they were stepped; the second one is cut off in its third row."""

    num_envs = 2

    def __init__(self):
        self.actions = []

    def seen(self, number):
        return np.full((2, ppo.TILTS + 1), number, dtype=np.float32)

    def reset(self, seed):
        return self.seen(0), {}

    def step(self, actions):
        self.actions.append(np.array(actions))
        number, cut = len(self.actions), np.array([False, len(self.actions) == 3])
        seen, final = self.seen(number), np.full(2, None, dtype=object)
        if cut.any():
            final[1] = seen[1].copy()
            seen[1] = 100.0
        return seen, np.zeros(2), np.zeros(2, dtype=bool), cut, {"final_obs": final}


def test_a_policy_sees_the_last_rows_of_its_own_episode():
    world = ppo.Stacked(Recorded(), stack=3, late=0)
    assert world.reset(0).tolist() == [[0, 0, 0]] * 2
    for _ in range(2):
        world.step(np.zeros((2, 2)))
    seen, *_, truncated, cut, _ = world.step(np.zeros((2, 2)))
    assert truncated.tolist() == [False, True]
    assert seen.tolist() == [[1, 2, 3], [100, 100, 100]]
    assert cut.tolist() == [[1, 2, 3]]


def test_late_commands_come_rows_later_and_not_in_the_next_episode():
    envs = Recorded()
    world = ppo.Stacked(envs, stack=1, late=2)
    world.reset(0)
    for row in range(1, 6):
        world.step(np.full((2, 2), float(row)))
    assert [one[0, 0] for one in envs.actions] == [0, 0, 1, 2, 3]
    # What was on its way when the second marble was cut off is lost.
    assert [one[1, 0] for one in envs.actions] == [0, 0, 1, 0, 0]


def test_advantages_are_discounted_sums_of_errors_within_an_episode():
    args = ppo.Args(discount=0.9, trace=0.8)
    reward, value = torch.rand(2, 6, 3, generator=torch.Generator().manual_seed(0))
    after, over = torch.ones(3), torch.zeros(6, 3)
    over[2, 1] = 1.0
    found = ppo.advantages(reward, value, after, over, args)
    follows = torch.cat([value[1:], after[None]])
    error = reward + 0.9 * follows * (1.0 - over) - value
    expected = sum((0.9 * 0.8) ** k * error[k] for k in range(6))
    assert torch.allclose(found[0, [0, 2]], expected[[0, 2]])
    assert torch.allclose(found[0, 1], error[0, 1] + 0.72 * error[1, 1] + 0.72**2 * error[2, 1])


@pytest.mark.slow
def test_a_policy_learns_a_short_path():
    args = ppo.Args(steps=24_600, marbles=64, rows=32, rate=2e-3)
    options = {"max_episode_steps": 60, "noise": 0.0}
    envs = ppo.labyrinths(default_model(), SHORT, 64, 0.02, **options)
    before, _ = ppo.trial(ppo.Policy(args.stack * (18 - ppo.TILTS)), envs, args, 60)
    said = []
    policy = ppo.train(envs, args, said.append)
    after, rows = ppo.trial(policy, envs, args, 60)
    assert before == 0.0
    assert after > 0.9
    assert rows < 40
    assert said[-1].endswith("episodes arrived")


def test_the_example_keeps_its_policy(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(
        sys, "argv", ["ppo.py", "--steps", "1", "--rows", "3", "--out", f"{tmp_path}/policy.pt"]
    )
    ppo.main()
    assert capsys.readouterr().out.endswith("from the start 0% of 256 marbles arrive\n")
    kept = torch.load(tmp_path / "policy.pt")
    assert kept["policy"]["spread"].shape == (2,)
    assert kept["args"]["steps"] == 1
