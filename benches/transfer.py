"""Does a diagnosis pay on a controller's return? Controllers from fitted models, tried on concealed rigs.

    irt prove --transfer --out transfer
    .venv/bin/python benches/transfer.py transfer --policies 2 --page docs/transfer.md

A rig of MuJoCo hides the effects of one of `KINDS`. Eight recordings of it are tuned and diagnosed. The
model-predictive controller of `examples/mpc.py` is made on each of `ARMS`, and leads marbles along the path
of the bare board and of the labyrinth with eight holes, on the concealed rig. All that is made is kept in
the folder; a run that was stopped goes on. Needs the extras gym and prove, and train for learned policies.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import irt
import mujoco_world
from hide_effects import Setting
from irt.catalogue import effect
from irt.cli.__main__ import report_errors
from irt.engine import SUBSTEP_S
from irt.environment import Task
from irt.files import read_json, write_atomic
from irt.rig import PARAMETERS, RANGES
from mujoco_world.live import Live
from transfer_page import write_page

# The controller is an example, for readers too.
sys.path.append(str(Path(__file__).resolve().parents[1] / "examples"))
from mpc import Config, Controller, passed

if TYPE_CHECKING:
    from transfer_policy import Driver

Array = NDArray[np.float64]
#: The models of a rig's folder; of what has many, so many of them.
Arm = Callable[[Path, int], list[irt.Model]]

#: Recordings of a rig, and the seed of the first.
RECORDINGS, SEED = 8, 326
#: Sizes of hidden effects are drawn evenly between these, and of either sign where the catalogue has both.
SIZES: dict[str, dict[str, tuple[float, float]]] = {
    "delay": {"delay_s": (0.1, 0.25)},
    "lag": {"time_constant_s": (0.1, 0.25)},
    "second_order_lag": {"time_constant_s": (0.08, 0.15), "damping_ratio": (0.4, 0.8)},
    "latency": {"latency_s": (0.1, 0.2)},
    "backlash": {"width_x_rad": (0.02, 0.06), "width_y_rad": (0.02, 0.06)},
    "dead_band": {"half_width_rad": (0.01, 0.03)},
    "tilt_bias": {"bias_x_rad": (0.001, 0.0025), "bias_y_rad": (0.001, 0.0025)},
    "cross_coupling": {"x_from_y": (0.1, 0.3), "y_from_x": (0.1, 0.3)},
    "static_friction": {"ratio": (2.0, 4.0)},
}
#: What rigs hide, in turn.
KINDS: tuple[tuple[str, ...], ...] = (
    ("delay", "backlash", "tilt_bias"),
    ("lag", "tilt_bias"),
    ("backlash", "latency"),
    ("delay", "cross_coupling"),
    ("second_order_lag", "backlash"),
    ("delay",),
    ("dead_band", "lag"),
    ("backlash", "static_friction"),
    ("tilt_bias", "latency"),
    ("delay", "second_order_lag", "tilt_bias"),
)


#: The largest commands [rad]: as far as recordings go.
LARGEST_RAD = np.full(2, 0.15)
#: Runs with a controller, and by how far their starts differ along each axis [m].
SEEDS, START_M = 5, 0.002
#: A run is given up after so many seconds, or so many without progress.
MOST_S, STUCK_S = 40.0, 8.0
#: Models of an ensemble, the plans that each is asked about, and the models in which a policy learns.
DRAWS, ENSEMBLE, POLICY_DRAWS = 4, Config(plans=128), 64
#: Wide randomisation: factors of the gears lie between this and its inverse.
GEAR_FACTOR = 1.5


#: What the page says before its tables.
TEXT = f"""\
Does it pay to know the missing physics, where a controller has to use the model? A rig of MuJoCo hides
effects that no fit knows of. From {RECORDINGS} recordings of it come models. A controller is made on each,
and leads marbles along a path on the concealed rig.

The controller is the same for all, `examples/mpc.py` ([plan with it](use.md#plan-with-it)): in each row it
estimates the marble's state with its model, compares hundreds of command sequences in it, and gives the first
command of the best. A command answers the picture of the row before. Ensembles are scored by their mean:
{DRAWS} draws of the posterior, or {DRAWS} models whose gears are the tuned ones times 1/{GEAR_FACTOR} to
{GEAR_FACTOR}, with any rolling friction that the paper allows.

{{learned}}A run ends when the marble arrives, falls, makes no progress for {STUCK_S:.0f} s (stuck), or after
{MOST_S:.0f} s. It makes progress within 20 mm of the path. Starts differ by up to {1e3 * START_M:.0f} mm
along each axis, and the tracker's noise is that of the recordings.
"""
#: What it says where policies were learned.
LEARNED = f"""\
The learned policy is that of `examples/ppo.py` ([a policy in one file](train.md#a-policy-in-one-file)),
trained in the models of an arm: {POLICY_DRAWS} of an ensemble.

"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=len(KINDS))
    parser.add_argument("--policies", type=int, default=4, help="rigs for which policies are learned")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--page", type=Path, help="default: transfer.md in the folder")
    args = parser.parse_args()
    folders = [args.out / f"rig-{number}" for number in range(args.rigs)]
    rigs = {task: folders[: args.policies] if task in POLICIES else folders for task in TASKS}
    rigs = {task: some for task, some in rigs.items() if some}
    with ProcessPoolExecutor(args.jobs, get_context("spawn")) as pool:
        for folder, label in zip(folders, pool.map(prepared, folders, range(args.rigs)), strict=True):
            print(folder.name, ", ".join(one["name"] for one in label["effects"]), flush=True)
        jobs = [(folder, task, arm) for task, some in rigs.items() for folder in some for arm in ARMS]
        for job, runs in zip(jobs, pool.map(tried, *zip(*jobs, strict=True)), strict=True):
            print(job[0].name, *job[1:], " ".join(one["ended"] for one in runs), flush=True)
    text = TEXT.format(learned="" if POLICIES.isdisjoint(rigs) else LEARNED)
    write_page(args.page or args.out / "transfer.md", rigs, list(ARMS), text)


def prepared(folder: Path, number: int) -> dict[str, Any]:
    """Record a concealed rig and fit it; return its label."""
    label: dict[str, Any] = made(folder / "label.json", lambda: record(folder, number))
    fitted(folder)
    made(folder / "errors.json", lambda: errors(folder, number))
    return label


def tried(folder: Path, task: str, arm: str) -> list[dict[str, Any]]:
    """Return what became of the runs of an arm on a concealed rig, one for each seed."""
    layout, make = TASKS[task]

    def travelled() -> list[dict[str, Any]]:
        label = read_json(folder / "label.json")
        return travel(label, make(folder, label, ARMS[arm], Task.of(layout)), Task.of(layout))

    found: list[dict[str, Any]] = made(folder / f"{task}-{arm}.json", travelled)
    return found


def planner(folder: Path, label: dict[str, Any], models: Arm, task: Task) -> Controller:
    """Return the model-predictive controller of an arm."""
    some, row_s = models(folder, DRAWS), label["values"][3] * SUBSTEP_S
    config = ENSEMBLE if len(some) > 1 else Config()
    return Controller(some, task, LARGEST_RAD, row_s, marbles=SEEDS, late=1, config=config)


def policy(folder: Path, label: dict[str, Any], models: Arm, task: Task) -> Driver:
    """Return the policy that is learned in the models of an arm."""
    # Torch is an extra that the planned tasks do without.
    from transfer_policy import Driver, learned, mixture  # noqa: PLC0415

    model, row_s = mixture(models(folder, POLICY_DRAWS)), label["values"][3] * SUBSTEP_S
    found = learned(model, task.maze, LARGEST_RAD, row_s, label["noise"])
    return Driver(found, task, model.board.edge_x_m, LARGEST_RAD, SEEDS)


def record(folder: Path, number: int) -> dict[str, Any]:
    """Record a concealed rig into a folder; return its label."""
    setting, random = drawn(number)
    effects = [hidden(name, random) for name in KINDS[number % len(KINDS)]]
    knobs = setting.knobs[:RECORDINGS]
    seen = setting.simulate(effects, knobs) + setting.noise * random.normal(size=knobs.shape)
    stamps = setting.values[3] * SUBSTEP_S * np.arange(seen.shape[1])
    folder.mkdir(parents=True, exist_ok=True)
    for index, one in enumerate(seen):
        irt.save_recording(folder / f"run-{index + 1}.csv", knobs[index], one, stamps)
    write_atomic(folder / "rig.toml", "[parameters]\nobservation_scale = { range = [0.99, 1.01] }\n")
    return {"values": setting.values.tolist(), "effects": effects, "noise": setting.noise}


def drawn(number: int) -> tuple[Setting, np.random.Generator]:
    """Draw a rig without hidden physics, with the commands of recordings and of runs held out."""
    random = np.random.default_rng([SEED, number])
    found = Setting.drawn(mujoco_world, random)
    # Rows of 50 to 67 ms, as of a camera and servos at 15 to 20 Hz; the scale of the pictures is known.
    values = np.array([*found.values[:3], float(random.integers(12, 17)), 1.0])
    return replace(found, values=values), random


def hidden(name: str, random: np.random.Generator) -> dict[str, Any]:
    """Draw the size of an effect."""
    either = {one.name for one in effect(name).parameters if one.low < 0.0}
    drawn: dict[str, Any] = {"name": name}
    for key, ends in SIZES[name].items():
        drawn[key] = float(random.uniform(*ends) * (random.choice([-1.0, 1.0]) if key in either else 1.0))
    return drawn


def made(path: Path, make: Callable[[], Any]) -> Any:
    """Return the content of a JSON file, which is made unless it is there."""
    if not path.exists():
        write_atomic(path, json.dumps(make(), indent=1))
    return read_json(path)


def fitted(folder: Path) -> None:
    """Fit a rig's recordings: the five parameters, with a delay too, and a diagnosis."""
    fits: dict[str, Callable[[irt.Rig], Any]] = {
        "tuned": lambda rig: irt.tune(rig, threads=1),
        "delayed": lambda rig: irt.tune(rig, effects=("delay",), threads=1),
        "diagnosed": lambda rig: irt.diagnose(rig, threads=1),
    }
    for name, fit in fits.items():
        if not (folder / f"{name}.toml").exists():
            irt.save_model(folder / f"{name}.toml", fit(irt.load_rig(folder)).model)


def tuned(folder: Path, _: int) -> list[irt.Model]:
    return [to_scale(irt.load_model(folder / "tuned.toml"))]


def delayed(folder: Path, _: int) -> list[irt.Model]:
    return [to_scale(irt.load_model(folder / "delayed.toml"))]


def to_scale(model: irt.Model) -> irt.Model:
    """Return the model with the scale that its pictures are known to have.

    A fit that lacks physics leaves the range of the scale. A scale times r with gears and friction over r
    leaves paths off the rim as they are.
    """
    scale = model.parameters["observation_scale"].value
    values = model.values * np.array([scale, scale, scale, 1.0, 1.0 / scale])
    return replace(model, parameters=named(values))


def randomised(folder: Path, draws: int) -> list[irt.Model]:
    """Spread gears and friction widely around what was tuned."""
    (model,) = tuned(folder, 1)
    random = np.random.default_rng(SEED)

    def spread() -> irt.Model:
        values = model.values * GEAR_FACTOR ** np.array([*random.uniform(-1.0, 1.0, 2), 0.0, 0.0, 0.0])
        values[2] = random.uniform(*RANGES["rolling_friction"])
        return replace(model, parameters=named(values))

    return [spread() for _ in range(draws)]


def diagnosed(folder: Path, draws: int) -> list[irt.Model]:
    return irt.load_model(folder / "diagnosed.toml").sample(draws)


def truth(folder: Path, _: int) -> list[irt.Model]:
    """Return our engine with the values and effects of the concealed one."""
    label = read_json(folder / "label.json")
    effects = tuple(
        irt.Effect(one["name"], {key: size for key, size in one.items() if key != "name"})
        for one in label["effects"]
    )
    values = np.array(label["values"])
    return [
        replace(model, parameters=named(values), effects=effects, posterior=()) for model in tuned(folder, 1)
    ]


def named(values: Array) -> dict[str, irt.Parameter]:
    """Return the five parameters by name."""
    return {name: irt.Parameter(float(one)) for name, one in zip(PARAMETERS, values, strict=True)}


#: Models of a controller, by name.
ARMS: dict[str, Arm] = {
    "tuned": tuned,
    "delayed": delayed,
    "randomised": randomised,
    "diagnosed": diagnosed,
    "truth": truth,
}
#: What controllers are tried at, and who makes them, in the order of the page.
TASKS: dict[str, tuple[str, Callable[..., Controller | Driver]]] = {
    "bare": ("bare", planner),
    "cyberrunner-easy": ("cyberrunner-easy", planner),
    "bare-policy": ("bare", policy),
}
POLICIES = frozenset(task for task, (_, make) in TASKS.items() if make is policy)


def errors(folder: Path, number: int) -> dict[str, float]:
    """Return the mean absolute error [board edges] of each arm on four runs held out, without noise."""
    setting, _ = drawn(number)
    knobs = setting.knobs[RECORDINGS:]
    seen = setting.simulate(read_json(folder / "label.json")["effects"], knobs)
    lasting = np.full(knobs.shape[1], setting.values[3] * SUBSTEP_S)
    return {
        arm: float(
            np.mean(
                [
                    np.abs(irt.rollouts(one, knobs, durations=lasting) - seen).mean()
                    for one in models(folder, DRAWS)
                ]
            )
        )
        for arm, models in ARMS.items()
    }


def travel(label: dict[str, Any], controller: Controller | Driver, task: Task) -> list[dict[str, Any]]:
    """Lead marbles along a path of the concealed rig, one for each seed; return how they ended."""
    seeds = np.arange(SEEDS)
    randoms = [np.random.default_rng([SEED, seed]) for seed in range(SEEDS)]
    start = task.start + np.array([random.uniform(-START_M, START_M, 2) for random in randoms])
    world = Live(np.array(label["values"]), label["effects"], start, seeds, task.maze)
    at = passed(task.points, start, np.zeros(SEEDS, dtype=np.int64))
    best, since = at.copy(), np.zeros(SEEDS, dtype=np.int64)
    beside = np.zeros(SEEDS)
    runs: list[dict[str, Any]] = [{} for _ in seeds]
    for row in range(1, round(MOST_S / world.row_s) + 1):
        noise = label["noise"] * np.array([random.normal(size=2) for random in randoms])
        world.play(controller.act(world.see() + noise))
        at = passed(task.points, world.places, at)
        since = np.where(at > best, row, since)
        best = np.maximum(best, at)
        beside += [np.linalg.norm(task.points - place, axis=1).min() for place in world.places]
        arrived, stuck = task.arrived(at), (row - since) * world.row_s > STUCK_S
        over = row == round(MOST_S / world.row_s)
        for seed in np.flatnonzero(world.fallen | arrived | stuck | over):
            if not runs[seed]:
                runs[seed] = {
                    "ended": "fell" if world.fallen[seed] else "arrived" if arrived[seed] else "stuck",
                    "progress": float(task.share(best)[seed]),
                    "seconds": row * world.row_s,
                    "beside_mm": float(1e3 * beside[seed] / row),
                }
        if all(runs):
            break
    return runs


if __name__ == "__main__":
    report_errors("transfer.py")
    main()
