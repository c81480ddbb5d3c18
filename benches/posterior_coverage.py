"""Whether posteriors hold the truth as often as they say, on rigs that are simulated with known values.

    python benches/posterior_coverage.py --rigs 60 --method least-squares
    python benches/posterior_coverage.py --rigs 40 --method diagnose --engine rapier

Each rig has values drawn from the paper's ranges, an effect or none, four recordings of eight seconds, and a
tracker with white noise. A fit of it is sampled, and the table says for each parameter how often the middle
50 %, 80 % and 95 % of the draws hold the truth, with a 95 % interval of that share (Clopper and Pearson).
Effects' parameters count where the fit has the effect. Stamps are there unless `--unstamped`: then gears and
friction have no truth of their own, and what recordings fix of them counts in their place.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

import irt
from irt.engine import Engine
from irt.fitting.least_squares import least_squares

Array = NDArray[np.float64]
LEVELS = (0.5, 0.8, 0.95)
#: Rows of whole engine steps: no engine rounds them.
ROWS, STEP_S, NOISE = 100, 20.0 / 240.0, 0.001
#: The hidden effects, in turn, and the values that rigs draw from.
HIDDEN: tuple[dict[str, tuple[float, float]], ...] = (
    {},
    {"backlash.width_x_rad": (0.01, 0.04), "backlash.width_y_rad": (0.01, 0.04)},
    {"delay.delay_s": (0.05, 0.2)},
    {"lag.time_constant_s": (0.05, 0.2)},
    {"tilt_bias.bias_x_rad": (-0.001, 0.001), "tilt_bias.bias_y_rad": (-0.001, 0.001)},
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--method", choices=("least-squares", "diagnose"), default="least-squares")
    parser.add_argument("--engine", choices=get_args(Engine), default="rolling", help="of the truth")
    parser.add_argument("--draws", type=int, default=400)
    parser.add_argument("--unstamped", action="store_true")
    parser.add_argument("--out", type=Path, help="JSON with where each truth lies among the draws")
    args = parser.parse_args()
    ranks: dict[str, list[float]] = {}
    for seed in range(args.rigs):
        for name, rank in ranked(seed, args):
            ranks.setdefault(name, []).append(rank)
        if args.out:
            args.out.write_text(json.dumps(ranks))
    for line in table(ranks):
        print(line)


def ranked(seed: int, args: argparse.Namespace) -> Iterator[tuple[str, float]]:
    """Yield for each parameter which share of the draws lies below its truth."""
    rig, truth = simulated(seed, stamped=not args.unstamped, engine=args.engine)
    effects = [
        irt.Effect(name, {}) for name in dict.fromkeys(key.split(".")[0] for key in truth if "." in key)
    ]
    if args.method == "diagnose":
        model = irt.diagnose(rig, seed=seed, threads=1).model
    else:
        model = least_squares(rig, effects=effects, starts=4, seed=seed, threads=1).model
    drawn = [values(one) for one in model.sample(args.draws, seed)]
    for name in truth:
        of_name = np.array([one[name] for one in drawn if name in one])
        if len(of_name) < 0.5 * len(drawn) or np.ptp(of_name) == 0.0:
            continue
        yield name, float(np.mean(of_name < truth[name]))


def values(model: irt.Model) -> dict[str, float]:
    """Return all values of a model by name, and what recordings without stamps fix of them."""
    found = {name: one.value for name, one in model.parameters.items()}
    for effect in model.effects:
        found |= {f"{effect.name}.{name}": value for name, value in effect.parameters.items()}
    return with_fixed(found)


def with_fixed(found: dict[str, float]) -> dict[str, float]:
    square = found["time_scale"] ** 2
    fixed = {
        f"time_scale^2 {name}": square * found[name] for name in ("gear_x", "gear_y", "rolling_friction")
    }
    return {**found, **fixed}


def simulated(seed: int, *, stamped: bool, engine: Engine) -> tuple[irt.Rig, dict[str, float]]:
    """Return a rig and what it is made of, by name."""
    random = np.random.default_rng([7, seed])
    truth = {
        "gear_x": random.uniform(0.03, 0.08),
        "gear_y": random.uniform(0.03, 0.08),
        "rolling_friction": random.uniform(1e-4, 5e-4),
        "observation_scale": random.uniform(0.9, 1.1),
        "time_scale": STEP_S * 240.0,
    }
    hidden = {name: random.uniform(*ends) for name, ends in HIDDEN[seed % len(HIDDEN)].items()}
    effects: dict[str, dict[str, float]] = {}
    for key, value in hidden.items():
        effect, _, name = key.partition(".")
        effects.setdefault(effect, {})[name] = value
    five = [
        [truth[name] for name in ("gear_x", "gear_y", "rolling_friction", "time_scale", "observation_scale")]
    ]
    stamps = STEP_S * np.arange(ROWS)
    recordings = []
    for _ in range(4):
        knobs = sines(random)
        seen = irt.rollouts(
            np.array(five),
            knobs,
            effects=[{"name": name, **own} for name, own in effects.items()],
            durations=np.full(ROWS, STEP_S),
            engine=engine,
        )[0]
        seen = seen + NOISE * random.standard_normal(seen.shape)
        recordings.append(
            irt.Recording.from_arrays(commands=knobs, marble=seen, t=stamps if stamped else None)
        )
    truth |= hidden
    if not stamped:
        truth = with_fixed(truth)
        for name in ("gear_x", "gear_y", "rolling_friction", "time_scale"):
            del truth[name]
    return irt.Rig.from_recordings(recordings), truth


def sines(random: np.random.Generator) -> Array:
    """Return knobs (rows, 2) [rad] of four sines each."""
    time = np.arange(ROWS)[:, None]
    waves = [
        np.sin(2.0 * np.pi * time * random.uniform(0.01, 0.06, (1, 2)) + random.uniform(0.0, 6.3, (1, 2)))
        for _ in range(4)
    ]
    return np.asarray(0.04 * np.sum(waves, axis=0))


def table(ranks: dict[str, list[float]]) -> Iterator[str]:
    """Yield a line for each parameter, and one for all."""
    yield (
        "| parameter | n | "
        + " | ".join(f"{level:.0%}" for level in LEVELS)
        + " | 95 % interval of the last |"
    )
    yield "| --- | --- | --- | --- | --- | --- |"
    everything = [rank for own in ranks.values() for rank in own]
    for name, own in [*ranks.items(), ("all", everything)]:
        found = np.array(own)
        held = [int(np.sum(np.abs(found - 0.5) < 0.5 * level)) for level in LEVELS]
        count, last = len(own), held[-1]
        low = beta.ppf(0.025, last, count - last + 1) if last else 0.0
        high = beta.ppf(0.975, last + 1, count - last) if last < count else 1.0
        shares = " | ".join(f"{share / count:.0%}" for share in held)
        yield f"| {name} | {count} | {shares} | {low:.0%} to {high:.0%} |"


if __name__ == "__main__":
    main()
