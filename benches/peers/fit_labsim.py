"""This project's fit. It draws its own start points and estimates the start states too."""

from __future__ import annotations

from pathlib import Path

from irt.fitting.least_squares import least_squares
from irt.recording import Recording
from irt.rig import PARAMETERS, RANGES, Rig
from peers.fit_task import Task, Trace
from peers.workload import BOARD, MARBLE, Array


def fit(trace: Trace, start: Array, seed: int) -> None:
    """Fit once from its own start points; the time includes the intervals."""
    del start
    parameters, trace.rollouts = run(trace.task, seed)
    trace.reach(float(trace.task.error(trace.task.predict(parameters[None]))[0]))


def run(task: Task, seed: int) -> tuple[Array, int]:
    """Return the fitted parameters (5,) and the number of rollouts."""
    result = least_squares(rig_of(task), seed=seed)
    return result.model.values, result.rollouts


def rig_of(task: Task) -> Rig:
    """Return the recordings of a task as a rig."""
    recordings = tuple(
        Recording(f"run-{index}", Path(f"run-{index}.csv"), knobs, marble)
        for index, (knobs, marble) in enumerate(zip(task.commands, task.observed, strict=True))
    )
    ranges = {name: RANGES[name] for name in PARAMETERS}
    return Rig(Path(), BOARD, MARBLE, "rest", ranges, recordings)
