"""Does a diagnosis pay on a controller's return? Controllers from fitted models, tried on concealed rigs.

    .venv/bin/python benches/transfer.py transfer --rigs 10 --page docs/transfer.md

A rig of MuJoCo hides the effects of one of `KINDS`. From eight recordings of it come five tuned parameters, the
same spread widely, and the posterior of a diagnosis. The model-predictive controller of `examples/mpc.py` is made
on each, and on the truth for reference, and leads marbles along the path of the bare board and of the labyrinth
with eight holes of the concealed rig. All that is made is kept in the folder; a run that was stopped goes on.
Needs the extra mujoco.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import irt
import mujoco_world
from hide_effects import Setting
from irt.catalogue import effect
from irt.engine import SUBSTEP_S
from irt.files import write_atomic

Array = NDArray[np.float64]

#: Recordings of a rig, and the seed of the first.
RECORDINGS, SEED = 8, 326
#: Sizes of the hidden effects are drawn evenly between these, and of either sign where the catalogue has both.
SIZES: dict[str, dict[str, tuple[float, float]]] = {
    "delay": {"delay_s": (0.1, 0.25)},
    "lag": {"time_constant_s": (0.1, 0.25)},
    "second_order_lag": {"time_constant_s": (0.08, 0.15), "damping_ratio": (0.4, 0.8)},
    "latency": {"latency_s": (0.1, 0.2)},
    "backlash": {"width_x_rad": (0.02, 0.06), "width_y_rad": (0.02, 0.06)},
    "dead_band": {"half_width_rad": (0.01, 0.03)},
    "tilt_bias": {"bias_x_rad": (0.001, 0.0025), "bias_y_rad": (0.001, 0.0025)},
    "gear_matrix": {"x_from_y": (0.05, 0.1), "y_from_x": (0.05, 0.1)},
    "static_friction": {"ratio": (2.0, 4.0)},
}
#: What rigs hide, in turn.
KINDS: tuple[tuple[str, ...], ...] = (
    ("delay", "backlash", "tilt_bias"),
    ("lag", "tilt_bias"),
    ("backlash", "latency"),
    ("delay", "gear_matrix"),
    ("second_order_lag", "backlash"),
    ("delay",),
    ("dead_band", "lag"),
    ("backlash", "static_friction"),
    ("tilt_bias", "latency"),
    ("delay", "second_order_lag", "tilt_bias"),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, nargs="+", default=list(range(len(KINDS))))
    args = parser.parse_args()
    for number in args.rigs:
        rig = args.out / f"rig-{number}"
        began = time.perf_counter()
        label = made(rig / "label.json", lambda rig=rig, number=number: record(rig, number))
        fitted(rig)
        print(number, label, time.perf_counter() - began, flush=True)


def record(folder: Path, number: int) -> dict[str, Any]:
    """Record a concealed rig into a folder; return its label."""
    random = np.random.default_rng([SEED, number])
    drawn = Setting.drawn(mujoco_world, random)
    # Rows of 50 to 67 ms, as of a camera and servos at 15 to 20 Hz; the scale of the pictures is known.
    values = np.array([*drawn.values[:3], float(random.integers(12, 17)), 1.0])
    setting = replace(drawn, values=values, knobs=drawn.knobs[:RECORDINGS])
    effects = [hidden(name, random) for name in KINDS[number % len(KINDS)]]
    seen = setting.simulate(effects) + setting.noise * random.normal(size=setting.knobs.shape)
    stamps = values[3] * SUBSTEP_S * np.arange(seen.shape[1])
    folder.mkdir(parents=True, exist_ok=True)
    for index, one in enumerate(seen):
        irt.save_recording(folder / f"run-{index + 1}.csv", setting.knobs[index], one, stamps)
    write_atomic(folder / "rig.toml", "[parameters]\nobservation_scale = { range = [0.99, 1.01] }\n")
    return {"values": values.tolist(), "effects": effects, "noise": setting.noise}


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
    return json.loads(path.read_text(encoding="utf-8"))


def fitted(folder: Path) -> tuple[irt.Model, irt.Model]:
    """Return what tuning and a diagnosis make of a rig's recordings."""
    paths = [folder / "tuned.toml", folder / "diagnosed.toml"]
    for path, fit in zip(paths, (irt.tune, irt.diagnose), strict=True):
        if not path.exists():
            irt.save_model(path, fit(irt.load_rig(folder), threads=1).model)
    tuned, diagnosed = map(irt.load_model, paths)
    return tuned, diagnosed


if __name__ == "__main__":
    main()
