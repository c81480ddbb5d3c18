"""How many environment steps a second: `labsim/Labyrinth-v0` beside MuJoCo on the same board.

    python benches/environment_speed.py

Steps last 1/60 s, four engine steps. MuJoCo steps one bare board, as `irt export` writes it, at its own time
step of 1/1920 s, in one thread. Needs the extras gym and mujoco.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import gymnasium
import mujoco
import numpy as np

import irt
import irt.environment
from irt.engine import SUBSTEP_S
from irt.export.mjcf import STEP_S, to_mjcf
from irt.rig import PARAMETERS, RANGES, Board, Marble

ROW_S = 4.0 * SUBSTEP_S
DELAYED = (
    irt.Effect("delay", {"delay_s": 0.1}),
    irt.Effect("backlash", {"width_x_rad": 0.02, "width_y_rad": 0.02}),
)
#: What is timed: effects of the model, and options of the environment.
KINDS: dict[str, tuple[tuple[irt.Effect, ...], dict[str, Any]]] = {
    "bare board": ((), {}),
    "bare board, delay and backlash": (DELAYED, {}),
    "8 holes": ((), {"maze": "cyberrunner-easy"}),
    "40 holes": ((), {"maze": "cyberrunner-hard"}),
    "8 holes, pictures": ((), {"maze": "cyberrunner-easy", "observation": "pictures"}),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--places", type=int, default=1024)
    parser.add_argument("--steps", type=int, default=100)
    args = parser.parse_args()
    print("| environment | one thread [steps/s] | all threads | MuJoCo, one thread | ratio of one thread |")
    print("| --- | --- | --- | --- | --- |")
    for name, (effects, options) in KINDS.items():
        model = simulator(effects)
        one, every = (environment(model, options, args.places, args.steps, threads) for threads in (1, None))
        theirs = "" if options else f"{boards(model):,.0f}"
        ratio = "" if options else f"{one / float(theirs.replace(',', '')):.0f}"
        print(f"| {name} | {one:,.0f} | {every:,.0f} | {theirs} | {ratio} |", flush=True)


def simulator(effects: tuple[irt.Effect, ...]) -> irt.Model:
    values = (0.07, 0.06, 3e-4, ROW_S / SUBSTEP_S, 1.0)
    return irt.Model(
        board=Board(),
        marble=Marble(),
        start="rest",
        ranges=dict(RANGES),
        parameters={name: irt.Parameter(value) for name, value in zip(PARAMETERS, values, strict=True)},
        effects=effects,
    )


def environment(
    model: irt.Model, options: dict[str, Any], places: int, steps: int, threads: int | None
) -> float:
    """Return the steps a second of all marbles together, the best of three rounds."""
    envs = gymnasium.make_vec(
        irt.environment.ENV_ID, num_envs=places, model=model, threads=threads, step_s=ROW_S, **options
    )
    envs.reset(seed=0)
    random = np.random.default_rng(0)
    # Commands that change now and then move marbles about.
    actions = np.repeat(random.uniform(-1.0, 1.0, (-(-steps // 10), places, 2)), 10, axis=0)[:steps]
    best = 0.0
    for _ in range(3):
        began = time.perf_counter()
        for action in actions:
            envs.step(action)
        best = max(best, places * steps / (time.perf_counter() - began))
    return best


def boards(model: irt.Model, rows: int = 300) -> float:
    """Return the rows a second of MuJoCo's board."""
    board = mujoco.MjModel.from_xml_string(to_mjcf(model).text)
    data = mujoco.MjData(board)
    random = np.random.default_rng(0)
    substeps = round(ROW_S / STEP_S)
    began = time.perf_counter()
    for _ in range(rows):
        data.ctrl[:] = random.uniform(-0.1, 0.1, 2)
        mujoco.mj_step(board, data, substeps)
    return rows / (time.perf_counter() - began)


if __name__ == "__main__":
    main()
