"""Make rigs with hidden physics whose marble is moved by another engine, for `benches/diagnosis.py`.

    .venv/bin/pip install drake sapien dartpy
    .venv/bin/python benches/engine_rigs.py drake concealed --seed 1 --jobs 2
    OMP_NUM_THREADS=1 .venv/bin/python benches/diagnosis.py concealed --out diagnosed --jobs 2

The hidden physics is that of `irt prove`. Nothing in this project was made with these engines' contacts in
mind (`benches/other_engines`). `rig.toml` says that rims give back nothing, so an answer may name
wall_restitution or not. Before any rig is made, marbles on slopes must roll as theory says.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import multiprocessing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import irt
from irt.files import write_atomic
from irt.proof.pybullet_world import spec
from irt.proof.pybullet_world.engine import STEP_S, Base, Engine, Rolling, Start
from irt.proof.pybullet_world.physics import GRAVITY
from irt.proof.pybullet_world.record import record

#: Engines by name, each a module of `other_engines` with a function `engine`.
ENGINES = ("drake", "physx", "dart")
#: Kinds of rigs in the order in which they are made, again and again.
KINDS = ("none", "single", "single", "pair", "none", "single", "unlisted", "triple")


def main() -> None:
    """Make the rigs and their labels."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("engine", choices=ENGINES)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--dissipation", type=float, help="of Drake's rim [s/m]")
    args = parser.parse_args()
    rim = () if args.dissipation is None else (args.dissipation,)
    check(engine(args.engine, rim))
    args.out.mkdir(parents=True, exist_ok=True)
    labels = {}
    with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
        made = partial(make, args.out, args.seed, args.engine, rim)
        for name, label in pool.imap(made, range(args.rigs)):
            labels[name] = label
            print(name, label["kind"], flush=True)
            write_atomic(args.out / "labels.json", json.dumps(labels, indent=1))


def engine(name: str, rim: tuple[float, ...]) -> Engine:
    """Return what moves marbles in an engine, whose rim may be another than its usual one."""
    found: Engine = importlib.import_module(f"other_engines.{name}").engine(*rim)
    return found


def check(by: Engine) -> None:
    """Raise an error unless a marble rolls down slopes as a sphere does, and rests where it should.

    Raises
    ------
    RuntimeError
        If it does not.
    """
    friction, steps = 0.004, 960
    for slope in (0.003, 0.02, 0.05):
        base, start = Base(0.1, 0.1, friction, 20.0, 1.0), Start((-0.12, 0.0), (0.0, slope))
        with by.body(base, start, []) as body:
            rolling = Rolling(body, base, start, [])
            rolling.go(np.tile(start.tilt, (steps, 1)))
        path = rolling.path()
        pull = 5.0 / 7.0 * GRAVITY * max(math.sin(slope) - friction, 0.0)
        # Away from the start, where the contact settles.
        speeds = np.diff(path[:, 0])[[100, 400]] / STEP_S
        found = float(np.diff(speeds)[0]) / (300 * STEP_S)
        if abs(found - pull) > 1e-3 * max(pull, 0.1):
            raise RuntimeError(
                f"a marble on a slope of {slope} accelerates by {found:.5f}, not {pull:.5f} m/s^2"
            )


def make(out: Path, seed: int, by: str, rim: tuple[float, ...], index: int) -> tuple[str, dict[str, Any]]:
    """Write the recordings of a rig; return its name and label."""
    spec.ENGINES[by] = engine(by, rim)
    name = f"{by}-{seed}-{index:03d}"
    random, kind = np.random.default_rng([seed, index]), KINDS[index % len(KINDS)]
    drawn = spec.draw(random, kind, name, [], through_camera=False, engine=by)
    recorded = record(drawn)
    recorded.write(out / name)
    label = recorded.label()
    tests = label.pop("tests")
    for test, one in tests.items():
        write_atomic(out / name / f"{test}.csv", one["csv"])
    rig = irt.load_rig(out / name)
    trained = tuple(one for one in rig.recordings if one.name not in tests)
    held_out = [one for one in rig.recordings if one.name in tests]
    base = irt.tune(replace(rig, recordings=trained), threads=1).model
    missed = [np.nanmean(np.abs(one.marble - np.array(tests[one.name]["clean"]))) for one in held_out]
    label["base"], label["oracle"] = float(irt.evaluate(base, held_out).mae), float(np.mean(missed))
    label["left_over"] = [{"name": "wall_restitution"}]
    beyond = label["truth"].pop("out_of_catalogue")
    return name, label if beyond is None else {**label, "beyond": beyond}


if __name__ == "__main__":
    main()
