"""Lead a marble through a labyrinth by model-predictive control: thousands of rollouts for each command.

    pip install "labsim-irt[gym]"
    python examples/mpc.py --model diagnosed/model.toml --maze cyberrunner-easy

The controller has one model or several, the commands it gave and the pictures it saw. In each row it

1. estimates the marble's state some rows ago: that from which the model, under the commands given since,
   comes nearest to what was seen;
2. rolls out hundreds of command sequences from there. They begin with the commands that are still on their
   way, so that delay, lag, backlash and a camera's latency are accounted for as far as the model has them;
3. moves its plan towards the sequences that lead furthest along the path, without leaving it or falling, by
   the weights of model predictive path integral control (Williams et al. 2017), and gives the plan's first
   command.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import irt
from irt.cli.__main__ import report_errors
from irt.cli.inputs import whole
from irt.engine import SUBSTEP_S

if __name__ == "__main__":
    report_errors("mpc.py")

from irt.environment import LabyrinthEnv, Task
from irt.environment.vector import default_model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Config:
    """How plans are made."""

    #: Rows of a plan, plans compared in a round, and rounds for each command.
    horizon: int = 24
    plans: int = 256
    rounds: int = 2
    #: Rows over which the change of a plan is constant, and its standard deviation in the first round, of the
    #: largest command; each round after has half of it.
    piece: int = 4
    spread: float = 0.5
    #: Plans worse by this much than the best have 1/e of its weight [mm of progress].
    temperature_mm: float = 3.0
    #: Distance from the path that costs as many millimetres of progress; the cost is quadratic.
    beside_mm: float = 1.5
    #: Distance that plans keep from the rims of holes [m].
    margin_m: float = 0.003
    #: Rows over which the state is estimated, and rows of commands before them, for what drives remember.
    window: int = 6
    memory: int = 24


#: Cost of a fall at once [mm].
FALL_MM = 500.0
#: How far back and ahead along the path a marble is looked for [points], and how near to it it must be [m].
BACK, AHEAD, NEAR_M = 30, 160, 0.02
#: Plans are compared at every third point of the path, and in every second row.
EVERY_POINT, EVERY_ROW = 3, 2


class Controller:
    """Commands for n marbles, each on a rig of its own, planned with the same models.

    Parameters
    ----------
    models : sequence of Model
        Plans are scored by their mean over these.
    task : Task
        Maze and path.
    largest : (2,) array
        The largest commands [rad, or the rig's unit].
    row_s : float
        Length of a row [s].
    marbles : int
        How many.
    late : int
        Rows between a picture and the command that is its answer: 0 if it is issued at once.
    seed : int
        Of the plans.
    """

    def __init__(
        self,
        models: Sequence[irt.Model],
        task: Task,
        largest: Array,
        row_s: float,
        *,
        marbles: int = 1,
        late: int = 0,
        seed: int = 0,
        config: Config | None = None,
    ) -> None:
        self.config = Config() if config is None else config
        self._models = [replace(model, maze=task.maze, posterior=()) for model in models]
        self._task, self._largest, self._row_s, self._late = task, largest, row_s, late
        self._random = np.random.default_rng(seed)
        self._commands = np.zeros((marbles, self.config.memory + self.config.window + late, 2))
        self._seen = np.zeros((marbles, 0, 2))
        self._plans = np.zeros((marbles, self.config.horizon, 2))
        self.passed = np.zeros(marbles, dtype=np.int64)

    def act(self, seen: Array) -> Array:
        """Return the next command of each marble (n, 2), by where it is seen (n, 2) [board edges]."""
        window = self.config.window
        if not self._seen.shape[1]:
            self._seen = seen[:, None].repeat(window + 1, axis=1)
        # A marble that the tracker loses is held where it was.
        seen = np.where(np.isfinite(seen), seen, self._seen[:, -1])
        self._seen = np.concatenate([self._seen[:, 1:], seen[:, None]], axis=1)
        states = [self._estimated(model) for model in self._models]
        self.passed = passed(self._task.points, _metres(self._models[0], seen), self.passed)
        self._plans = np.concatenate([self._plans[:, 1:], self._plans[:, -1:]], axis=1)
        spread = self.config.spread * self._largest
        for _ in range(self.config.rounds):
            self._improve(states, spread)
            spread = spread / 2.0
        command = self._plans[:, 0]
        self._commands = np.concatenate([self._commands[:, 1:], command[:, None]], axis=1)
        return np.array(command)

    def _estimated(self, model: irt.Model) -> tuple[Array, Array]:
        """Return places (n, 2) [edges] and velocities (n, 2) [edges/s] of a window ago."""
        config = self.config
        moments = self._row_s * np.arange(config.window + 1)
        line = np.linalg.pinv(np.stack([np.ones_like(moments), moments], axis=1))
        place = self._seen[:, 0]
        speed = (self._seen[:, -1] - self._seen[:, 0]) / moments[-1]
        # The last command known acts in the present row or later, and a row more is not predicted.
        commands = self._commands[:, : config.memory + config.window]
        commands = np.concatenate([commands, commands[:, -1:]], axis=1)
        # Two corrections, the second for what walls and friction make of the first.
        for _ in range(2):
            error = self._seen - self._rolled(model, commands, place, speed)
            error = np.where(np.isfinite(error), error, 0.0)
            shift, drift = np.moveaxis(line @ error, 1, 0)
            place, speed = place + shift, speed + drift
        return place, speed

    def _improve(self, states: Sequence[tuple[Array, Array]], spread: Array) -> None:
        """Move the plans to the best of those around them."""
        config = self.config
        runs, count = len(self._plans), config.plans
        pieces = -(-config.horizon // config.piece) + 1
        noise = spread * self._random.normal(size=(runs, count, pieces, 2))
        begin = int(self._random.integers(config.piece))
        noise = noise.repeat(config.piece, axis=2)[:, :, begin : begin + config.horizon]
        noise[:, 0] = 0.0
        tried = np.clip(self._plans[:, None] + noise, -self._largest, self._largest)
        before = self._commands[:, None].repeat(count, axis=1)
        commands = np.concatenate([before, tried], axis=2).reshape(runs * count, -1, 2)
        score = np.zeros((runs, count))
        for model, (place, speed) in zip(self._models, states, strict=True):
            paths = self._rolled(model, commands, place.repeat(count, 0), speed.repeat(count, 0))
            places = _metres(model, paths[:, config.window + self._late + 1 :])
            for run, one in enumerate(places.reshape(runs, count, -1, 2)):
                score[run] += self._score(one, int(self.passed[run])) / len(self._models)
        weights = np.exp((score - score.max(axis=1, keepdims=True)) / config.temperature_mm)
        weights /= weights.sum(axis=1, keepdims=True)
        self._plans = np.einsum("np,nprc->nrc", weights, tried)

    def _score(self, places: Array, at: int) -> Array:
        """Return scores [mm] of planned places (plans, rows, 2) [m] from a point of the path on."""
        maze = self._task.maze
        some = self._task.points[max(0, at - BACK) : at + AHEAD : EVERY_POINT]
        lost = np.isnan(places[..., 0])
        if maze.holes:
            away = np.sqrt(_squares(places, np.array(maze.holes)).min(axis=-1))
            lost = np.maximum.accumulate(lost | (away < maze.hole_radius_m + self.config.margin_m), axis=1)
        known = np.where(lost[..., None], self._task.points[at], places)
        square = 1e6 * _squares(known[:, ::-EVERY_ROW], some)
        along, beside = EVERY_POINT * square.argmin(axis=-1), square.min(axis=-1)
        # Progress counts at the end, and half as much on the way: a plan that waits first may never begin.
        gained = along[:, 0] + 0.5 * along.mean(axis=1)
        found = gained - beside.mean(axis=1) / self.config.beside_mm - FALL_MM * lost.mean(axis=1)
        return np.asarray(found)

    def _rolled(self, model: irt.Model, commands: Array, place: Array, speed: Array) -> Array:
        """Return observed positions (n, rows, 2) [board edges], the first where the memory ends."""
        return irt.rollouts(
            model,
            commands,
            start=place,
            start_velocity=speed,
            first=self.config.memory,
            knobs_before=(0.0, 0.0),
            durations=np.full(commands.shape[1], self._row_s),
        )


def passed(points: Array, places: Array, before: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the points (n,) that marbles at places (n, 2) [m] have come to; off the path, those before."""
    found = before.copy()
    for marble, place in enumerate(places):
        first = max(0, int(before[marble]) - BACK)
        distance = np.linalg.norm(points[first : before[marble] + AHEAD] - place, axis=1)
        if distance.min() < NEAR_M:
            found[marble] = first + int(distance.argmin())
    return found


def _metres(model: irt.Model, seen: Array) -> Array:
    """Return places [m] of those seen by a camera [board edges]."""
    return seen * (model.board.edge_x_m / model.parameters["observation_scale"].value)


def _squares(places: Array, points: Array) -> NDArray[np.float32]:
    """Return the squared distances (..., points) [m²] of places (..., 2) from points (p, 2)."""
    places, points = places.astype(np.float32), points.astype(np.float32)
    x, y = (places[..., axis, None] - points[:, axis] for axis in (0, 1))
    return np.asarray(x * x + y * y)


def main() -> None:
    """Lead a marble along a path in a model's own world, and say how far it came."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--model", help="model.toml; by default the paper's labyrinth")
    parser.add_argument("--maze", default="bare", help="name of a layout")
    parser.add_argument("--tilt", type=float, default=0.02, help="largest tilt [rad]")
    parser.add_argument("--rows", type=whole(1), default=600, help="rows until the controller gives up")
    parser.add_argument("--draws", type=whole(1), default=1, help="models that plans are scored by")
    parser.add_argument("--seed", type=whole(0), default=0)
    args = parser.parse_args()
    model = default_model() if args.model is None else irt.load_model(args.model)
    row_s = model.parameters["time_scale"].value * SUBSTEP_S
    options = {"step_s": row_s, "tilt_limit_rad": args.tilt, "max_episode_steps": args.rows}
    env = LabyrinthEnv(model, maze=args.maze, randomise=False, **options)
    largest = args.tilt / np.abs(model.values[:2])
    models = [model] if args.draws == 1 else model.sample(args.draws, args.seed)
    controller = Controller(models, Task.of(args.maze), largest, row_s, seed=args.seed)
    observed: Any = env.reset(seed=args.seed)[0]
    for row in range(1, args.rows + 1):
        command = controller.act(observed[None, 2:4].astype(float))[0]
        observed, _, terminated, truncated, infos = env.step(command / largest)
        if row % 50 == 0:
            print(f"{row * row_s:5.1f} s: {infos['progress']:4.0%} of the path", flush=True)
        if terminated or truncated:
            break
    ended = "arrived" if infos["success"] else "fell" if "hole" in infos else "gave up"
    print(f"{ended} after {row * row_s:.1f} s, {infos['progress']:.0%} of the path")


if __name__ == "__main__":
    main()
