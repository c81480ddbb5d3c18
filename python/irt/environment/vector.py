"""Labyrinths as a vector environment: marbles are stepped by the engine, all together."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from irt import _labsim, arguments
from irt.catalogue import parameter_values
from irt.engine import Array
from irt.environment.drawing import PER_M, board
from irt.environment.task import AHEAD, Reward, Task
from irt.errors import IrtError
from irt.files import PathLike
from irt.maze import Maze
from irt.model import Model, as_model
from irt.rig import PARAMETERS, RANGES, Board, Marble
from irt.values import Parameter

#: Steps of an episode unless something else is asked for: half a minute at 100 Hz.
MAX_EPISODE_STEPS = 3000
#: Models that are drawn from a posterior.
DRAWS = 256
#: Tilt of 1 in an observation [rad]: ten degrees, as the CyberRunner has it.
TILT_UNIT_RAD = float(np.radians(10.0))
#: What depends on how a recording was stamped and not on the rig: an environment has one clock.
_OF_RECORDINGS = frozenset({"clock_drift"})
#: Columns of the engine's states.
_SEEN, _BEFORE, _TILT, _PLACE = (slice(begin, begin + 2) for begin in range(0, 8, 2))
_HOLE, _PASSED, _COLUMNS = 8, 9, 10
#: Numbers in a flat observation before the path ahead.
_OWN = 8
#: Largest number of an observation.
FARTHEST = 5.0
#: Pixels of a picture along each edge.
CUT = 64

Observation = NDArray[np.float32] | dict[str, NDArray[Any]]


class LabyrinthVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Marbles that follow a path through a maze, each in a simulator drawn from a model's posterior.

    Marble i of a reset with seed s is the only one of `LabyrinthEnv` with seed s + i.

    Actions are the commands about x and about y over the largest one, from -1 to 1.

    Observations are ``"states"``, 18 numbers a marble, ``"dict"`` or ``"pictures"``. The states: tilt about x
    and y [10 degrees], the marble's place [long edges from the centre], by how much that changed in the last
    step, the last action, and where five points of the path ahead lie from the marble [long edges]. The
    dictionary is that of the CyberRunner: ``states`` (tilts [10 degrees], place over the edges from the lower
    left), ``goal`` (the five points [long edges]), ``progress`` (share of the path). With pictures it has
    ``image`` as well, (64, 64, 3) uint8, a millimetre a pixel around the marble. Numbers are clipped to -5
    and 5.

    Infos are arrays with masks: ``progress`` in each step; ``hole`` of those that fell, ``success`` of
    those whose episode is over.

    Parameters
    ----------
    num_envs : int
        How many marbles.
    model : Model or path, optional
        What was tuned or diagnosed; the paper's labyrinth with its middle parameters by default.
    maze : Maze or str, optional
        A maze or the name of a layout; by default the model's own, or the bare board.
    randomise : bool
        Draw a simulator from the model's posterior for each episode (`irt.Model.sample`). A model without
        one is played as it is.
    observation : {"states", "dict", "pictures"}
        See above.
    noise : float
        Standard deviation of the tracker [board edges].
    lost : float
        Share of steps in which the tracker loses the marble: what was seen last is seen again.
    step_s : float
        Length of a step [s].
    tilt_limit_rad : float or (2,)
        Tilt of the board at the largest command, by the model's gears [rad]: about both axes, or about each.
    random_start : bool
        Begin anywhere along the path, and not at its start.
    reward : Reward, optional
        What is paid for what.
    max_episode_steps : int
        Steps after which an episode is cut off.
    autoreset_mode : AutoresetMode or str
        As Gymnasium has them: NextStep, SameStep or Disabled.
    threads : int, optional
        Of the engine; the same seed gives the same bits for any number.

    Raises
    ------
    IrtError
        If an argument is not as it must be, or the model or the maze cannot be simulated.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        model: Model | PathLike | None = None,
        *,
        maze: Maze | str | None = None,
        randomise: bool = True,
        observation: Literal["states", "dict", "pictures"] = "states",
        noise: float = 0.001,
        lost: float = 0.0,
        step_s: float = 0.01,
        tilt_limit_rad: float | Sequence[float] = 0.07,
        random_start: bool = False,
        reward: Reward | None = None,
        max_episode_steps: int = MAX_EPISODE_STEPS,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
    ) -> None:
        self.num_envs = arguments.whole("num_envs", num_envs, 1)
        arguments.whole("max_episode_steps", max_episode_steps, 1)
        arguments.word("observation", observation, ("states", "dict", "pictures"))
        for name, flag in (("randomise", randomise), ("random_start", random_start)):
            arguments.flag(name, flag)
        arguments.threads(threads)
        _within("step_s", step_s, 1e-4, 1.0)
        limits = (
            (tilt_limit_rad,) * 2
            if isinstance(tilt_limit_rad, int | float)
            else arguments.pair("tilt_limit_rad", tilt_limit_rad)
        )
        tilts = np.array([_within("tilt_limit_rad", one, 1e-6, 1.0) for one in limits])
        self._mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        found = default_model() if model is None else as_model(model)
        self.model = found
        self.task = Task.of(maze if maze is not None else found.maze or "bare")
        self.task.maze.check(found.board, found.marble)
        self._reward = Reward() if reward is None else reward
        arguments.instance("reward", self._reward, Reward)
        self._edges = np.array([found.board.edge_x_m, found.board.edge_y_m])
        gears = np.abs(found.values[:2])
        if not gears.all():
            raise IrtError("model: a gear is 0, so that no command tilts the board")
        self._largest = tilts / gears
        self._flat = observation == "states"
        self._scene = None if observation != "pictures" else np.round(self.board).astype(np.uint8)
        self._random_start, self._limit, self._threads = random_start, max_episode_steps, threads
        bare = self.task.maze.is_bare
        self._fleet = _labsim.Fleet(
            num_envs,
            max_episode_steps + 1,
            step_s,
            astuple(found.board),
            astuple(found.marble),
            None if bare else self.task.maze.arrays(),
            self.task.points,
            _within("noise", noise, 0.0, 1.0),
            _within("lost", lost, 0.0, 0.999),
        )
        self._simulators = _add(self._fleet, found, randomise=randomise)
        self._spaces()
        self._state = np.full((num_envs, _COLUMNS), np.nan)
        self._action = np.zeros((num_envs, 2))
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.ones(num_envs, dtype=bool)
        self._seeds, self._episodes = np.zeros((2, num_envs), dtype=np.uint64)
        self._is_seeded = False

    @functools.cached_property
    def board(self) -> Array:
        """The board without a marble from above, (h, w, 3) from 0 to 255, a pixel a millimetre."""
        return board(self.task, self.model)

    @property
    def places(self) -> Array:
        """Where the marbles are [m from the board's centre], (num_envs, 2), as no tracker sees them."""
        return self._state[:, _PLACE]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin episodes: of all marbles, or of those of ``options["reset_mask"]``, (num_envs,) bool.

        A seed, one for the first marble or one for each, makes these episodes and those after them the same
        every time.
        """
        mask = np.ones(self.num_envs, dtype=bool)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise IrtError(
                    f"reset_mask: expected {self.num_envs} truth values, one of them true, got "
                    f"{arguments.shown(mask)}"
                )
        self._seed(seed, mask)
        self._begin(mask)
        return self._observed(), self._info()

    def step(
        self, actions: Any
    ) -> tuple[Observation, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Play a step of all marbles.

        Returns
        -------
        observations, rewards (n,), terminations (n,), truncations (n,), infos
        """
        action = self._checked(actions)
        if not self._is_seeded:
            raise IrtError("step: no episode has begun; reset the environment first")
        plays = ~self._over
        if self._mode is AutoresetMode.DISABLED and not plays.all():
            raise IrtError(
                f"step: the episode of marble {int(np.flatnonzero(self._over)[0])} is over; reset it first "
                '(options={"reset_mask": ...})'
            )
        begins = self._over.copy()
        before = self._state[:, _PASSED].copy()
        self._fleet.play(action * self._largest, plays, self._state, self._threads)
        self._steps += plays
        self._action = np.where(plays[:, None], action, 0.0)
        if begins.any():
            self._begin(begins)
        passed = self._state[:, _PASSED].astype(np.int64)
        fell = plays & (self._state[:, _HOLE] >= 0.0)
        arrived = plays & ~fell & self.task.arrived(passed)
        terminations = fell | arrived
        truncations = plays & ~terminations & (self._steps >= self._limit)
        paid = self._reward
        gained = (self._state[:, _PASSED] - before) / (len(self.task.points) - 1)
        rewards = np.where(plays, paid.time + paid.progress * gained, 0.0)
        rewards += paid.hole * fell + paid.goal * arrived
        self._over = terminations | truncations
        infos = self._info(fell, arrived)
        if self._mode is AutoresetMode.SAME_STEP and self._over.any():
            infos |= self._final(infos)
            self._begin(self._over.copy())
        return self._observed(), rewards, terminations, truncations, infos

    def _seed(self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_]) -> None:
        """Give marbles the seeds of their episodes: those asked for, or of the system's entropy."""
        if seed is None and self._is_seeded:
            return
        given: Sequence[int | None] = [None] * self.num_envs if seed is None else []
        if isinstance(seed, int | np.integer):
            given = range(arguments.whole("seed", seed), seed + self.num_envs)
        elif seed is not None:
            given = list(seed)
        if len(given) != self.num_envs:
            raise IrtError(f"seed: expected one, or {self.num_envs}, got {len(given)}")
        chance = np.random.default_rng().integers(0, 2**63, self.num_envs, dtype=np.uint64)
        for marble in np.flatnonzero(mask):
            one = given[int(marble)]
            if one is not None or not self._is_seeded:
                self._seeds[marble] = chance[marble] if one is None else np.uint64(one)
                self._episodes[marble] = 0
        self._is_seeded = self._is_seeded or bool(mask.all())

    def _begin(self, mask: NDArray[np.bool_]) -> None:
        """Begin episodes of some marbles."""
        marbles = np.flatnonzero(mask)
        own = mixed(mixed(self._seeds[marbles]) + self._episodes[marbles])
        self._episodes[marbles] += np.uint64(1)
        passed = np.zeros(len(marbles), dtype=np.uintp)
        places = np.tile(self.task.start, (len(marbles), 1))
        if self._random_start:
            passed = (mixed(own + np.uint64(1)) % np.uint64(len(self.task.points) - 1)).astype(np.uintp)
            places = self.task.points[passed]
        simulators = (mixed(own + np.uint64(2)) % np.uint64(self._simulators)).astype(np.uintp)
        self._fleet.begin(marbles.astype(np.uintp), simulators, places, passed, mixed(own))
        self._fleet.states(self._state)
        self._steps[mask], self._over[mask], self._action[mask] = 0, False, 0.0

    def _observed(self) -> Observation:
        """Return what a learner sees of all marbles."""
        tilt = self._state[:, _TILT] / TILT_UNIT_RAD
        seen = self._state[:, _SEEN]
        ahead = self.task.ahead(self._state[:, _PASSED].astype(np.int64)) / self._edges[0]
        goal = (ahead - seen[:, None]).reshape(self.num_envs, 2 * AHEAD)
        if self._flat:
            parts = [tilt, seen, seen - self._state[:, _BEFORE], self._action, goal]
            return _clipped(np.concatenate(parts, axis=1))
        corner = seen * (self._edges[0] / self._edges) + 0.5
        found: dict[str, NDArray[Any]] = {
            "states": _clipped(np.concatenate([tilt, corner], axis=1)),
            "goal": _clipped(goal),
            "progress": self._progress()[:, None].astype(np.float32),
        }
        if self._scene is not None:
            pictures = np.empty((self.num_envs, CUT, CUT, 3), dtype=np.uint8)
            radius = self.model.marble.radius_m
            self._fleet.pictures(self._scene, PER_M, radius, pictures, self._threads)
            found["image"] = pictures
        return found

    def _progress(self) -> Array:
        return self.task.share(self._state[:, _PASSED].astype(np.int64))

    def _info(
        self, fell: NDArray[np.bool_] | None = None, arrived: NDArray[np.bool_] | None = None
    ) -> dict[str, Any]:
        """Return what is known besides, each entry with a mask of whom it is of."""
        everyone = np.ones(self.num_envs, dtype=bool)
        infos: dict[str, Any] = {"progress": self._progress(), "_progress": everyone}
        if fell is not None and arrived is not None:
            infos |= {"hole": self._state[:, _HOLE].astype(np.int64), "_hole": fell}
            infos |= {"success": arrived, "_success": self._over.copy()}
        return infos

    def _final(self, infos: Mapping[str, Any]) -> dict[str, Any]:
        """Return the last observations and infos of the episodes that are over."""
        last, over = self._observed(), self._over.copy()
        final = np.full(self.num_envs, None, dtype=object)
        for index in np.flatnonzero(over):
            final[index] = (
                last[index]
                if isinstance(last, np.ndarray)
                else {key: one[index] for key, one in last.items()}
            )
        return {
            "final_obs": final,
            "_final_obs": over,
            "final_info": {key: np.array(one) for key, one in infos.items()},
            "_final_info": over,
        }

    def _checked(self, actions: Any) -> Array:
        found = arguments.array("actions", actions)
        if found.shape != (self.num_envs, 2):
            raise IrtError(f"actions: expected shape ({self.num_envs}, 2), got {found.shape}")
        if not np.isfinite(found).all():
            marble = int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])
            raise IrtError(f"actions: marble {marble} has one that is no number")
        return np.clip(found, -1.0, 1.0)

    def _spaces(self) -> None:
        def box(size: int) -> spaces.Box:
            return spaces.Box(-FARTHEST, FARTHEST, (size,), np.float32)

        self.single_action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        progress = spaces.Box(0.0, 1.0, (1,), np.float32)
        by_name = {"states": box(4), "goal": box(2 * AHEAD), "progress": progress}
        if self._scene is not None:
            by_name["image"] = spaces.Box(0, 255, (CUT, CUT, 3), np.uint8)
        self.single_observation_space = box(_OWN + 2 * AHEAD) if self._flat else spaces.Dict(by_name)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, self.num_envs)
        self.observation_space = gymnasium.vector.utils.batch_space(
            self.single_observation_space, self.num_envs
        )


def mixed(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return numbers mixed, so that neighbours have nothing in common (SplitMix64, Steele et al. 2014)."""
    mixing = numbers + np.uint64(0x9E3779B97F4A7C15)
    mixing = (mixing ^ (mixing >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixing = (mixing ^ (mixing >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixing ^ (mixing >> np.uint64(31)))


def default_model() -> Model:
    """Return the paper's labyrinth with the middle of each range of its parameters."""
    middle = {name: Parameter(float(np.mean(RANGES[name]))) for name in PARAMETERS}
    return Model(Board(), Marble(), "rest", dict(RANGES), middle)


def _add(fleet: _labsim.Fleet, model: Model, *, randomise: bool) -> int:
    """Give a fleet the simulators of its episodes; return how many."""
    models = model.sample(DRAWS) if randomise and model.posterior else [model]
    for one in models:
        effects = [
            {"name": effect.name, **effect.parameters}
            for effect in one.effects
            if effect.name not in _OF_RECORDINGS
        ]
        values = [(name, found.ravel().tolist()) for name, found in parameter_values(effects, 1)]
        fleet.add(astuple(one.board), astuple(one.marble), one.values.tolist(), values)
    return len(models)


def _clipped(numbers: Array) -> NDArray[np.float32]:
    return np.clip(numbers, -FARTHEST, FARTHEST).astype(np.float32)


def _within(name: str, value: float, low: float, high: float) -> float:
    if not low <= arguments.number(name, value) <= high:
        raise IrtError(f"{name}: expected a number from {low:g} to {high:g}, got {value:g}")
    return float(value)


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        names = ", ".join(one.value for one in AutoresetMode)
        raise IrtError(f"autoreset_mode: expected one of {names}, got {arguments.shown(mode)}") from None
