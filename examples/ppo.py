"""Learn to lead a marble through a labyrinth, by proximal policy optimisation (Schulman et al. 2017).

    pip install "labsim-irt[gym,train]"
    python examples/ppo.py --model diagnosed/model.toml --out policy.pt

Each episode is played in a simulator drawn from the model's posterior. The policy sees what a rig without a
tilt sensor has: where the tracker sees the marble, the last commands, and the path ahead. It sees several
rows of these, because commands that are on their way, and play in the linkage, do not show in one.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import irt
from irt.cli.__main__ import report_errors
from irt.cli.inputs import whole
from irt.engine import SUBSTEP_S
from irt.extras import require
from irt.files import make_folder

if __name__ == "__main__":
    report_errors("ppo.py")

require("gymnasium", "ppo.py")
require("torch", "ppo.py")

import gymnasium
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn

from irt.environment import ENV_ID, Reward
from irt.environment.vector import default_model

#: Numbers of an observation at its beginning that are left out: the tilts.
TILTS = 2


@dataclass(frozen=True)
class Args:
    """What is learned, and how.

    Attributes
    ----------
    steps : int
        Environment steps of the whole training.
    marbles, rows : int
        Marbles that play side by side, and rows that each plays between two updates.
    epochs, batches : int
        Passes over these rows, and parts that a pass is divided into.
    rate : float
        Learning rate of Adam; it falls to 0 along the training.
    discount, trace : float
        By row; of the rewards, and of generalised advantage estimation.
    clip : float
        How far the probability ratio may depart from 1.
    stack : int
        Rows that the policy sees.
    late : int
        Rows between a picture and the command that is its answer.
    """

    steps: int = 4_000_000
    marbles: int = 256
    rows: int = 64
    epochs: int = 4
    batches: int = 8
    rate: float = 1e-3
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    stack: int = 6
    late: int = 0
    seed: int = 0


class Policy(nn.Module):
    """A Gaussian over commands and a value, each of a network with two layers."""

    mean: Tensor
    square: Tensor
    count: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("square", torch.ones(size))
        self.register_buffer("count", torch.tensor(1e-4))
        self.actor, self.critic = (_network(size, outputs, scale) for outputs, scale in ((2, 0.01), (1, 1.0)))
        self.spread = nn.Parameter(torch.full((2,), -0.5))

    def scaled(self, seen: Tensor) -> Tensor:
        """Return observations with about the same spread."""
        deviation = (self.square - self.mean**2).clamp(min=1e-6).sqrt()
        return ((seen - self.mean) / deviation).clamp(-10.0, 10.0)

    def learn_scale(self, seen: Tensor) -> None:
        """Add observations (n, size) to the mean and the mean square."""
        self.count += len(seen)
        self.mean += (seen.mean(0) - self.mean) * len(seen) / self.count
        self.square += ((seen**2).mean(0) - self.square) * len(seen) / self.count

    def forward(self, seen: Tensor) -> tuple[torch.distributions.Normal, Tensor]:
        """Return the distribution of commands (n, 2) over the largest, and the value (n,)."""
        scaled = self.scaled(seen)
        normal = torch.distributions.Normal(self.actor(scaled), self.spread.exp())
        return normal, self.critic(scaled)[:, 0]

    @torch.no_grad()
    def act(self, seen: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the best commands (n, 2) over the largest."""
        best: Tensor = self(torch.from_numpy(seen))[0].mean
        return np.asarray(best.clamp(-1.0, 1.0).double().numpy())


def _network(size: int, outputs: int, scale: float) -> nn.Sequential:
    linear = [nn.Linear(*sizes) for sizes in ((size, 64), (64, 64), (64, outputs))]
    for layer, gain in zip(linear, (2**0.5, 2**0.5, scale), strict=True):
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(linear[0], nn.Tanh(), linear[1], nn.Tanh(), linear[2])


class Stacked:
    """What a policy sees: the last rows of marbles, and commands that come late.

    Parameters
    ----------
    envs : VectorEnv
        Labyrinths with states, in which episodes begin in the step in which others end.
    """

    def __init__(self, envs: Any, stack: int, late: int) -> None:
        self.envs, self._stack = envs, stack
        self._pending = [np.zeros((envs.num_envs, 2)) for _ in range(late)]

    def reset(self, seed: int) -> NDArray[np.float32]:
        """Begin all episodes."""
        observed, _ = self.envs.reset(seed=seed)
        self._rows = observed[:, None, TILTS:].repeat(self._stack, axis=1)
        return self._seen(self._rows)

    def step(self, actions: NDArray[np.float64]) -> tuple[Any, ...]:
        """Return what is seen, rewards, ends, what is seen of those that were cut off last, and infos."""
        self._pending.append(actions)
        observed, rewards, terminated, truncated, infos = self.envs.step(self._pending.pop(0))
        over = terminated | truncated
        rows = np.concatenate([self._rows[:, 1:], observed[:, None, TILTS:]], axis=1)
        cut = np.zeros((int(truncated.sum()), rows[0].size), dtype=np.float32)
        if truncated.any():
            final = np.stack(list(infos["final_obs"][truncated]))[:, None, TILTS:]
            cut = self._seen(np.concatenate([self._rows[truncated, 1:], final], axis=1))
        rows[over] = observed[over, None, TILTS:]
        for one in self._pending:
            one[over] = 0.0
        self._rows = rows
        return self._seen(rows), rewards, terminated, truncated, cut, infos

    @staticmethod
    def _seen(rows: NDArray[np.float32]) -> NDArray[np.float32]:
        return rows.reshape(len(rows), -1)


def labyrinths(model: irt.Model, maze: str | irt.Maze, marbles: int, tilt: Any, **options: Any) -> Any:
    """Return labyrinths whose rows last as long as the model's; `tilt` is the largest [rad]."""
    return gymnasium.make_vec(
        ENV_ID,
        num_envs=marbles,
        model=model,
        maze=maze,
        step_s=model.parameters["time_scale"].value * SUBSTEP_S,
        tilt_limit_rad=tilt,
        autoreset_mode=AutoresetMode.SAME_STEP,
        **options,
    )


def train(envs: Any, args: Args, report: Any = print) -> Policy:
    """Return the policy that was learned in these labyrinths."""
    torch.manual_seed(args.seed)
    world = Stacked(envs, args.stack, args.late)
    seen = torch.from_numpy(world.reset(args.seed))
    policy = Policy(seen.shape[1])
    optimiser = torch.optim.Adam(policy.parameters(), lr=args.rate, eps=1e-5)
    updates = max(1, args.steps // (args.rows * args.marbles))
    began = time.perf_counter()
    for update in range(updates):
        optimiser.param_groups[0]["lr"] = args.rate * (1.0 - update / updates)
        saw = torch.empty(args.rows, *seen.shape)
        did = torch.empty(args.rows, args.marbles, 2)
        chance, value, reward, over = torch.empty(4, args.rows, args.marbles)
        ended: list[float] = []
        for row in range(args.rows):
            with torch.no_grad():
                normal, value[row] = policy(seen)
                did[row] = normal.sample()
                chance[row] = normal.log_prob(did[row]).sum(1)
            saw[row] = seen
            found, paid, terminated, truncated, cut, infos = world.step(
                did[row].clamp(-1.0, 1.0).double().numpy()
            )
            seen, reward[row] = torch.from_numpy(found), torch.from_numpy(paid).float()
            if truncated.any():
                # An episode that was only cut off is worth what would have followed.
                with torch.no_grad():
                    reward[row, torch.from_numpy(truncated)] += (
                        args.discount * policy(torch.from_numpy(cut))[1]
                    )
            over[row] = torch.from_numpy(terminated | truncated).float()
            if "final_info" in infos:
                ended += infos["final_info"]["success"][infos["_final_info"]].tolist()
        with torch.no_grad():
            policy.learn_scale(saw.flatten(0, 1))
            gained = advantages(reward, value, policy(seen)[1], over, args)
        improve(policy, optimiser, args, saw, did, chance, gained, gained + value)
        if update % 20 == 19 or update == updates - 1:
            share = f"{np.mean(ended):4.0%} of {len(ended)} episodes arrived" if ended else "no episode ended"
            steps = (update + 1) * args.rows * args.marbles
            report(f"{steps:>9,} steps, {time.perf_counter() - began:4.0f} s: {share}")
    return policy


def advantages(reward: Tensor, value: Tensor, after: Tensor, over: Tensor, args: Args) -> Tensor:
    """Return generalised advantage estimates (rows, marbles)."""
    found, gained = torch.empty_like(reward), torch.zeros_like(after)
    for row in reversed(range(len(reward))):
        goes_on = 1.0 - over[row]
        error = reward[row] + args.discount * after * goes_on - value[row]
        gained = error + args.discount * args.trace * goes_on * gained
        found[row], after = gained, value[row]
    return found


def improve(
    policy: Policy,
    optimiser: torch.optim.Optimizer,
    args: Args,
    *played: Tensor,
) -> None:
    """Take the steps of an update: rows seen, commands, log probabilities, advantages and returns."""
    saw, did, chance, gained, returned = (one.flatten(0, 1) for one in played)
    for _ in range(args.epochs):
        for part in torch.randperm(len(saw)).chunk(args.batches):
            normal, value = policy(saw[part])
            ratio = (normal.log_prob(did[part]).sum(1) - chance[part]).exp()
            gain = (gained[part] - gained[part].mean()) / (gained[part].std() + 1e-8)
            clipped = ratio.clamp(1.0 - args.clip, 1.0 + args.clip)
            loss = (
                -torch.min(ratio * gain, clipped * gain).mean() + 0.5 * ((value - returned[part]) ** 2).mean()
            )
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
            optimiser.step()


def trial(policy: Policy, envs: Any, args: Args, rows: int) -> tuple[float, float]:
    """Return the share of marbles that arrive in their first episode, and after how many rows on average."""
    world = Stacked(envs, args.stack, args.late)
    seen = world.reset(args.seed + 1_000_000)
    arrived, over = np.zeros(envs.num_envs), np.zeros(envs.num_envs, dtype=bool)
    for row in range(1, rows + 1):
        seen, _, terminated, truncated, _, infos = world.step(policy.act(seen))
        ends = (terminated | truncated) & ~over
        if ends.any():
            arrived[ends] = np.where(infos["final_info"]["success"][ends], row, 0)
        over |= ends
    return float((arrived > 0).mean()), float(arrived[arrived > 0].mean()) if arrived.any() else np.nan


def main() -> None:
    """Train a policy, try it, and keep it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--model", help="model.toml; by default the paper's labyrinth")
    parser.add_argument("--maze", default="bare", help="name of a layout")
    parser.add_argument("--tilt", type=float, default=0.02, help="largest tilt [rad]")
    parser.add_argument("--steps", type=whole(1), default=Args.steps)
    parser.add_argument("--rows", type=whole(1), default=400, help="rows of an episode")
    parser.add_argument("--seed", type=whole(0), default=0)
    parser.add_argument("--out", type=Path, help="file of the policy")
    given = parser.parse_args()
    args = Args(steps=given.steps, seed=given.seed)
    model = default_model() if given.model is None else irt.load_model(given.model)
    if given.out is not None:
        # Before the training, which would be lost.
        make_folder(given.out.parent)
    options = {"max_episode_steps": given.rows, "reward": Reward(time=-0.01)}
    envs = labyrinths(model, given.maze, args.marbles, given.tilt, random_start=True, **options)
    policy = train(envs, args)
    share, rows = trial(policy, labyrinths(model, given.maze, 256, given.tilt, **options), args, given.rows)
    row_s = model.parameters["time_scale"].value * SUBSTEP_S
    when = f", after {rows * row_s:.1f} s" if share else ""
    print(f"from the start {share:.0%} of 256 marbles arrive{when}")
    if given.out is not None:
        torch.save({"policy": policy.state_dict(), "args": vars(args)}, given.out)


if __name__ == "__main__":
    main()
