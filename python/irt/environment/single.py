"""One labyrinth as a Gymnasium environment."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from irt.environment.spaces import action_space, observation_space
from irt.environment.task import Settings, Task
from irt.errors import IrtError

Observation = NDArray[np.float32]
_ONE = np.ones(1, dtype=bool)


class LabyrinthEnv(gymnasium.Env[Observation, Observation]):
    """Bring the marble to a place on the bare board, on a simulator drawn for each episode.

    Parameters
    ----------
    model : Model or path
        The simulator: a model, or a ``model.toml``.
    **options
        The other attributes of `irt.environment.task.Settings`.

    Raises
    ------
    IrtError
        If a value is not as it must be.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(self, model: Any, **options: Any) -> None:
        self._settings = settings(model, options)
        self._task = Task(1, self._settings)
        self.action_space = action_space(self._settings)
        self.observation_space = observation_space()
        self._is_seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; a seed makes it, and those after it, the same every time."""
        super().reset(seed=seed, options=options)
        if seed is not None or not self._is_seeded:
            self._task.seed(0, seed)
            self._is_seeded = True
        self._task.begin(_ONE)
        return self._task.observe()[0], self._info(arrived=False)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Play a row under commands (2,)."""
        actions = checked(action, (2,))[None]
        reward, arrived, truncated = self._task.play(actions, _ONE)
        info = self._info(arrived=bool(arrived[0]))
        return self._task.observe()[0], float(reward[0]), bool(arrived[0]), bool(truncated[0]), info

    def _info(self, *, arrived: bool) -> dict[str, Any]:
        return {"distance": float(self._task.distance[0]), "is_success": arrived}


def settings(model: Any, options: dict[str, Any]) -> Settings:
    """Return the settings of an environment.

    Raises
    ------
    IrtError
        For an unknown option, or a value that is not as it must be.
    """
    try:
        return Settings(model, **options)
    except TypeError as error:
        raise IrtError(f"environment: {error}") from error


def checked(action: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return commands as an array.

    Raises
    ------
    IrtError
        If they have another shape, or are no finite numbers.
    """
    try:
        found = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise IrtError(f"action: expected numbers of shape {shape}, got {action!r}") from error
    if found.shape != shape:
        raise IrtError(f"action: expected shape {shape}, got {found.shape}")
    if not np.isfinite(found).all():
        raise IrtError("action: expected finite numbers, got nan or infinity")
    return found
