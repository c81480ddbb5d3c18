"""Comparison of fits on the same recordings and start points, in turns."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module

import numpy as np

from peers.fit_task import HIGH, LOW, Arrival, Method, Task, Trace, make_task

#: Name on the page, and module of this package; this project first.
METHODS = {
    "labsim least_squares": "fit_labsim",
    "scipy least_squares": "fit_scipy",
    "pycma": "fit_cma",
    "mujoco.sysid": "fit_sysid",
}
#: Methods of half a minute per run, which use only the first few start points.
FEWER = {"mujoco.sysid": 3}
SEED = 0


@dataclass(frozen=True)
class Run:
    """One method from one start point.

    Attributes
    ----------
    method : str
        Name.
    start : int
        Number of the start point.
    seconds, rollouts
        Time and rollouts until its end, by success or not.
    error : float
        The smallest root mean square error [board edges].
    close, arrived : (float, int) or None
        Seconds and rollouts until within 10 % and 1 % of the best fit's error.
    """

    method: str
    start: int
    seconds: float
    rollouts: int
    error: float
    close: tuple[float, int] | None
    arrived: tuple[float, int] | None


@dataclass(frozen=True)
class Race:
    """All methods on the same recordings.

    Attributes
    ----------
    recordings : str
        Which of the `DRIVES`.
    floor : float
        Root mean square error of the best fit [board edges].
    runs : list of Run
        In the order in which they ran.
    """

    recordings: str
    floor: float
    runs: list[Run]


def methods(absent: dict[str, str]) -> dict[str, Method]:
    """Return all available methods; `absent` gets the reasons for the others."""
    found = {}
    for name, module in METHODS.items():
        try:
            found[name] = import_module(f"peers.{module}").fit
        except ImportError as error:
            absent[name] = f"{error}"
    return found


def race(drive: str, racers: dict[str, Method], starts: int, progress: Callable[[str], None]) -> Race:
    """Fit the recordings of one of the `DRIVES` by every method from random points of the paper's ranges."""
    task, runs = make_task(drive, SEED), []
    points = LOW + np.random.default_rng(SEED).random((starts, len(LOW))) * (HIGH - LOW)
    for index, point in enumerate(points):
        for name, method in racers.items():
            if index < FEWER.get(name, starts):
                runs.append(_run(task, name, method, point, index))
                progress(f"fit {drive}: {name}, start {index + 1}: {_outcome(runs[-1])}")
    return Race(drive, task.floor, runs)


def _run(task: Task, name: str, method: Method, point: np.ndarray, index: int) -> Run:
    trace = Trace(task)
    with suppress(Arrival):
        method(trace, point, index)
    return Run(name, index, trace.seconds, trace.rollouts, trace.error, trace.close, trace.arrived)


def _outcome(run: Run) -> str:
    arrived = "arrived" if run.arrived else "within 10 %" if run.close else "failed"
    return f"{arrived} after {run.seconds:.2f} s and {run.rollouts} rollouts, error {run.error:.3g}"
