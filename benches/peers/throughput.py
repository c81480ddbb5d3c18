"""Substeps per second of each engine on the paper's rollouts, with a check that the paths agree."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module

import numpy as np

from irt.engine import Engine
from peers.labsim_engine import Labsim
from peers.workload import BOARD, MARBLE, Array, Contender, drive, gentle, spread, substeps

#: Other engines: class and module in this package.
OTHERS = {"PyBullet": "pybullet_engine", "MuJoCo": "mujoco_engine"}
OWN: tuple[Engine, ...] = ("rapier", "rolling")
THREADS = (1, 2)
GENTLE_ROLLOUTS = 16
#: Tolerated mean distance from the rolling engine's path, off the rim [board edges].
TOLERANCE = {"PyBullet": 3e-4, "MuJoCo": 1e-3, "rapier": 3e-4, "rolling": 0.0}


class OtherPathError(Exception):
    """Raised when an engine's path differs, so that its speed is not comparable."""


@dataclass(frozen=True)
class Throughput:
    """Measurement of one engine with one number of threads.

    Attributes
    ----------
    name, threads
        The engine, and its threads or processes.
    rollouts, substeps : int
        In one repetition.
    path_mean, path_max : float
        Mean and largest distance of a coordinate from the rolling engine's, on gentle rollouts [board edges].
    seconds : list of float
        Of each repetition.
    """

    name: str
    threads: int
    rollouts: int
    substeps: int
    path_mean: float
    path_max: float
    seconds: list[float] = field(default_factory=list)


def contenders(absent: dict[str, str]) -> list[Contender]:
    """Set up all available engines with each number of threads; `absent` gets the reasons for the others."""
    found: list[Contender] = []
    for name, module in OTHERS.items():
        try:
            engine = getattr(import_module(f"peers.{module}"), name)
        except ImportError as error:
            absent[name] = f"{error}"
        else:
            found += [engine(count) for count in THREADS]
    return found + [Labsim(name, count) for name in OWN for count in THREADS]


def measure(engines: Sequence[Contender], rounds: int, progress: Callable[[str], None]) -> list[Throughput]:
    """Time all engines in turn, `rounds` times, so that a slow minute of the machine affects them all.

    Raises
    ------
    OtherPathError
        If an engine's path differs from the rolling engine's by more than the tolerance.
    """
    commands = drive()
    reference = _reference(engines)
    results = [_compared(engine, reference, progress) for engine in engines]
    for index in range(rounds):
        for engine, result in zip(engines, results, strict=True):
            parameters = spread(engine.rollouts)
            began = time.perf_counter()
            engine.simulate(parameters, commands)
            result.seconds.append(time.perf_counter() - began)
        progress(f"throughput: round {index + 1} of {rounds}")
    return results


def _compared(engine: Contender, reference: Array, progress: Callable[[str], None]) -> Throughput:
    """Check that an engine's gentle paths agree with the rolling engine's; return a result without times."""
    apart = np.abs(engine.simulate(gentle(GENTLE_ROLLOUTS), drive()) - reference)
    mean, largest = float(apart.mean()), float(apart.max())
    progress(f"{engine.name}, {engine.threads}: paths {mean:.1e} apart in the mean, {largest:.1e} at most")
    if not mean <= TOLERANCE[engine.name]:
        raise OtherPathError(
            f"{engine.name}: its marble is {mean:.2g} of an edge from the rolling engine's in the mean, "
            f"allowed are {TOLERANCE[engine.name]:g}"
        )
    work = substeps(spread(engine.rollouts))
    return Throughput(engine.name, engine.threads, engine.rollouts, work, mean, largest)


def _reference(engines: Sequence[Contender]) -> Array:
    """Return the rolling engine's gentle paths; check that they stay off the rim."""
    rolling = next(engine for engine in engines if engine.name == "rolling")
    parameters = gentle(GENTLE_ROLLOUTS)
    paths = rolling.simulate(parameters, drive())
    reach = (np.array([BOARD.edge_x_m, BOARD.edge_y_m]) / 2 - MARBLE.radius_m) / BOARD.edge_x_m
    if not (np.abs(paths) < 0.98 * reach * parameters[:, None, 4:]).all():
        raise OtherPathError("rolling: a gentle rollout meets the rim, where engines differ")
    return paths
