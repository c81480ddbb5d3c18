"""How far MuJoCo's rollouts of exported models are from this project's own.

    python benches/mjcf_agreement.py --runs 20

For each effect that the file has, alone, and for all that go together, models are drawn from the paper's
ranges, exported, loaded in MuJoCo and played: marbles from rest under four sines a run, rows of whole engine
steps. The table has the root mean square distance of the marbles [% of the edge] over the first second and
over the whole run, of tilts [mrad], and beside it the distance of this project's two engines. In the last
sets the knobs turn four times as far, so that marbles meet rims: there engines differ most.

A second table is of labyrinths: marbles from random places among walls and holes, and whether they end alike,
through the same hole or through none.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

import irt
from irt.export.mjcf import EXPRESSED, STEP_S, to_mjcf
from irt.maze import Maze
from irt.rig import PARAMETERS, RANGES, Board, Marble

Array = NDArray[np.float64]

#: Effects that nothing shows before the marble has met a rim.
AT_RIMS = frozenset({"spinning_friction", "wall_restitution"})
#: Names of models, and the effects of each; none of the exported ones is missing.
SETS = {
    "five parameters": (),
    **{name: (name,) for name in sorted(EXPRESSED - AT_RIMS)},
    "delay + lag + backlash": ("delay", "lag", "backlash"),
    "all of the actuator": ("delay", "second_order_lag", "backlash", "gear_matrix", "tilt_bias"),
    "at rims: five parameters": (),
    **{f"at rims: {name}": (name,) for name in sorted(AT_RIMS)},
}
#: Labyrinths; in them knobs turn so much further that some marbles fall.
LIVELY = 3.0
LAYOUTS = ("cyberrunner-easy", "cyberrunner-hard")
ROWS = 100


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20, help="of each set")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    print(f"MuJoCo {mujoco.__version__}, n = {args.runs} runs of {ROWS} rows")
    print("| effects | first second | whole run | tilt [mrad] | our two engines, whole run | real time |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, effects in SETS.items():
        found = np.array(
            [compared(effects, seed, _factor(name)) for seed in range(args.seed, args.seed + args.runs)]
        )
        second, whole, tilt, own = np.sqrt(np.mean(found[:, :4] ** 2, axis=0))
        print(
            f"| {name} | {100 * second:.3f} % | {100 * whole:.2f} % | {1e3 * tilt:.3f} | {100 * own:.2f} % "
            f"| {np.median(found[:, 4]):.0f} x |",
            flush=True,
        )
    print()
    print(
        "| layout | ends alike | fell: here, in MuJoCo | median distance at the end of a second | real time |"
    )
    print("| --- | --- | --- | --- | --- |")
    for name in LAYOUTS:
        ends = [among_holes(name, seed) for seed in range(args.seed, args.seed + args.runs)]
        alike, fell, theirs = (sum(one) for one in zip(*(end[:3] for end in ends), strict=True))
        away, speed = (float(np.median(one)) for one in zip(*(end[3:] for end in ends), strict=True))
        print(
            f"| `{name}` | {alike} of {len(ends)} | {fell}, {theirs} | {100 * away:.2f} % | {speed:.1f} x |",
            flush=True,
        )


def _factor(name: str) -> float:
    return 4.0 if name.startswith("at rims") else 1.0


def compared(
    effects: Sequence[str], seed: int, factor: float = 1.0
) -> tuple[float, float, float, float, float]:
    """Return by how much a drawn model's rollouts differ, as `main` shows, and how fast MuJoCo is."""
    random = np.random.default_rng([11, seed])
    model = drawn(effects, random)
    knobs = factor * sines(random)
    began = time.perf_counter()
    seen, tilt, _ = play(to_mjcf(model).text, knobs)
    seconds = time.perf_counter() - began
    row_s = model.parameters["time_scale"].value / 240.0
    ours, our_tilt = irt.rollouts(model, knobs, tilt=True)
    rapier = irt.rollouts(model, knobs, engine="rapier")
    first = max(2, round(1.0 / row_s))
    return (
        rms(seen[:first] - ours[0, :first]),
        rms(seen - ours[0]),
        rms(tilt[1:] - our_tilt[0, 1:]),
        rms(rapier[0] - ours[0]),
        ROWS * row_s / seconds,
    )


def among_holes(layout: str, seed: int) -> tuple[bool, bool, bool, float, float]:
    """Return how a marble from a random place fares in a labyrinth, here and in MuJoCo.

    Returns
    -------
    alike, fell, fell_there : bool
        Whether it falls through the same hole in both or through none, and whether it falls in each.
    away : float
        The distance of the two after a second, or before the first falls [board edges].
    speed : float
        How much faster than the clock MuJoCo is.
    """
    random = np.random.default_rng([12, seed])
    maze = Maze.of_layout(layout)
    model = replace(drawn((), random), maze=replace(maze, start=free_place(maze, random)))
    knobs = LIVELY * sines(random)
    falls = np.empty((1, 2), dtype=np.int64)
    assert model.maze is not None
    ours = irt.rollouts(model, knobs, start=np.array(model.maze.start) / model.board.edge_x_m, falls=falls)[0]
    began = time.perf_counter()
    seen, _, below = play(to_mjcf(model).text, knobs, start=model.maze.start)
    seconds = time.perf_counter() - began
    row_s = model.parameters["time_scale"].value / 240.0
    row, hole = falls[0].tolist()
    fell_there = bool(below.any())
    there = int(np.argmax(below)) if fell_there else ROWS
    holes = np.array(maze.holes) / model.board.edge_x_m
    through = int(np.argmin(np.hypot(*(holes - seen[there]).T))) if fell_there else -1
    last = max(1, min(round(1.0 / row_s), there if row < 0 else min(row, there)) - 1)
    away = float(np.hypot(*(seen[last] - ours[last])))
    return (row >= 0) == fell_there and hole == through, row >= 0, fell_there, away, ROWS * row_s / seconds


def free_place(maze: Maze, random: np.random.Generator) -> tuple[float, float]:
    """Return a place [m] of a marble that touches no wall, and is beside the holes by its radius."""
    board, radius = Board(), Marble().radius_m
    half = np.array([board.edge_x_m, board.edge_y_m]) / 2.0 - radius
    while True:
        x, y = random.uniform(-half, half).tolist()
        if all(math.dist((x, y), hole) > maze.hole_radius_m + radius for hole in maze.holes) and all(
            _distance(wall, (x, y)) > maze.wall_thickness_m / 2.0 + radius for wall in maze.walls
        ):
            return x, y


def _distance(wall: Sequence[float], place: tuple[float, float]) -> float:
    begin, end, point = np.array(wall[:2]), np.array(wall[2:]), np.array(place)
    along = end - begin
    part = np.clip((point - begin) @ along / max(along @ along, 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(point - begin - part * along))


def rms(difference: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(difference**2, axis=-1))))


def drawn(effects: Sequence[str], random: np.random.Generator) -> irt.Model:
    """Return a model with effects, their plausible values drawn; rows of whole engine steps."""
    values: list[list[float]] = [
        random.uniform(0.02, 0.08, 2).tolist(),
        [random.uniform(1e-4, 8e-4)],
        [float(random.integers(8, 25))],
        [1.0],
    ]
    info = {one.name: one for one in irt.effects()}
    return irt.Model(
        board=Board(),
        marble=Marble(),
        start="rest",
        ranges=dict(RANGES),
        parameters={
            name: irt.Parameter(float(value))
            for name, value in zip(PARAMETERS, np.concatenate(values), strict=True)
        },
        effects=tuple(irt.Effect(name, plausible(info[name], random)) for name in effects),
    )


def plausible(info: irt.EffectInfo, random: np.random.Generator) -> dict[str, float]:
    """Return values from the nearer half of what is plausible; the choices that the file can express."""
    found = {
        one.name: one.neutral
        + random.uniform(0.1, 0.5) * ((one.low if random.random() < 0.5 else one.high) - one.neutral)
        for one in info.required
    }
    known: dict[str, Any] = {
        "backlash": {"width_x_rad": random.uniform(0.01, 0.04), "width_y_rad": random.uniform(0.01, 0.04)},
        "eccentric_marble": {**found, "follows_path": 0.0},
        "delay": {"delay_s": random.uniform(0.03, 0.3)},
        "lag": {"time_constant_s": random.uniform(0.05, 0.3)},
        "second_order_lag": {
            "time_constant_s": random.uniform(0.02, 0.2),
            "damping_ratio": random.uniform(0.4, 1.5),
        },
        "latency": {"latency_s": random.uniform(0.02, 0.2)},
        "viscous_drag": {"rate_per_s": random.uniform(0.1, 1.0)},
        "tilt_bias": {name: random.uniform(-1e-3, 1e-3) for name in ("bias_x_rad", "bias_y_rad")},
        "lean": {name: random.uniform(-1e-3, 1e-3) for name in ("lean_x_rad", "lean_y_rad")},
        "gear_matrix": {name: random.uniform(-0.02, 0.02) for name in ("x_from_y", "y_from_x")},
        "spinning_friction": {"increase": random.uniform(1e-4, 2e-3)},
        "wall_restitution": {"increase": random.uniform(0.1, 0.8)},
    }
    return dict(known.get(info.name, found))


def sines(random: np.random.Generator) -> Array:
    """Return knobs (rows, 2) [rad] of four sines each."""
    time_ = np.arange(ROWS)[:, None]
    waves = [
        np.sin(2.0 * np.pi * time_ * random.uniform(0.01, 0.06, (1, 2)) + random.uniform(0.0, 6.3, (1, 2)))
        for _ in range(4)
    ]
    return np.asarray(0.04 * np.sum(waves, axis=0))


def play(
    xml: str, knobs: Array, start: tuple[float, float] | None = None
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Play commands (rows, 2) to a marble at rest at a place [m], or where the camera sees the middle.

    Returns
    -------
    seen, tilt : (rows, 2) arrays
        The marble [board edges] and the board's tilt [rad] in each row.
    below : (rows,) array
        Whether the marble's centre is below the plate's surface.
    """
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    row_s, edges = (float(model.numeric(name).data[0]) for name in ("row_s", "edges_per_cm"))
    mujoco.mj_forward(model, data)
    begin = data.site("camera").xpos[:2] if start is None else 100.0 * np.array(start)
    data.joint("marble").qpos[:2] = begin
    mujoco.mj_forward(model, data)
    seen, tilt = np.empty((len(knobs), 2)), np.empty((len(knobs), 2))
    below = np.zeros(len(knobs), dtype=bool)
    radius = float(model.geom("marble").size[0])
    done = 0
    for row, knob in enumerate(knobs):
        while done < round(row * row_s / STEP_S):
            mujoco.mj_step(model, data)
            done += 1
        seen[row] = edges * data.sensor("marble").data[:2]
        below[row] = data.sensor("marble").data[2] < -radius
        tilt[row] = data.sensor("tilt_x").data[0], data.sensor("tilt_y").data[0]
        data.ctrl[:] = knob
    return seen, tilt, below


if __name__ == "__main__":
    main()
