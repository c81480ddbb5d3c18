"""Policies learned by `examples/ppo.py` in fitted models, for the rigs of `transfer.py`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

import irt
from irt.engine import SUBSTEP_S
from irt.environment import Reward, Task
from irt.posterior import SPINNING, Component, Spread
from irt.values import Parameter

sys.path.append(str(Path(__file__).resolve().parents[1] / "examples"))
from mpc import passed
from ppo import Args, Policy, labyrinths, train

Array = NDArray[np.float64]

#: How a policy is trained; a command answers the picture of the row before.
ARGS = Args(steps=1_000_000, late=1)
#: Rows of an episode, and what is paid.
ROWS, REWARD = 400, Reward(time=-0.01)


def mixture(models: Sequence[irt.Model]) -> irt.Model:
    """Return the first model with a posterior in which each of the models is as probable."""
    components = tuple(
        Component(
            1.0 / len(models),
            tuple(effect.name for effect in one.effects),
            {
                **{name: Spread(found.value) for name, found in one.parameters.items()},
                SPINNING: Spread(one.board.spinning_friction),
                **{
                    f"{effect.name}.{name}": Spread(value)
                    for effect in one.effects
                    for name, value in effect.parameters.items()
                },
            },
        )
        for one in models
    )
    return replace(models[0], posterior=components if len(models) > 1 else ())


def learned(model: irt.Model, maze: irt.Maze, largest: Array, row_s: float, noise: float) -> Policy:
    """Return a policy for rows of so many seconds and commands up to the largest (2,) [rad]."""
    torch.set_num_threads(1)
    # A row of the environment lasts as long as the model's.
    model = replace(
        model,
        parameters={**model.parameters, "time_scale": Parameter(row_s / SUBSTEP_S)},
    )
    tilts = largest * np.abs(model.values[:2])
    envs = labyrinths(
        model,
        maze,
        ARGS.marbles,
        tilts,
        random_start=True,
        max_episode_steps=ROWS,
        reward=REWARD,
        noise=noise,
    )
    return train(envs, ARGS, lambda _: None)


class Driver:
    """Commands of a policy for n marbles, by where they are seen."""

    def __init__(self, policy: Policy, task: Task, edge_m: float, largest: Array, marbles: int) -> None:
        self._policy, self._task, self._edge_m, self._largest = policy, task, edge_m, largest
        self._passed = np.zeros(marbles, dtype=np.int64)
        #: Commands over the largest: that of the last row, and that which is on its way.
        self._played, self._sent = np.zeros((2, marbles, 2))
        self._seen: Array | None = None
        self._rows: Array | None = None

    def act(self, seen: Array) -> Array:
        """Return the next command of each marble (n, 2) [rad], by where it is seen (n, 2) [board edges]."""
        before = seen if self._seen is None else self._seen
        seen = np.where(np.isfinite(seen), seen, before)
        self._passed = passed(self._task.points, self._edge_m * seen, self._passed)
        goal = (self._task.ahead(self._passed) / self._edge_m - seen[:, None]).reshape(len(seen), -1)
        row = np.concatenate([seen, seen - before, self._played, goal], axis=1)[:, None]
        rows = row.repeat(ARGS.stack, axis=1) if self._rows is None else self._rows
        self._rows, self._seen = np.concatenate([rows[:, 1:], row], axis=1), seen
        self._played = self._sent
        self._sent = self._policy.act(self._rows.reshape(len(seen), -1).astype(np.float32))
        return self._sent * self._largest
