"""The results of `compare.py`: engines beside engines, growth with rollouts, fits beside fits."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np

from table.words import Measured, duration, markdown, rate, significant

Results = dict[str, Any]

#: The reference of relative speeds.
BASELINES = {"PyBullet": 2, "rapier": 2}
#: Busy cores below which nothing else of note runs.
IDLE = 0.2
WORKERS = {"PyBullet": ("process", "processes")}


def peers_table(results: Results) -> str | None:
    """Return speed beside speed, with ratios of repetitions that were timed right after each other."""
    engines = results.get("throughput")
    if not engines:
        return None
    rates = {(one["name"], one["threads"]): _rates(one) for one in engines}
    baselines = [base for base in BASELINES.items() if base in rates]
    rows = []
    for one in engines:
        own = rates[one["name"], one["threads"]]
        row = [_engine(one, results["versions"]), rate(Measured.of(own).median), Measured.of(own).percent]
        row.append(_paper_rollouts(one, results["paper"], statistics.median(own)))
        for base in baselines:
            ratio = Measured.of([a / b for a, b in zip(own, rates[base], strict=True)])
            row.append(f"{significant(ratio.median)} {ratio.percent}")
        rows.append(row)
    ratios = [f"times {name}, {_workers(name, count)}" for name, count in baselines]
    rollouts = f"{results['paper']['rollouts']:,} paper rollouts"
    table = markdown(["engine", "substeps/s", "spread", rollouts, *ratios], rows)
    return f"{table}\n\n{_peers_note(results)}"


def growth_table(results: Results) -> str | None:
    """Return time and memory over the number of rollouts, and the slope of the logarithms."""
    sizes = results.get("growth")
    if not sizes:
        return None
    rows = [
        [f"{one['rollouts']:,}", duration(time.median), time.percent, f"{max(one['peak_mib']):.0f} MiB"]
        for one in sizes
        for time in [Measured.of(one["seconds"])]
    ]
    table = markdown(["rollouts", "time", "spread", "peak memory of the process"], rows)
    return f"{table}\n\n{_slope(sizes)} Measured on {_where(results)}."


def fit_table(results: Results) -> str | None:
    """Return the race of the fits, a table for each kind of recordings."""
    races = results.get("fits")
    if not races:
        return None
    parts = []
    for one in races:
        methods = list(dict.fromkeys(run["method"] for run in one["runs"]))
        rows = [
            _fit_row(method, results["versions"], [run for run in one["runs"] if run["method"] == method])
            for method in methods
        ]
        columns = ["method", "arrived", "to within 10 %", "to within 1 %", "rollouts", "with restarts"]
        parts.append(f"Recordings {one['recordings']}:\n\n{markdown(columns, rows)}")
    return "\n\n".join([*parts, _fit_note(results)])


def _rates(one: Results) -> list[float]:
    return [one["substeps"] / seconds for seconds in one["seconds"]]


def _workers(name: str, count: int) -> str:
    return f"{count} {WORKERS.get(name, ('thread', 'threads'))[count > 1]}"


def _named(name: str, versions: dict[str, str]) -> str:
    return f"{name} {versions[name]}" if name in versions else name


def _engine(one: Results, versions: dict[str, str]) -> str:
    return f"{_named(one['name'], versions)}, {_workers(one['name'], one['threads'])}"


def _paper_rollouts(one: Results, paper: dict[str, int], substeps_per_s: float) -> str:
    measured = one["rollouts"] == paper["rollouts"]
    return duration(paper["substeps"] / substeps_per_s) + ("" if measured else " \\*")


def _peers_note(results: Results) -> str:
    engines = results["throughput"]
    paths = {one["name"]: one["path_mean"] for one in engines if one["name"] != "rolling"}
    apart = ", ".join(f"{name} {significant(1e6 * distance)}" for name, distance in paths.items())
    rounds = len(engines[0]["seconds"])
    return (
        f"\\* Extrapolated by substeps. {rounds} rounds, all engines in turn; ratios are of the same round. "
        "The marble takes the same way: mean distance from the rolling engine's, off the rim, in millionths "
        f"of an edge: {apart}.{_absent(results['absent'], 'engines')} Measured on {_where(results)}."
    )


def _slope(sizes: Sequence[Results]) -> str:
    if len(sizes) < 3:
        return ""
    counts = np.log([one["rollouts"] for one in sizes])
    times = np.log([statistics.median(one["seconds"]) for one in sizes])
    (slope, _), covariance = np.polyfit(counts, times, 1, cov=True)
    return f"Time grows as rollouts to the power of {slope:.3f} ± {covariance[0, 0] ** 0.5:.3f}."


def _fit_row(method: str, versions: dict[str, str], runs: Sequence[Results]) -> list[str]:
    arrived = [run["arrived"] for run in runs if run["arrived"]]
    close = [run["close"] for run in runs if run["close"]]
    rollouts = f"{statistics.median(rollouts for _, rollouts in arrived):,.0f}" if arrived else "none"
    restarts = duration(sum(run["seconds"] for run in runs) / len(arrived)) if arrived else "none"
    return [
        _named(method, versions),
        f"{len(arrived)} of {len(runs)}",
        _time_to(close),
        _time_to(arrived),
        rollouts,
        restarts,
    ]


def _time_to(reached: Sequence[Sequence[float]]) -> str:
    if not reached:
        return "never"
    time = Measured.of([seconds for seconds, _ in reached])
    return f"{duration(time.median)} {time.percent}"


def _fit_note(results: Results) -> str:
    noise = 100 * results["fit_noise"]
    return (
        f"Eight recordings of 120 rows, noise {noise:g} % of the edge, five parameters, random start points; "
        "times to a root mean square error within 10 % and 1 % of the best fit's, medians of the runs that "
        "got there. With restarts: time of all runs for each one that arrived. labsim draws start points of "
        "its own, estimates the start states too, which the others are given, and is timed to "
        "its end, intervals and all; the others stop on arrival. scipy and pycma run over labsim's rollouts, "
        "each Jacobian or population one batch; mujoco.sysid over MuJoCo's."
        f"{_absent(results['absent'], 'fits')} "
        f"Measured on {_where(results)}."
    )


def _where(results: Results) -> str:
    """Return the machine, and what else it did, where that may have cost."""
    busy = results["busy"]
    others = f", {busy:.1f} of them busy with other work" if busy > IDLE else ""
    return f"{results['machine']}{others}"


def _absent(absent: dict[str, dict[str, str]], what: str) -> str:
    missing = [f" {name} is left out: {reason}." for name, reason in absent[what].items()]
    return "".join(missing)
