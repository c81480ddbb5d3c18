"""Make rigs with hidden effects for `benches/diagnosis.py`, with an engine that no fit uses.

    .venv/bin/python benches/hide_effects.py hidden --rigs 100 --nulls 0.3 --effects 1 1 2 --seed 1
    .venv/bin/python benches/hide_effects.py crowded --engine mujoco --effects 3 4 --push 0.05 0.1 --left-over

A fit runs on the rolling engine; recordings are simulated by another one (rapier in 3-D, or MuJoCo), so that
the engines differ in null rigs too. Magnitudes are drawn log-uniformly from the smallest detectable size to
the end of the catalogue's range; noise is 0.2 to 0.6 mm, mostly white. ``--push`` turns the board by
unrecorded white noise; ``--left-over`` makes it uneven and sticky.

The label's `oracle` is the error of a simulation with the hidden effects, from the tracked row 0 like every
prediction, without the push and the left-over physics.
"""

from __future__ import annotations

import argparse
import importlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import irt
from irt.catalogue import effect, hypothetical
from irt.files import write_atomic
from irt.fitting.effect_size import size_of
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

ROWS, TRAIN, TEST = 120, 8, 4
#: Long edge of the board [m].
EDGE_M = 0.276
#: Smallest size as a share of the largest, and smallest change of the path by an effect [noises].
SMALLEST, SHOWS = 0.05, 3.0
#: First seed of random effects in recordings, such as delay jitter; seeds of fits count from 0.
DRAWS = 1_000_000
#: Kinds of tracker noise with their weights: white; heavy-tailed, with a tenth of the samples five times as
#: large; coloured, with an autocorrelation of a half.
NOISE = {"white": 0.6, "heavy": 0.2, "coloured": 0.2}
#: Standard deviation of each of 14 modes of an uneven board [rad]: together about half of the slope that
#: holds a marble; with ten times as much the truth explains nothing.
SLOPE = 1e-4
#: Ratio of the tilt to start to the tilt to roll on, for a sticky board.
STICKY = (1.5, 3.0)


class World(Protocol):
    """Interface of a simulator module."""

    KNOWN: frozenset[str]
    """Names of the effects that it can simulate."""
    CHOICES: dict[str, dict[str, float]]
    """By effect and parameter, the values of choices that it can simulate."""

    def simulate(
        self,
        values: Array,
        knobs: Array,
        effects: Sequence[dict[str, Any]],
        *,
        start: Array | None,
        seeds: NDArray[np.int64],
    ) -> Array:
        """Return observed positions (n, rows, 2) [board edges] of parameters (5,) under knobs (n, rows, 2).

        `start` (n, 2) are observed positions in row 0, by default the centre; `seeds` (n,) are for random
        effects.
        """


@dataclass(frozen=True)
class Recipe:
    """Hidden physics of a rig.

    Attributes
    ----------
    engine : str
        The simulator, "rapier" or "mujoco".
    effects : int
        Number of simultaneous effects.
    push : float
        Standard deviation of unrecorded turns of the knobs, independent in each row, as a share of a run's
        largest command.
    left_over : bool
        Whether the board is also uneven and sticky.
    controlled : bool
        Whether commands come from a controller that sees the marble; with MuJoCo only.
    """

    engine: str = "rapier"
    effects: int = 1
    push: float = 0.0
    left_over: bool = False
    controlled: bool = False


def main() -> None:
    """Draw rigs and write them, with their labels."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--engine", choices=("rapier", "mujoco"), default="rapier")
    parser.add_argument("--nulls", type=float, default=0.3, help="share of rigs with nothing hidden")
    parser.add_argument(
        "--effects", type=int, nargs="+", default=[1, 1, 2], help="effects at once: the rigs take turns"
    )
    parser.add_argument(
        "--push", type=float, nargs="+", default=[0.0], help="random push, of the drive: the rigs take turns"
    )
    parser.add_argument("--left-over", action="store_true", help="uneven and sticky boards")
    parser.add_argument("--controlled", action="store_true", help="commands of a controller (MuJoCo)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    if args.controlled and args.engine != "mujoco":
        parser.error("--controlled needs --engine mujoco")
    labels = read_labels(args.out)
    common = Recipe(args.engine, left_over=args.left_over, controlled=args.controlled)
    for index, recipe in enumerate(recipes(args.rigs, args.nulls, common, args.effects, args.push)):
        name = f"own-{args.seed}-{index:03d}"
        if name not in labels:
            labels[name] = hide(args.out / name, recipe, np.random.default_rng([args.seed, index]))
            write_labels(args.out, labels)
        print(name, labels[name]["kind"], flush=True)


def recipes(
    rigs: int, nulls: float, common: Recipe, effects: Sequence[int], push: Sequence[float]
) -> list[Recipe]:
    """Return the hidden physics of each rig, cycling through numbers of effects and pushes.

    Every 1/nulls-th rig has none.
    """
    empty = [int((index + 1) * nulls) > int(index * nulls) for index in range(rigs)]
    return [
        replace(
            common,
            effects=0 if empty[index] else effects[index % len(effects)],
            # Each number of effects meets each push.
            push=push[index // len(effects) % len(push)],
        )
        for index in range(rigs)
    ]


def read_labels(rigs: Path) -> dict[str, Any]:
    """Return the labels of existing rigs in a folder, by name."""
    path = rigs / "labels.json"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return found


def write_labels(rigs: Path, labels: dict[str, Any]) -> None:
    """Write the labels of the rigs in a folder."""
    write_atomic(rigs / "labels.json", json.dumps(labels, indent=1))


@dataclass(frozen=True, eq=False)
class Setting:
    """A rig without hidden physics, and its commands.

    Attributes
    ----------
    world : World
        The simulator.
    values : (5,) array
        The parameters.
    knobs : (runs, rows, 2) array
        Recorded commands [rad].
    noise : float
        Standard deviation of the tracker [board edges].
    except_for : frozenset of str
        Effects that cannot be simulated.
    """

    world: World
    values: Array
    knobs: Array
    noise: float
    except_for: frozenset[str] = frozenset()

    @classmethod
    def drawn(cls, world: World, random: np.random.Generator) -> Setting:
        """Draw one."""
        values = np.array(
            [
                *random.uniform(0.04, 0.1, 2),
                random.uniform(3e-4, 9e-4),
                float(random.integers(14, 26)),
                random.uniform(0.95, 1.05),
            ]
        )
        knobs = np.array([_drive(random, random.uniform(0.06, 0.15)) for _ in range(TRAIN + TEST)])
        return cls(world, values, knobs, float(random.uniform(0.2e-3, 0.6e-3)) / EDGE_M)

    def simulate(
        self, effects: Sequence[dict[str, Any]], knobs: Array | None = None, start: Array | None = None
    ) -> Array:
        """Return paths (n, rows, 2) [board edges], under other commands if given."""
        knobs = self.knobs if knobs is None else knobs
        seeds = DRAWS + np.arange(len(knobs))
        return self.world.simulate(self.values, knobs, effects, start=start, seeds=seeds)

    def effects(
        self, count: int, random: np.random.Generator
    ) -> tuple[list[dict[str, Any]], dict[str, float]]:
        """Draw effects, with the change of the path by each [noises]; fewer if too few are detectable."""
        names = [info.name for info in hypothetical() if info.name in self.world.KNOWN - self.except_for]
        plain = self.simulate([])
        effects: list[dict[str, Any]] = []
        moves: dict[str, float] = {}
        for _ in range(20 * count):
            name = str(random.choice([name for name in names if name not in moves]))
            one = {**_drawn(name, random), **self.world.CHOICES.get(name, {})}
            moved = float(np.abs(self.simulate([one]) - plain).mean()) / self.noise
            if moved > SHOWS:
                effects.append(one)
                moves[name] = moved
            if len(effects) == count:
                break
        return effects, moves


def hide(folder: Path, recipe: Recipe, random: np.random.Generator) -> dict[str, Any]:
    """Write one rig; return its label."""
    folder.mkdir(parents=True, exist_ok=True)
    world: World = importlib.import_module(f"{recipe.engine}_world")
    while True:
        setting = Setting.drawn(world, random)
        if recipe.controlled:
            setting = _controlled(setting, [], np.zeros_like(setting.knobs), 0.0, random)
        effects, moves = setting.effects(recipe.effects, random)
        if len(effects) == recipe.effects:
            break
    rest = _left_over(random, effects) if recipe.left_over else []
    largest = np.abs(setting.knobs).max(axis=(1, 2), keepdims=True)
    turns = recipe.push * largest * random.normal(size=setting.knobs.shape)
    kind = str(random.choice(list(NOISE), p=list(NOISE.values())))
    noise = setting.noise * _noise(kind, random)
    if recipe.controlled:
        setting = _controlled(setting, [*effects, *rest], noise, turns, random)
    paths = setting.simulate([*effects, *rest], setting.knobs + turns) + noise
    for index, seen in enumerate(paths):
        name = f"train-{index + 1}" if index < TRAIN else f"test-{index + 1 - TRAIN}"
        _write(folder / f"{name}.csv", setting.knobs[index], seen)
    write_atomic(folder / "rig.toml", f"[board]\nedge_x_m = {EDGE_M}\nedge_y_m = 0.231\n")
    rig = irt.load_rig(folder)
    tests = [one for one in rig.recordings if one.name.startswith("test-")]
    training = tuple(one for one in rig.recordings if one.name.startswith("train-"))
    base = irt.tune(replace(rig, recordings=training), threads=1).model
    seen = np.array([test.marble for test in tests])
    known = setting.simulate(effects, setting.knobs[TRAIN:], start=seen[:, 0])
    names = [one["name"] for one in effects]
    return {
        "kind": names if len(names) > 1 else names[0] if names else "none",
        "truth": {**dict(zip(PARAMETERS, setting.values.tolist(), strict=True)), "effects": effects},
        "moves": moves,
        "engine": recipe.engine,
        "push": recipe.push,
        "left_over": rest,
        "sigma": setting.noise,
        "noise": kind,
        "base": float(irt.evaluate(base, tests).mae),
        "oracle": float(np.abs(known - seen).mean()),
    }


def _controlled(
    setting: Setting, effects: Sequence[dict[str, Any]], noise: Array, turns: Array | float, random: Any
) -> Setting:
    """Return a setting under the commands of a controller, which sees the marble with this noise."""
    seeds, turns = DRAWS + np.arange(len(noise)), np.broadcast_to(turns, noise.shape)
    command = importlib.import_module("controlled").commands
    knobs = command(setting.values, effects, noise, turns, seeds=seeds, random=random)
    # The controller's world has one clock.
    return replace(setting, knobs=knobs, except_for=frozenset({"clock_drift"}))


def _left_over(random: np.random.Generator, effects: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Draw an uneven and sticky board, except physics that is hidden anyway."""
    slopes = {one.name: float(random.normal(scale=SLOPE)) for one in effect("slope_map").parameters}
    rest = [
        {"name": "slope_map", **slopes},
        {"name": "static_friction", "ratio": float(random.uniform(*STICKY))},
    ]
    hidden = {one["name"] for one in effects}
    return [one for one in rest if one["name"] not in hidden]


def _noise(kind: str, random: np.random.Generator) -> Array:
    """Draw tracker noise (TRAIN + TEST, ROWS, 2) of unit standard deviation without its outliers."""
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
            command = np.sum(waves, axis=0)
        elif kind == 1:
            command = np.repeat(random.uniform(-1.0, 1.0, ROWS), random.integers(5, 20))[:ROWS]
        elif kind == 2:
            command = np.sin(2 * np.pi * (0.5 + 3.0 * rows / ROWS) * rows / ROWS)
        else:
            command = random.choice([-1.0, 1.0]) * np.sin(2 * np.pi * random.uniform(1.0, 3.0) * rows / ROWS)
        command = command * np.minimum(1.0, rows / 4.0)
        return np.asarray(amplitude * command / max(np.abs(command).max(), 1e-9))

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
