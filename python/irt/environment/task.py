"""The task of the bare board: bring the marble to a place, on a simulator drawn for each episode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt import arguments
from irt.engine import SUBSTEP_S
from irt.errors import IrtError
from irt.files import PathLike
from irt.fleet import Fleet
from irt.model import Model, as_model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: What an observation holds, in this order.
OBSERVED = ("x", "y", "velocity_x", "velocity_y", "tilt_x", "tilt_y", "goal_x", "goal_y")
#: Starts and goals lie within this share of the board that the marble reaches.
WITHIN = 0.8
#: Largest velocity [board edges per second] and tilt [rad] of an observation: beyond, they are clipped.
FASTEST, STEEPEST = 20.0, 1.0


@dataclass(frozen=True)
class Settings:
    """What a task is asked with.

    Attributes
    ----------
    model : Model or path
        The simulator: a model, or a ``model.toml``.
    episode_rows : int
        Rows after which an episode is truncated.
    row_s : float, optional
        How long a command holds [s]; by default as long as a row of the model's recordings.
    knob_limit : float
        The largest command [rad of a knob, or the rig's own unit].
    goal_radius : float
        A marble nearer than this to the goal has arrived [board edges].
    noise : float
        Standard deviation of the tracker [board edges].
    lost : float
        Probability that the tracker does not see the marble in a row: it stays where it was seen last.
    randomise : bool, optional
        Whether each episode draws its simulator from the model's posterior; by default where it has one.
    threads : int, optional
        Of the engine; by default one for each core.

    Raises
    ------
    IrtError
        If a value is not as it must be.
    """

    model: Model | PathLike
    episode_rows: int = 600
    row_s: float | None = None
    knob_limit: float = 0.1
    goal_radius: float = 0.03
    noise: float = 0.0
    lost: float = 0.0
    randomise: bool | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        arguments.whole("episode_rows", self.episode_rows, 1)
        model = as_model(self.model)
        object.__setattr__(self, "model", model)
        row_s = model.parameters["time_scale"].value * SUBSTEP_S if self.row_s is None else self.row_s
        object.__setattr__(self, "row_s", arguments.number("row_s", row_s))
        for name, least in (
            ("row_s", SUBSTEP_S),
            ("knob_limit", 1e-9),
            ("goal_radius", 1e-9),
            ("noise", 0.0),
        ):
            value = arguments.number(name, getattr(self, name))
            if not least <= value < np.inf:
                raise IrtError(f"{name}: expected at least {least:g}, got {value:g}")
        if not 0.0 <= arguments.number("lost", self.lost) < 1.0:
            raise IrtError(f"lost: expected a probability below 1, got {self.lost:g}")
        randomise = bool(model.posterior) if self.randomise is None else self.randomise
        object.__setattr__(self, "randomise", arguments.flag("randomise", randomise))
        if self.randomise:
            model.sample(1)


class Task:
    """Episodes in some places, each with a random generator of its own.

    A place has the same episodes beside any others: place i of many seeded with s + i is the one place
    of a task seeded with that.

    Parameters
    ----------
    count : int
        How many places.
    settings : Settings
        What is asked.
    """

    def __init__(self, count: int, settings: Settings) -> None:
        assert isinstance(settings.model, Model)
        assert settings.row_s is not None
        self._settings, self._model, self._row_s = settings, settings.model, settings.row_s
        self._fleet = Fleet(count, settings.threads)
        self._random = [np.random.default_rng() for _ in range(count)]
        self._goal, self._seen, self._before = (np.zeros((count, 2)) for _ in range(3))
        self._distance = np.zeros(count)
        self._left = np.zeros(count, dtype=np.int64)

    def seed(self, place: int, seed: int | None) -> None:
        """Give a place a generator: of a seed, or of the system's entropy."""
        self._random[place] = np.random.default_rng(seed)

    def begin(self, asked: Mask) -> None:
        """Begin episodes in the places (count,) that are asked to."""
        places = np.flatnonzero(asked)
        for place in places:
            random = self._random[place]
            model = self._model
            if self._settings.randomise:
                (model,) = model.sample(1, int(random.integers(2**63)))
            room = WITHIN * model.reach
            start, goal = random.uniform(-room, room, (2, 2))
            self._goal[place] = goal
            self._fleet.begin(
                int(place),
                model,
                start=start,
                rows=self._settings.episode_rows,
                row_s=self._row_s,
                seed=int(random.integers(2**63)),
            )
            self._left[place] = self._settings.episode_rows
        places_seen, _ = self._fleet.rows
        self._seen[places] = places_seen[places]
        self._track(places, places_seen, first=True)
        self._before[places] = self._seen[places]
        self._distance[places] = self._off(places_seen)[places]

    def play(self, actions: Array, asked: Mask) -> tuple[Array, Mask, Mask]:
        """Play a row of the places that are asked to.

        Returns
        -------
        reward : (count,) array
            By how much the marble came nearer to the goal [board edges], and 1 where it has arrived.
        arrived, truncated : (count,) bool arrays
            Whether it is within the goal's radius, and whether the episode's rows are over before that.
        """
        limit = self._settings.knob_limit
        self._fleet.play(np.clip(actions, -limit, limit), asked)
        places = np.flatnonzero(asked)
        places_seen, _ = self._fleet.rows
        self._before[places] = self._seen[places]
        self._track(places, places_seen, first=False)
        distance = self._off(places_seen)
        arrived = asked & (distance < self._settings.goal_radius)
        reward = np.where(asked, self._distance - distance + arrived, 0.0)
        self._distance = np.where(asked, distance, self._distance)
        self._left[places] -= 1
        return reward, arrived, asked & ~arrived & (self._left == 0)

    def observe(self) -> NDArray[np.float32]:
        """Return what a controller sees of all places, (count, 8), as `OBSERVED` has it."""
        _, tilt = self._fleet.rows
        velocity = (self._seen - self._before) / self._row_s
        parts = [
            self._seen,
            np.clip(velocity, -FASTEST, FASTEST),
            np.clip(tilt, -STEEPEST, STEEPEST),
            self._goal,
        ]
        return np.concatenate(parts, axis=1).astype(np.float32)

    @property
    def distance(self) -> Array:
        """How far marbles are from their goals, (count,) [board edges]."""
        return self._distance.copy()

    def _off(self, places: Array) -> Array:
        return np.asarray(np.linalg.norm(places - self._goal, axis=1))

    def _track(self, places: NDArray[np.intp], true: Array, *, first: bool) -> None:
        """See marbles with the tracker's errors; one that it loses stays where it was seen."""
        noise, lost = self._settings.noise, self._settings.lost
        if noise == 0.0 and lost == 0.0:
            self._seen[places] = true[places]
            return
        for place in places:
            error = noise * self._random[place].standard_normal(2)
            if self._random[place].random() >= lost or first:
                self._seen[place] = true[place] + error
