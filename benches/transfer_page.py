"""The page of `transfer.py`: what came of controllers made on each kind of model."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import irt
from irt.catalogue import effect
from irt.files import write_atomic
from machine import machine

Array = NDArray[np.float64]
#: By task and arm, the runs of each rig and seed.
Runs = dict[tuple[str, str], list[list[dict[str, Any]]]]
#: A number of a run.
Measure = Callable[[dict[str, Any]], float]

TITLES = {
    "tuned": "five parameters tuned",
    "delayed": "five parameters and a delay tuned",
    "randomised": "five parameters, widely randomised",
    "diagnosed": "posterior of the diagnosis",
    "truth": "truth: the hidden values and effects, in our engine",
}
TASKS = {
    "bare": "Bare board, planned",
    "cyberrunner-easy": "Labyrinth with 8 holes, planned",
    "bare-policy": "Bare board, by a learned policy",
}
#: The arm that is compared with all others.
OURS = "diagnosed"
#: Resamples of an interval.
RESAMPLES = 4000
MEASURES: dict[str, Measure] = {
    "arrived [%]": lambda run: 100.0 * (run["ended"] == "arrived"),
    "progress along the path [%]": lambda run: 100.0 * float(run["progress"]),
    "time of those that arrived [s]": lambda run: (
        float(run["seconds"]) if run["ended"] == "arrived" else float("nan")
    ),
    "beside the path [mm]": lambda run: float(run["beside_mm"]),
}


def write_page(path: Path, rigs: Mapping[str, Sequence[Path]], arms: Sequence[str], text: str) -> None:
    """Write the page over the rigs of each task, by their folders.

    The first paragraph of `text` is the question, the others say how it was done.
    """
    runs = {
        (task, arm): [_read(folder / f"{task}-{arm}.json") for folder in some]
        for task, some in rigs.items()
        for arm in arms
    }
    question, _, how = text.partition("\n\n")
    lines = ["# The proof by transfer", "", question, "", *_headlines(runs, list(rigs), arms), "", how]
    lines += _provenance()
    for task in rigs:
        lines += ["", f"## {TASKS[task]}", "", *_overall(runs, task, arms)]
    lines += ["", "## Rig by rig", "", *_rigs(runs, rigs, arms)]
    write_atomic(path, "\n".join(lines) + "\n")


def _provenance() -> Iterator[str]:
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    yield f"Written by `benches/transfer.py` at commit {commit or 'unknown'}, {machine()}. Brackets are 95 %"
    yield "intervals: rigs are resampled, and seeds within rigs. Differences are of the same rig and seed."


def _headlines(runs: Runs, tasks: Sequence[str], arms: Sequence[str]) -> Iterator[str]:
    """Yield a table of how many runs of each arm arrived, and how near to the path they were."""

    def mean(task: str, arm: str, measure: str) -> float:
        return float(np.mean(_table(runs[task, arm], MEASURES[measure])))

    titles = " | ".join(TITLES[arm] for arm in arms)
    yield f"| runs that arrived, and their distance from the path | {titles} |"
    yield "| --- |" + " --- |" * len(arms)
    for task in tasks:
        cells = [
            f"{mean(task, arm, 'arrived [%]'):.0f} %, {mean(task, arm, 'beside the path [mm]'):.1f} mm"
            for arm in arms
        ]
        yield f"| {TASKS[task]}, {_rigs_of(len(runs[task, arms[0]]))} | {' | '.join(cells)} |"


def _overall(runs: Runs, task: str, arms: Sequence[str]) -> Iterator[str]:
    """Yield the table of a task, and that of the differences."""
    rigs, seeds = len(runs[task, arms[0]]), len(runs[task, arms[0]][0])
    # Wilson's lower end for all of so many rigs.
    least = 100.0 * rigs / (rigs + 1.96**2)
    yield f"{_rigs_of(rigs)}, {seeds} seeds of each. Where all runs agree, brackets have no width; by the"
    yield f"number of rigs alone, 100 % is {least:.0f} to 100 %."
    yield ""
    yield f"| controller made on | {' | '.join(MEASURES)} | fell | stuck |"
    yield "| --- |" + " --- |" * (len(MEASURES) + 2)
    for arm in arms:
        cells = [_interval(_table(runs[task, arm], measure)) for measure in MEASURES.values()]
        ends = [run["ended"] for rig in runs[task, arm] for run in rig]
        cells += [f"{ends.count(end)} of {rigs * seeds}" for end in ("fell", "stuck")]
        yield f"| {TITLES[arm]} | {' | '.join(cells)} |"
    yield ""
    yield f"What the {TITLES[OURS]} adds to each of the others:"
    yield ""
    names = list(MEASURES)
    yield f"| beside | {' | '.join(names)} |"
    yield "| --- |" + " --- |" * len(names)
    for arm in arms:
        if arm != OURS:
            pairs = [
                _table(runs[task, OURS], MEASURES[name]) - _table(runs[task, arm], MEASURES[name])
                for name in names
            ]
            yield f"| {TITLES[arm]} | {' | '.join(_interval(one, sign='+') for one in pairs)} |"


def _rigs_of(count: int) -> str:
    return f"{count} {'rig' if count == 1 else 'rigs'}"


def _rigs(runs: Runs, rigs: Mapping[str, Sequence[Path]], arms: Sequence[str]) -> Iterator[str]:
    """Yield what was hidden in each rig and found, how each model predicts it, and how many runs arrived."""
    seeds = len(next(iter(runs.values()))[0])
    yield "Errors are of free runs held out, in percent of the board's edge, one for each arm. Then how many"
    yield f"of {seeds} runs of each arm arrived, in the same order."
    yield ""
    yield f"| hidden | diagnosed | error: {', '.join(arms)} | {' | '.join(TASKS[task] for task in rigs)} |"
    yield "| --- | --- | --- |" + " --- |" * len(rigs)
    most = max(len(some) for some in rigs.values())
    for number, folder in enumerate(next(some for some in rigs.values() if len(some) == most)):
        hidden = " + ".join(_sized(one) for one in _read(folder / "label.json")["effects"])
        found = " + ".join(one.name for one in irt.load_model(folder / "diagnosed.toml").effects)
        errors = _read(folder / "errors.json")
        shown = ", ".join(f"{100.0 * errors[arm]:.2g}" for arm in arms)
        arrived = [
            ", ".join(_arrived(runs[task, arm][number]) for arm in arms) if number < len(some) else ""
            for task, some in rigs.items()
        ]
        yield f"| {hidden} | {found or 'nothing'} | {shown} | {' | '.join(arrived)} |"


def _arrived(runs: list[dict[str, Any]]) -> str:
    return str(sum(run["ended"] == "arrived" for run in runs))


def _sized(hidden: dict[str, Any]) -> str:
    """Return an effect with its values and their units; values with the same unit share it."""
    units = {one.name: one.unit for one in effect(hidden["name"]).parameters}
    sizes: dict[str, list[str]] = {}
    for name, size in hidden.items():
        if name != "name":
            sizes.setdefault(units[name], []).append(f"{size:.2g}")
    shown = "; ".join(f"{', '.join(some)} {unit}".rstrip() for unit, some in sizes.items())
    return f"{hidden['name']} {shown}"


def _table(rigs: list[list[dict[str, Any]]], measure: Measure) -> Array:
    """Return a number of each run, (rigs, seeds)."""
    return np.array([[measure(run) for run in rig] for rig in rigs])


def _interval(values: Array, sign: str = "") -> str:
    """Return the mean of values (rigs, seeds) and its 95 % interval; NaN are left out."""
    if np.isnan(values).all():
        return "none"
    random = np.random.default_rng(0)
    rigs, seeds = values.shape
    drawn = random.integers(rigs, size=(RESAMPLES, rigs, 1))
    some = values[drawn, random.integers(seeds, size=(RESAMPLES, rigs, seeds))].reshape(RESAMPLES, -1)
    kept = some[~np.isnan(some).all(axis=1)]
    low, high = np.percentile(np.nanmean(kept, axis=1), [2.5, 97.5])
    return f"{np.nanmean(values):{sign}.1f} ({low:{sign}.1f} to {high:{sign}.1f})"


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
