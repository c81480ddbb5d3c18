"""Many labyrinths as one Gymnasium environment: their marbles go on together in the engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from irt import arguments
from irt.environment.single import checked, settings
from irt.environment.spaces import action_space, observation_space
from irt.environment.task import Task
from irt.errors import IrtError

Observation = NDArray[np.float32]
Mask = NDArray[np.bool_]
Results = tuple[Observation, NDArray[np.float64], Mask, Mask, dict[str, Any]]


class LabyrinthVectorEnv(VectorEnv[Observation, Observation, NDArray[Any]]):
    """Bring marbles to places on the bare board, each on a simulator drawn for each episode.

    Place i of a reset with seed s is the single environment's with seed s + i.

    Parameters
    ----------
    num_envs : int
        How many.
    model : Model or path
        The simulator: a model, or a ``model.toml``.
    autoreset_mode : AutoresetMode or str
        When a new episode begins where one has ended: in the next step (the default), in the same step, or by
        `reset` with ``options={"reset_mask": ...}``.
    **options
        The other attributes of `irt.environment.task.Settings`.

    Raises
    ------
    IrtError
        If a value is not as it must be.
    """

    def __init__(
        self,
        num_envs: int,
        model: Any,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        self.num_envs = arguments.whole("num_envs", num_envs, 1)
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            possible = ", ".join(mode.value for mode in AutoresetMode)
            raise IrtError(f"autoreset_mode: expected {possible}, got {autoreset_mode!r}") from error
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        chosen = settings(model, options)
        self._task = Task(self.num_envs, chosen)
        self.single_action_space = action_space(chosen)
        self.single_observation_space = observation_space()
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._ended = np.zeros(self.num_envs, dtype=bool)
        self._is_seeded = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin episodes everywhere, or where ``options["reset_mask"]`` is true."""
        asked = self._mask(options)
        seeds: Sequence[int | None]
        if seed is None:
            seeds = [None] * self.num_envs
        elif isinstance(seed, int):
            seeds = range(seed, seed + self.num_envs)
        else:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise IrtError(f"seed: expected one, or {self.num_envs}, got {len(seeds)}")
        for place in np.flatnonzero(asked):
            one = seeds[int(place)]
            if one is not None or not self._is_seeded:
                self._task.seed(int(place), one)
        self._is_seeded = self._is_seeded or bool(asked.all())
        self._task.begin(asked)
        self._ended[asked] = False
        return self._task.observe(), self._info(np.zeros(self.num_envs, dtype=bool), asked)

    def step(self, actions: Any) -> Results:
        """Play a row everywhere under commands (num_envs, 2); ended episodes begin again as the mode says."""
        given = checked(actions, (self.num_envs, 2))
        anew = self._ended.copy()
        if anew.any() and self._mode is AutoresetMode.DISABLED:
            places = ", ".join(map(str, np.flatnonzero(anew)[:5]))
            raise IrtError(
                f"step: episodes {places} have ended; reset them with options={{'reset_mask': ...}}"
            )
        if anew.any():
            self._task.begin(anew)
        reward, arrived, truncated = self._task.play(given, ~anew)
        self._ended = arrived | truncated
        everywhere = np.ones(self.num_envs, dtype=bool)
        infos = self._info(arrived, everywhere)
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            infos = self._begun_again(infos)
        return self._task.observe(), reward, arrived, truncated, infos

    def _begun_again(self, infos: dict[str, Any]) -> dict[str, Any]:
        """Begin episodes where others have ended; return infos with how these did."""
        ended = self._ended.copy()
        last = self._task.observe()
        final = np.full(self.num_envs, None, dtype=object)
        for place in np.flatnonzero(ended):
            final[place] = last[place]
        of_final = {
            **{
                name: np.where(ended, infos[name], np.zeros_like(infos[name]))
                for name in ("distance", "is_success")
            },
            "_distance": ended.copy(),
            "_is_success": ended.copy(),
        }
        self._task.begin(ended)
        self._ended[:] = False
        return {
            **self._info(np.zeros(self.num_envs, dtype=bool), np.ones(self.num_envs, dtype=bool)),
            "final_obs": final,
            "_final_obs": ended.copy(),
            "final_info": of_final,
            "_final_info": ended.copy(),
        }

    def _info(self, arrived: Mask, asked: Mask) -> dict[str, Any]:
        """Return what is known besides, as arrays (num_envs,) with masks."""
        return {
            "distance": self._task.distance,
            "_distance": asked.copy(),
            "is_success": arrived.copy(),
            "_is_success": asked.copy(),
        }

    def _mask(self, options: dict[str, Any] | None) -> Mask:
        if options is None or "reset_mask" not in options:
            return np.ones(self.num_envs, dtype=bool)
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            expected = f"{self.num_envs} booleans, one of them true at least"
            raise IrtError(f"options, reset_mask: expected {expected}, got {mask!r}")
        return mask
