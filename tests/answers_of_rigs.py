"""The answers of ten rigs, as JSON: three that the package bundles, and seven that are simulated.

``python answers_of_rigs.py [--threads N] [--without-extras] [RIG ...]``
"""

from __future__ import annotations

import argparse
import importlib.abc
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from irt.cli.demo import data
from irt.diagnosis import diagnose
from irt.engine import SUBSTEP_S, rollouts
from irt.recording import Recording
from irt.rig import RANGES, Board, Marble, Rig, load_rig
from irt.tuning import tune

#: Distributions that only extras install; ``irt`` has to give the same answers without them.
EXTRAS = ("cv2", "cyclonedds", "gymnasium", "mcap", "mujoco", "pybullet", "pysindy", "ray")
EXTRAS += ("rosbags", "sbi", "torch")

#: Bundled rigs, which are tuned.
BUNDLED = ("demo-rig", "labyrinth", "labyrinth-heldout")

#: Simulated rigs, which are diagnosed: their effects. The two are too small here.
SIMULATED: dict[str, Sequence[Mapping[str, Any]]] = {
    "nothing missing": (),
    "parallax": ({"name": "parallax", "height_m_per_rad": 0.5},),
    "viscous drag": ({"name": "viscous_drag", "rate_per_s": 0.5},),
    "backlash": ({"name": "backlash", "width_x_rad": 0.02, "width_y_rad": 0.03},),
    "lag": ({"name": "lag", "time_constant_s": 0.1},),
    "tilt bias": ({"name": "tilt_bias", "bias_x_rad": 0.002, "bias_y_rad": -0.001},),
    "two": (
        {"name": "camera_rotation", "angle_rad": 0.05},
        {"name": "quadratic_drag", "coefficient_per_m": 3.0},
    ),
}

#: Gears, rolling friction, time scale, observation scale.
TRUTH = (0.06, 0.05, 4e-4, 15.0, 1.03)


class Missing(importlib.abc.MetaPathFinder):
    """Find none of the extras."""

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> None:
        if fullname.partition(".")[0] in EXTRAS:
            raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)


#: Rigs with stamps: without them rates, times and tilts are known only as well as the time scale.
STAMPED = ("viscous drag", "lag", "tilt bias")


def simulated(name: str, runs: int = 3, rows: int = 60) -> Rig:
    """Return a rig of `SIMULATED`."""
    effects, random = SIMULATED[name], np.random.default_rng(5)
    stamps = TRUTH[3] * SUBSTEP_S * np.arange(rows) if name in STAMPED else None
    recordings = []
    for index in range(runs):
        time = np.arange(rows)[:, None, None] / rows
        waves = np.sin(2 * np.pi * (time * random.uniform(0.7, 4.0, (2, 3)) + random.random((2, 3))))
        knobs = (waves * random.uniform(0.01, 0.05, (2, 3))).sum(axis=2)
        marble = rollouts([TRUTH], knobs, effects=effects)[0]
        marble = marble + 1e-3 * random.standard_normal(marble.shape)
        recordings.append(Recording(f"run-{index}", Path(f"run-{index}.csv"), knobs, marble, stamps))
    return Rig(Path("rig"), Board(), Marble(), "rest", dict(RANGES), tuple(recordings))


def digits(value: float | None) -> float | None:
    """Return a number to three digits."""
    return None if value is None else float(f"{value:.3g}")


def tuned(name: str, threads: int | None) -> dict[str, Any]:
    """Return what least squares find on a bundled rig."""
    found = tune(load_rig(data(name)), "least-squares", seed=5, threads=threads)
    parameters = found.model.parameters.items()
    values = {key: [digits(one) for one in (each.value, each.low, each.high)] for key, each in parameters}
    return {"parameters": values, "mae": digits(found.mae)}


def diagnosed(name: str, threads: int | None) -> dict[str, Any]:
    """Return what a diagnosis finds on a simulated rig."""
    return summary(diagnose(simulated(name), seed=5, threads=threads).as_dict())


def summary(answer: Mapping[str, Any]) -> dict[str, Any]:
    """Return verdict, names, intervals and held-out errors of a diagnosis."""
    effects = {
        effect["name"]: {
            key: [digits(one.get(field)) for field in ("value", "low", "high")]
            for key, one in effect["parameters"].items()
        }
        for effect in answer["effects"]
    }
    errors = {key: digits(answer["fit"][key]) for key in ("base_heldout_mae", "final_heldout_mae")}
    return {"verdict": answer["verdict"], "effects": effects, **errors}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--without-extras", action="store_true")
    parser.add_argument("rigs", nargs="*", default=[*BUNDLED, *SIMULATED])
    args = parser.parse_args()
    if args.without_extras:
        sys.meta_path.insert(0, Missing())
    answers = {name: (tuned if name in BUNDLED else diagnosed)(name, args.threads) for name in args.rigs}
    json.dump(answers, sys.stdout, indent=1)


if __name__ == "__main__":
    main()
