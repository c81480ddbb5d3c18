"""How many environment steps a second: `labsim/Labyrinth-v0` beside MuJoCo on the same board.

    python benches/environment_speed.py

Rows last 0.01 s, of three engine steps of 1/300 s. MuJoCo steps one board, as `irt export` writes it, at its
own time step of 1/1920 s, in one thread. Needs the extras gym and mujoco.
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import mujoco
import numpy as np

import irt
import irt.environment
from irt.engine import SUBSTEP_S
from irt.export.mjcf import STEP_S, to_mjcf
from irt.rig import PARAMETERS, RANGES, Board, Marble

ROW_S = 0.01
EFFECTS = {
    "five parameters": (),
    "delay, backlash": (
        irt.Effect("delay", {"delay_s": 0.1}),
        irt.Effect("backlash", {"width_x_rad": 0.02, "width_y_rad": 0.02}),
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--places", type=int, default=2048)
    parser.add_argument("--steps", type=int, default=200)
    args = parser.parse_args()
    print("| model | one thread [steps/s] | all threads | MuJoCo, one thread | ratio of one thread |")
    print("| --- | --- | --- | --- | --- |")
    for name, effects in EFFECTS.items():
        model = simulator(effects)
        one, every = (environment(model, args.places, args.steps, threads) for threads in (1, None))
        theirs = boards(model)
        print(f"| {name} | {one:,.0f} | {every:,.0f} | {theirs:,.0f} | {one / theirs:.0f} |", flush=True)


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


def environment(model: irt.Model, places: int, steps: int, threads: int | None) -> float:
    """Return the steps a second of all places together, the best of three rounds."""
    envs = gymnasium.make_vec(
        irt.environment.ID, num_envs=places, model=model, threads=threads, episode_rows=10 * steps
    )
    envs.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-0.1, 0.1, (steps, places, 2)).astype(np.float32)
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
