"""What a controller of the labyrinth does and sees."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from irt.environment.task import FASTEST, STEEPEST, Settings

#: Bound of places and goals [board edges]: far beyond what any camera shows.
_FARTHEST = 10.0


def action_space(settings: Settings) -> spaces.Box:
    """Return the commands about x and y: up to the limit, in the rig's own unit."""
    limit = np.float32(settings.knob_limit)
    return spaces.Box(-limit, limit, (2,), np.float32)


def observation_space() -> spaces.Box:
    """Return the states: place, velocity, tilt, goal."""
    high = np.repeat([_FARTHEST, FASTEST, STEEPEST, _FARTHEST], 2).astype(np.float32)
    return spaces.Box(-high, high, dtype=np.float32)
