"""How many environment steps a second: `labsim/Labyrinth-v0` beside MuJoCo and PyBullet on the same board.

    python benches/environment_speed.py

Steps last 1/60 s, four engine steps. The others step one board in one thread, without observations and
rewards: MuJoCo the board that `irt export` writes, walls and holes included, at its own step of 1/1920 s;
PyBullet the bare board of `peers/pybullet_engine.py`, at the engine's 1/240 s. All take turns, round after
round. Needs the extra gym; of mujoco and pybullet, what is not installed is left out.
"""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import irt
import irt.environment
from irt.engine import SUBSTEP_S
from irt.export.mjcf import STEP_S, to_mjcf
from irt.maze import Maze
from irt.rig import PARAMETERS, RANGES, Board, Marble

Array = NDArray[np.float64]

ROW_S = 4.0 * SUBSTEP_S
DELAYED = (
    irt.Effect("delay", {"delay_s": 0.1}),
    irt.Effect("backlash", {"width_x_rad": 0.02, "width_y_rad": 0.02}),
)
#: What is timed: effects of the model, and options of the environment.
KINDS: dict[str, tuple[tuple[irt.Effect, ...], dict[str, Any]]] = {
    "bare board": ((), {}),
    "bare board, delay and backlash": (DELAYED, {}),
    "12 walls, 8 holes": ((), {"maze": "cyberrunner-easy"}),
    "13 walls, 40 holes": ((), {"maze": "cyberrunner-hard"}),
    "12 walls, 8 holes, pictures": ((), {"maze": "cyberrunner-easy", "observation": "pictures"}),
}

OTHERS = ("MuJoCo", "PyBullet")
ROUNDS = 3
#: Rows of a round of the others.
ROWS = 300


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--places", type=int, default=1024)
    parser.add_argument("--steps", type=int, default=100)
    args = parser.parse_args()
    print("| environment | one thread [steps/s] | all threads | MuJoCo | PyBullet | ratio to each |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, (effects, options) in KINDS.items():
        model = simulator(effects)
        sides: dict[str, Callable[[], float]] = {
            "one": rounds_of(model, options, args.places, args.steps, 1),
            "every": rounds_of(model, options, args.places, args.steps, None),
        }
        if "observation" not in options:
            sides |= others(simulator(effects, options.get("maze")))
        rounds = [{side: step() for side, step in sides.items()} for _ in range(ROUNDS)]
        best = {side: max(one[side] for one in rounds) for side in sides}
        shown = [f"{best[side]:,.0f}" if side in best else "" for side in ("one", "every", *OTHERS)]
        ratios = ", ".join(f"{best['one'] / best[side]:.0f}" for side in OTHERS if side in best)
        print(f"| {name} | {' | '.join(shown)} | {ratios} |", flush=True)


def simulator(effects: tuple[irt.Effect, ...], layout: str | None = None) -> irt.Model:
    values = (0.07, 0.06, 3e-4, ROW_S / SUBSTEP_S, 1.0)
    return irt.Model(
        board=Board(),
        marble=Marble(),
        start="rest",
        ranges=dict(RANGES),
        parameters={name: irt.Parameter(value) for name, value in zip(PARAMETERS, values, strict=True)},
        effects=effects,
        maze=None if layout is None else Maze.of_layout(layout),
    )


def rounds_of(
    model: irt.Model, options: dict[str, Any], places: int, steps: int, threads: int | None
) -> Callable[[], float]:
    """Return what times a round, in steps a second of all marbles together."""
    envs = gymnasium.make_vec(
        irt.environment.ENV_ID, num_envs=places, model=model, threads=threads, step_s=ROW_S, **options
    )
    envs.reset(seed=0)
    random = np.random.default_rng(0)
    # Commands that change now and then move marbles about.
    actions = np.repeat(random.uniform(-1.0, 1.0, (-(-steps // 10), places, 2)), 10, axis=0)[:steps]

    def timed() -> float:
        began = time.perf_counter()
        for action in actions:
            envs.step(action)
        return places * steps / (time.perf_counter() - began)

    return timed


def others(model: irt.Model) -> dict[str, Callable[[], float]]:
    """Return what times a round of the engines of others that are installed and have this board."""
    found: dict[str, Callable[[], float]] = {}
    with contextlib.suppress(ImportError):
        found["MuJoCo"] = mujoco_board(model)
    if model.maze is None and not model.effects:
        with contextlib.suppress(ImportError):
            found["PyBullet"] = pybullet_board(model)
    return found


def mujoco_board(model: irt.Model) -> Callable[[], float]:
    """Return what times a round of MuJoCo's board; a marble that falls is put back."""
    import mujoco  # noqa: PLC0415

    board = mujoco.MjModel.from_xml_string(to_mjcf(model).text)
    data = mujoco.MjData(board)
    knobs = commands(board.nu)
    substeps = round(ROW_S / STEP_S)

    def timed() -> float:
        began = time.perf_counter()
        for command in knobs:
            data.ctrl[:] = command
            mujoco.mj_step(board, data, substeps)
            if data.joint("marble").qpos[2] < 0.0:
                mujoco.mj_resetData(board, data)
        return ROWS / (time.perf_counter() - began)

    return timed


def pybullet_board(model: irt.Model) -> Callable[[], float]:
    """Return what times a round of PyBullet's board."""
    import pybullet  # noqa: PLC0415

    from peers.pybullet_engine import build_world  # noqa: PLC0415
    from peers.workload import gravity_in_board  # noqa: PLC0415

    marble = build_world()
    gravity = gravity_in_board(model.values, commands(2)).tolist()
    substeps = round(ROW_S / SUBSTEP_S)

    def timed() -> float:
        began = time.perf_counter()
        for pull in gravity:
            pybullet.setGravity(*pull)
            for _ in range(substeps):
                pybullet.stepSimulation()
            pybullet.getBasePositionAndOrientation(marble)
        return ROWS / (time.perf_counter() - began)

    return timed


def commands(width: int) -> Array:
    """Return knob angles [rad], (ROWS, width), that change every ten rows."""
    random = np.random.default_rng(0)
    return np.repeat(random.uniform(-0.1, 0.1, (ROWS // 10, width)), 10, axis=0)


if __name__ == "__main__":
    main()
