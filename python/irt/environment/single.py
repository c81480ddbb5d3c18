"""One labyrinth as a plain Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from irt import arguments
from irt.environment.drawing import picture
from irt.environment.vector import LabyrinthVectorEnv, Observation
from irt.errors import IrtError


class LabyrinthEnv(gymnasium.Env[Any, Any]):
    """A marble that follows a path through a maze, as the only one of a `LabyrinthVectorEnv`.

    Parameters
    ----------
    render_mode : {"rgb_array"}, optional
        What `render` returns.
    **options
        Of `LabyrinthVectorEnv`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012

    def __init__(self, *args: Any, render_mode: str | None = None, **options: Any) -> None:
        if render_mode not in {None, "rgb_array"}:
            raise IrtError(f"render_mode: expected rgb_array or None, got {render_mode!r}")
        if "num_envs" in options:
            raise IrtError("num_envs: this is one labyrinth; gymnasium.make_vec makes many")
        self.render_mode = render_mode
        self._all = LabyrinthVectorEnv(1, *args, autoreset_mode=AutoresetMode.DISABLED, **options)
        self.observation_space = self._all.single_observation_space
        self.action_space = self._all.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        observed, infos = self._all.reset(seed=seed)
        return _first(observed), _known(infos)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Play a step."""
        move = arguments.array("action", action)
        if move.shape != self.action_space.shape:
            raise IrtError(f"action: expected shape (2,), got {move.shape}")
        observed, rewards, terminated, truncated, infos = self._all.step(move[None])
        return _first(observed), float(rewards[0]), bool(terminated[0]), bool(truncated[0]), _known(infos)

    @property
    def place(self) -> NDArray[np.float64]:
        """Where the marble is [m from the board's centre], (2,), as no tracker sees it."""
        return np.asarray(self._all.places[0])

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the board from above, (h, w, 3), in the mode ``rgb_array``."""
        if self.render_mode is None:
            return None
        return picture(self._all.board, self._all.model.marble.radius_m, self.place)


def _first(observed: Observation) -> Observation:
    if isinstance(observed, np.ndarray):
        return np.asarray(observed[0])
    return {name: np.asarray(one[0]) for name, one in observed.items()}


def _known(infos: dict[str, Any]) -> dict[str, Any]:
    """Return the infos of the one marble, without masks."""
    return {
        name: one[0].item() for name, one in infos.items() if f"_{name}" in infos and infos[f"_{name}"][0]
    }
