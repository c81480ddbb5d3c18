"""The labyrinth as Gymnasium environments, many marbles at a time; extra ``[gym]``.

Importing this package registers ``labsim/Labyrinth-v0``:

    import gymnasium
    import irt.environment

    envs = gymnasium.make_vec("labsim/Labyrinth-v0", num_envs=1024, model="model.toml")
"""

from __future__ import annotations

from irt import extras

extras.require("gymnasium", "irt.environment")

import gymnasium  # noqa: E402

from irt.environment.single import LabyrinthEnv  # noqa: E402
from irt.environment.task import Reward, Task  # noqa: E402
from irt.environment.vector import MAX_EPISODE_STEPS, LabyrinthVectorEnv  # noqa: E402

__all__ = ["ENV_ID", "LabyrinthEnv", "LabyrinthVectorEnv", "Reward", "Task", "make_env"]

#: Under which name Gymnasium knows it.
ENV_ID = "labsim/Labyrinth-v0"

if ENV_ID not in gymnasium.registry:
    gymnasium.register(
        ENV_ID,
        entry_point=LabyrinthEnv,
        vector_entry_point=LabyrinthVectorEnv,
        kwargs={"max_episode_steps": MAX_EPISODE_STEPS},
    )


def make_env(
    n_envs: int = 1, use_async_envs: bool = False
) -> dict[str, dict[int, gymnasium.vector.VectorEnv]]:
    """Return environments as LeRobot's EnvHub asks for them: by suite and number of the task.

    Parameters
    ----------
    n_envs : int
        How many marbles.
    use_async_envs : bool
        Has no effect: marbles are stepped by the engine's threads, in one process.
    """
    return {"labyrinth": {0: LabyrinthVectorEnv(n_envs)}}
