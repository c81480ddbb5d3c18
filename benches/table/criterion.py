"""Criterion's results: a table of all of them, and what each effect costs over the base rollout."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from table.words import Measured, duration, markdown, natural_order, rate, significant

#: The group of benchmarks that compares effects, and its benchmark without any.
EFFECTS, BASE = "effects", "base"


@dataclass(frozen=True)
class Timing:
    """One benchmark's samples, summed up."""

    name: str
    time: Measured
    """Of one iteration [ns]."""
    substeps: int | None
    """Substeps simulated in one iteration, where the benchmark counts them."""

    def row(self) -> list[str]:
        """Return this benchmark's row of the table."""
        speed = rate(1e9 * self.substeps / self.time.median) if self.substeps else ""
        return [self.name, duration(self.time.median / 1e9), self.time.percent, speed]


def read_timings(criterion: Path) -> list[Timing]:
    """Read every benchmark's latest result under criterion's output folder, sorted by name."""
    timings = []
    for path in criterion.glob("**/new/benchmark.json"):
        benchmark = json.loads(path.read_text(encoding="utf-8"))
        estimates = json.loads(path.with_name("estimates.json").read_text(encoding="utf-8"))
        # A robust standard deviation, as criterion itself scales its median absolute deviation.
        time = Measured(estimates["median"]["point_estimate"], estimates["median_abs_dev"]["point_estimate"])
        substeps = (benchmark["throughput"] or {}).get("Elements")
        timings.append(Timing(benchmark["full_id"], time, substeps))
    return sorted(timings, key=lambda timing: natural_order(timing.name))


def engine_table(timings: Sequence[Timing], where: str) -> str | None:
    """Return the table of all benchmarks but those of effects, or None if there are none."""
    rows = [timing.row() for timing in timings if not timing.name.startswith(f"{EFFECTS}/")]
    if not rows:
        return None
    table = markdown(["benchmark", "median", "spread", "substeps/s"], rows)
    return f"{table}\n\nMeasured on {where}. Spread: robust standard deviation of the samples."


def effects_table(timings: Sequence[Timing], where: str) -> str | None:
    """Return what each ``effects/<name>`` costs over ``effects/base``, the cheapest first, or None."""
    effects = {name: timing.time for timing in timings for name in _effect(timing)}
    base = effects.pop(BASE, None)
    if base is None or not effects:
        return None
    costs = {name: time.over(base) for name, time in effects.items()}
    rows = [
        [name, duration(effects[name].median / 1e9), significant(cost.median), cost.percent]
        for name, cost in sorted(costs.items(), key=lambda item: item[1].median)
    ]
    table = markdown(["effect", "median", "times the base rollout", "spread"], rows)
    return f"{table}\n\nThe base rollout takes {duration(base.median / 1e9)}. Measured on {where}."


def _effect(timing: Timing) -> list[str]:
    group, _, name = timing.name.partition("/")
    return [name] if group == EFFECTS else []
