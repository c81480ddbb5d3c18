"""A small concealed world that speaks the protocol: rapier's rollouts of a few rows, under noise.

    python fake_world.py [LOST...]

LOST are runs that its tracker cannot read, each as "index/name": 1/train-2.
"""

from __future__ import annotations

import io
import json
import sys
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from irt.engine import rollouts
from irt.recording import Recording, load_commands, save_recording

ROWS, TRAIN, TEST = 50, 3, 2
NOISE = 1e-3
TRUTH = {
    "gear_x": 0.06,
    "gear_y": 0.05,
    "rolling_friction": 4e-4,
    "time_scale": 15.0,
    "observation_scale": 1.03,
}
HIDDEN: dict[str, list[dict[str, Any]]] = {
    "none": [],
    "outliers": [],
    "single": [{"name": "parallax", "height_m_per_rad": 0.5}],
    "pair": [{"name": "parallax", "height_m_per_rad": 0.5}, {"name": "viscous_drag", "rate_per_s": 0.8}],
    "triple": [
        {"name": "parallax", "height_m_per_rad": 0.5},
        {"name": "viscous_drag", "rate_per_s": 0.8},
        {"name": "camera_rotation", "angle_rad": 0.1},
    ],
    "unlisted": [{"name": "cross_coupling", "angle_rad": 0.2}],
}


def make(index: int, kind: str, folder: str, seed: int, lost: Collection[str] = ()) -> dict[str, Any]:
    """Write a rig's training recordings; return its label."""
    random = np.random.default_rng(seed)
    knobs = np.array([drive(random) for _ in range(TRAIN + TEST)])
    clean = rollouts(
        np.tile(list(TRUTH.values()), (len(knobs), 1)),
        knobs,
        engine="rapier",
        effects=HIDDEN[kind],
        threads=1,
    )
    seen = clean + NOISE * random.standard_normal(clean.shape)
    Path(folder).mkdir(parents=True, exist_ok=True)
    names = [f"train-{i + 1}" for i in range(TRAIN)] + [f"test-{i + 1}" for i in range(TEST)]
    texts = {}
    for name, commands, marble in zip(names, knobs, seen, strict=True):
        csv = Recording(name, Path(name), commands, marble).to_csv()
        texts[name] = without_marble(csv) if name in lost else csv
    for name in names[:TRAIN]:
        (Path(folder) / f"{name}.csv").write_text(texts[name])
    (Path(folder) / "rig.toml").write_text("[board]\nedge_x_m = 0.276\nedge_y_m = 0.231\n")
    hidden = [one["name"] for one in HIDDEN[kind]]
    kinds: Any = {
        "single": hidden[:1] and hidden[0],
        "pair": hidden,
        "triple": hidden,
        "unlisted": "unlisted_twist",
    }.get(kind, kind)
    label = {
        "kind": kinds,
        "truth": {**TRUTH, "effects": HIDDEN[kind]},
        "sigma": NOISE,
        "noise": "white",
        "signal": 0.01,
        "through_camera": False,
        "lost": dict.fromkeys(lost, "two marbles move on the board"),
        "tests": {
            name: {"csv": texts[name], "clean": path.tolist()}
            for name, path in zip(names[TRAIN:], clean[TRAIN:], strict=True)
        },
    }
    return {"made": Path(folder).name, "label": label}


def without_marble(csv: str) -> str:
    """Return a recording with empty cells where the marble would be."""
    header, *rows = csv.splitlines()
    return "\n".join([header, *(f"{row.rsplit(',', 2)[0]},," for row in rows)]) + "\n"


def record(index: int, kind: str, seed: int, csv: str) -> dict[str, Any]:
    """Play further commands (CSV, a start in row 0) on an existing rig; return the tracked run."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "next.csv"
        path.write_text(csv)
        commands = load_commands(path)
        path = Path(place) / "seen.csv"
        clean = rollouts(
            [list(TRUTH.values())],
            commands.knobs,
            engine="rapier",
            effects=HIDDEN[kind],
            start=commands.start,
            threads=1,
        )[0]
        noise = NOISE * np.random.default_rng([seed, index]).standard_normal(clean.shape)
        save_recording(path, commands.knobs, clean + noise)
        return {"csv": path.read_text()}


def drive(random: np.random.Generator) -> np.ndarray:
    """Draw commands (ROWS, 2) [rad]: sums of sines."""
    time = np.arange(ROWS)[:, None, None] / ROWS
    waves = np.sin(2 * np.pi * (time * random.uniform(0.7, 4.0, (2, 3)) + random.random((2, 3))))
    return (waves * random.uniform(0.01, 0.05, (2, 3))).sum(axis=2)


def main(words: Sequence[str], requests: io.TextIOBase | Any = sys.stdin) -> None:
    """Answer requests after a greeting, as libraries print it."""
    print("fake world, built today", flush=True)
    for line in requests:
        request = json.loads(line)
        if "record" in request:
            answer = record(**request["record"])
        else:
            asked = request["make"]
            mine = f"{asked['index']}/"
            answer = make(**asked, lost=[one.removeprefix(mine) for one in words if one.startswith(mine)])
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
