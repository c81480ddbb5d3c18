"""Fits with a budget of rollouts: IRT+, CMA-ES, the (5 + 100) evolution strategy, direct prediction."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.engine import Engine
from irt.files import PathLike
from irt.fitting.fit import FitResult, Progress
from irt.rig import PARAMETERS, Rig
from irt.tuning import cache
from irt.tuning.direct import predicted
from irt.tuning.evolution import STRATEGIES
from irt.tuning.iterate import without_spikes
from irt.tuning.library import PATHS, Library
from irt.tuning.outcome import checked, concluded
from irt.tuning.plus import Plus
from irt.tuning.search import Search, compare, run
from irt.tuning.stepnet import middle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Budget:
    """Default number of starts of a method, and of rollouts from each."""

    starts: int
    rollouts: int


#: Budgets of the methods; direct prediction uses a single rollout.
BUDGETS = {
    "irt+": Budget(1, 60),
    "cma-es": Budget(5, 300),
    "es": Budget(5, 1005),
    "direct": Budget(1, 1),
}


def budgeted(
    rig: Rig,
    method: str,
    *,
    starts: int | None = None,
    rollouts: int | None = None,
    seed: int = 0,
    network: PathLike | None = None,
    engine: Engine = "rolling",
    progress: Progress | None = None,
    threads: int | None = None,
) -> FitResult:
    """Fit the five parameters by a method with a budget of rollouts.

    IRT+ takes steps of a network, then of Gauss-Newton (`irt.tuning.plus.Plus`). CMA-ES, the (5 + 100)
    evolution strategy and direct prediction are the paper's baselines (section 6.1). The networks of IRT+ are
    shipped for recordings under the paper's drive. For other drives, and for direct prediction, a network is
    trained first and stored in the user's cache.

    Parameters
    ----------
    rig : Rig
        The recordings, and the ranges, which bound all proposals.
    method : {"irt+", "cma-es", "es", "direct"}
        The method.
    starts : int, optional
        Random start points of the strategies; searches of IRT+, which differ in their restarts after
        Gauss-Newton has converged. Defaults in `BUDGETS`.
    rollouts : int, optional
        Simulated proposals from each start, including those for Jacobians. Defaults in `BUDGETS`.
    seed : int
        Seed of all random numbers.
    network : path, optional
        A trained network to use instead, for IRT+ and direct prediction.
    engine : {"rolling", "rapier"}
        The simulator.
    progress : callable, optional
        Called with (done, total, text).
    threads : int, optional
        Threads of the engine; the result does not depend on them.

    Raises
    ------
    IrtError
        If an option or the network file is invalid, or the cache cannot be written.
    """
    began = time.perf_counter()
    starts = BUDGETS[method].starts if starts is None else starts
    rollouts = BUDGETS[method].rollouts if rollouts is None else rollouts
    checked(starts=(starts, 1), rollouts=(rollouts, 1), seed=(seed, 0))
    needed = cache.need(rig, engine)
    drive, observed = needed.rig_drive, [without_spikes(segment.observed) for segment in needed.segments]
    notes: tuple[str, ...] = ()
    if method == "irt+":
        steps = cache.obtain_steps(needed, network, threads=threads, progress=progress)
        first = compare(drive, middle(drive), observed, threads)
        plus = Plus(drive, steps, needed.joint, first, Library(drive, threads))
        searches = [plus.search(np.random.default_rng([seed, start])) for start in range(starts)]
        about = _learned(steps.metadata["samples"], f"simulated pairs, with a library of {PATHS:,} paths")
        notes = (cache.described(needed, "irt+", network, about),)
    elif method == "direct":
        file = cache.obtain(needed, network, task="parameters", threads=threads, progress=progress)
        searches = [_once(predicted(needed, file, observed))]
        about = _learned(file.metadata["pairs"], "simulations")
        loss = float(file.metadata["heldout_loss"])
        notes = (cache.described(needed, "direct", network, f"{about}, held-out loss {loss:.4f}"),)
    else:
        points = np.random.default_rng(seed).random((starts, len(PARAMETERS)))
        searches = [STRATEGIES[method](drive, point, seed + i) for i, point in enumerate(points)]
    paths = run(
        drive, [observed] * len(searches), searches, rollouts, threads=threads, progress=progress, text=method
    )
    return concluded(
        rig,
        needed,
        [path.best for path in paths],
        observed,
        threads=threads,
        notes=notes,
        method=method,
        rollouts=sum(len(path.mae) for path in paths) * len(drive.runs),
        seed=seed,
        seconds=time.perf_counter() - began,
    )


def _learned(count: str, what: str) -> str:
    return f"trained on {int(count):,} {what}"


def _once(parameters: Array) -> Search:
    yield parameters
