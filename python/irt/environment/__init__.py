"""Gymnasium environments of a model: `import irt.environment` registers ``labsim/Labyrinth-v0``."""

from __future__ import annotations

from irt.extras import require

require("gymnasium", "irt.environment")

import gymnasium  # noqa: E402  # what says that it is missing comes first

from irt.environment.single import LabyrinthEnv  # noqa: E402
from irt.environment.vector import LabyrinthVectorEnv  # noqa: E402

__all__ = ["ID", "LabyrinthEnv", "LabyrinthVectorEnv"]

#: The name under which Gymnasium makes both.
ID = "labsim/Labyrinth-v0"

if ID not in gymnasium.registry:
    gymnasium.register(
        ID,
        entry_point="irt.environment.single:LabyrinthEnv",
        vector_entry_point="irt.environment.vector:LabyrinthVectorEnv",
    )
