"""Make rigs with hidden effects, as `benches/diagnosis.py` takes them, by the engine that no fit uses.

    .venv/bin/python benches/hide_effects.py hidden --rigs 100 --nulls 0.3 --seed 1

Recordings are simulated by rapier in 3-D; a fit runs on the rolling engine. So in a null rig the engines
differ too. Magnitudes are drawn log-uniformly from what shows at all to the end of the catalogue's range,
noise from 0.2 to 0.6 mm, most of it white; every third rig with an effect has two. The label's `oracle` is
the error of the truth itself, started from the row 0 that the tracker saw, as every prediction is.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import irt
from irt.catalogue import effect, hypothetical
from irt.diagnosis.case import Case
from irt.files import write_atomic
from irt.fitting.effect_size import size_of
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

ROWS, TRAIN, TEST = 120, 8, 4
#: Smallest size drawn, as a share of the largest, and what the marble has to miss its way by [noise].
SMALLEST, SHOWS = 0.05, 3.0
#: What recordings draw, delays that differ above all, is none of what a fit draws: that counts from 0.
DRAWS = 1_000_000
#: Kinds of tracker noise, and how often each is drawn: white; a tenth of its samples five times as large;
#: each sample carrying on half of the one before.
NOISE = {"white": 0.6, "heavy": 0.2, "coloured": 0.2}


def main() -> None:
    """Draw rigs and write them, with their labels."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--nulls", type=float, default=0.3, help="share of rigs with nothing hidden")
    parser.add_argument("--pairs", type=float, default=0.33, help="share of the others with two effects")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    labels = {}
    for index in range(args.rigs):
        random = np.random.default_rng([args.seed, index])
        name = f"own-{args.seed}-{index:03d}"
        labels[name] = hide(args.out / name, random, args.nulls, args.pairs)
        print(name, labels[name]["kind"], flush=True)
    write_atomic(args.out / "labels.json", json.dumps(labels, indent=1))


def hide(folder: Path, random: np.random.Generator, nulls: float, pairs: float) -> dict[str, Any]:
    """Write one rig; return its label."""
    folder.mkdir(parents=True, exist_ok=True)
    count = 0 if random.random() < nulls else 2 if random.random() < pairs else 1
    names = [info.name for info in hypothetical()]
    while True:
        values = np.array(
            [
                *random.uniform(0.04, 0.1, 2),
                random.uniform(3e-4, 9e-4),
                float(random.integers(14, 26)),
                random.uniform(0.95, 1.05),
            ]
        )
        knobs = np.array([_drive(random, random.uniform(0.06, 0.15)) for _ in range(TRAIN + TEST)])
        effects = [_drawn(str(name), random) for name in random.choice(names, count, replace=False)]
        noise = float(random.uniform(0.2e-3, 0.6e-3)) / 0.276
        plain = _simulated(values, knobs, [])
        paths = _simulated(values, knobs, effects)
        alone = [_simulated(values, knobs, [one]) for one in effects]
        if all(float(np.abs(one - plain).mean()) > SHOWS * noise for one in alone):
            break
    kind = str(random.choice(list(NOISE), p=list(NOISE.values())))
    for index, seen in enumerate(paths + noise * _noise(kind, random)):
        name = f"train-{index + 1}" if index < TRAIN else f"test-{index + 1 - TRAIN}"
        _write(folder / f"{name}.csv", knobs[index], seen)
    write_atomic(folder / "rig.toml", "[board]\nedge_x_m = 0.276\nedge_y_m = 0.231\n")
    tests = [irt.load_recording(path) for path in sorted(folder.glob("test-*.csv"))]
    seen = np.array([test.marble for test in tests])
    known = _simulated(values, knobs[TRAIN:], effects, start=seen[:, 0])
    return {
        "kind": [one["name"] for one in effects] if count == 2 else effects[0]["name"] if count else "none",
        "truth": {**dict(zip(PARAMETERS, values.tolist(), strict=True)), "effects": effects},
        "sigma": noise,
        "noise": kind,
        "base": _base(folder, tests),
        "oracle": float(np.abs(known - seen).mean()),
    }


def _base(folder: Path, tests: list[irt.Recording]) -> float:
    """Return the error on the test runs of five parameters fitted to the training runs."""
    rig = irt.load_rig(folder)
    training = tuple(one for one in rig.recordings if one.name.startswith("train-"))
    case = Case.of(irt.Rig(rig.path, rig.board, rig.marble, rig.start, rig.ranges, training))
    return float(irt.evaluate(case.model(case.fit()), tests).mae)


def _simulated(
    values: Array, knobs: Array, effects: list[dict[str, Any]], start: Array | None = None
) -> Array:
    return irt.rollouts(
        np.tile(values, (len(knobs), 1)),
        knobs,
        engine="rapier",
        effects=effects,
        start=start,
        seed=DRAWS + np.arange(len(knobs)),
    )


def _noise(kind: str, random: np.random.Generator) -> Array:
    """Draw tracker noise (TRAIN + TEST, ROWS, 2) of unit standard deviation, but for its outliers."""
    drawn = random.normal(size=(TRAIN + TEST, ROWS, 2))
    if kind == "heavy":
        drawn[random.random(drawn.shape) < 0.1] *= 5.0
    if kind == "coloured":
        for row in range(1, ROWS):
            drawn[:, row] = 0.5 * drawn[:, row - 1] + np.sqrt(0.75) * drawn[:, row]
    return drawn


def _drawn(name: str, random: np.random.Generator) -> dict[str, Any]:
    """Draw an effect: its size log-uniformly, everything else over its range."""
    drawn: dict[str, Any] = {"name": name}
    parameters = effect(name).required
    size = size_of(name)
    for index, one in enumerate(parameters):
        beside = size is not None and index != size and len(parameters) > 1
        if one.is_choice or beside or not np.isfinite(one.neutral):
            drawn[one.name] = one.drawn(random)
        else:
            end = one.high if random.random() < (one.high - one.neutral) / (one.high - one.low) else one.low
            drawn[one.name] = float(one.neutral + (end - one.neutral) * SMALLEST ** random.random())
    return drawn


def _drive(random: np.random.Generator, amplitude: float) -> Array:
    """Draw commands (ROWS, 2) [rad]: sums of sines, steps, holds or a chirp, on one axis or on both."""
    rows = np.arange(ROWS)

    def axis() -> Array:
        kind = random.integers(4)
        if kind == 0:
            waves = [
                random.normal()
                * np.sin(2 * np.pi * random.uniform(0.5, 6.0) * rows / ROWS + random.uniform(0, 6))
                for _ in range(4)
            ]
            told = np.sum(waves, axis=0)
        elif kind == 1:
            told = np.repeat(random.uniform(-1.0, 1.0, ROWS), random.integers(5, 20))[:ROWS]
        elif kind == 2:
            told = np.sin(2 * np.pi * (0.5 + 3.0 * rows / ROWS) * rows / ROWS)
        else:
            told = random.choice([-1.0, 1.0]) * np.sin(2 * np.pi * random.uniform(1.0, 3.0) * rows / ROWS)
        told = told * np.minimum(1.0, rows / 4.0)
        return np.asarray(amplitude * told / max(np.abs(told).max(), 1e-9))

    quiet = random.random(2) < [0.15, 0.15]
    return np.stack(
        [axis() * (0.0 if quiet[0] and not quiet[1] else 1.0), axis() * (0.0 if quiet[1] else 1.0)], 1
    )


def _write(path: Path, knobs: Array, seen: Array) -> None:
    lines = ["step,knob_x_rad,knob_y_rad,marble_x,marble_y"]
    lines += [
        f"{row},{knob[0]:.6f},{knob[1]:.6f},{place[0]:.6f},{place[1]:.6f}"
        for row, (knob, place) in enumerate(zip(knobs, seen, strict=True))
    ]
    write_atomic(path, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
