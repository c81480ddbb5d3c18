"""From a rig to a result by a method that is given so many rollouts: IRT+, CMA-ES, (5 + 100), direct."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.files import PathLike
from irt.fitting.fit import FitResult, Progress
from irt.rig import PARAMETERS, Rig
from irt.rollouts import Engine
from irt.segments import Segment
from irt.tuning import cache
from irt.tuning.direct import predicted
from irt.tuning.evolution import STRATEGIES
from irt.tuning.iterate import without_spikes
from irt.tuning.outcome import checked, concluded
from irt.tuning.plus import Plus
from irt.tuning.search import Search, compare, run
from irt.tuning.stepnet import middle

Array = NDArray[np.float64]

#: Rollouts from each start, unless others are asked for.
ROLLOUTS = {"irt+": 60, "cma-es": 300, "es": 1005}


def irt_plus(
    rig: Rig,
    *,
    starts: int = 1,
    rollouts: int = ROLLOUTS["irt+"],
    seed: int = 0,
    network: PathLike | None = None,
    engine: Engine = "rolling",
    progress: Progress | None = None,
    threads: int | None = None,
) -> FitResult:
    """Fit the five parameters by IRT+: a network's steps, then Gauss-Newton (`irt.tuning.plus.Plus`).

    The network is the one shipped for recordings under the paper's drive; for others one is trained first and
    kept in the user's cache.

    Parameters
    ----------
    rig : Rig
        The recordings, and the ranges, which no proposal leaves.
    starts : int
        Searches, which differ in where they look once Gauss-Newton has come to an end.
    rollouts : int
        Proposals that each of them simulates, those for its Jacobians among them.
    seed : int
        Of what is drawn.
    network : path, optional
        A trained network to use instead.
    engine : {"rolling", "rapier"}
        What simulates.
    progress : callable, optional
        Called with (done, total, text).
    threads : int, optional
        Of the engine; the result does not depend on it.

    Raises
    ------
    IrtError
        If an option or the network file is not as it must be, or the cache cannot be written.
    """
    began = time.perf_counter()
    checked(starts=(starts, 1), rollouts=(rollouts, 1), seed=(seed, 0))
    needed = cache.need(rig, engine)
    file = cache.obtain_steps(needed, network, threads=threads, progress=progress)
    drive, observed = needed.rig_drive, _observed(needed.segments)
    first = compare(drive, middle(drive), observed, threads)
    search = Plus(drive, file, needed.joint, first)
    searches = [search.search(np.random.default_rng([seed, start])) for start in range(starts)]
    about = f"trained on {int(file.metadata['samples']):,} simulated pairs"
    return _searched(
        rig,
        needed,
        observed,
        searches,
        rollouts=rollouts,
        began=began,
        method="irt+",
        seed=seed,
        threads=threads,
        progress=progress,
        notes=(cache.described(needed, "irt+", network, about),),
    )


def strategy(
    rig: Rig,
    method: str,
    *,
    starts: int = 5,
    rollouts: int | None = None,
    seed: int = 0,
    engine: Engine = "rolling",
    progress: Progress | None = None,
    threads: int | None = None,
) -> FitResult:
    """Fit the five parameters by CMA-ES or the (5 + 100) evolution strategy (paper, section 6.1).

    Parameters
    ----------
    rig : Rig
        The recordings, and the ranges, which no proposal leaves.
    method : {"cma-es", "es"}
        Which one.
    starts : int
        Random start points.
    rollouts : int, optional
        Proposals that are simulated from each (default: 300 of cma-es, 1005 of es).
    seed, engine, progress, threads
        As of `irt_plus`.

    Raises
    ------
    IrtError
        If an option is not as it must be.
    """
    began = time.perf_counter()
    rollouts = ROLLOUTS[method] if rollouts is None else rollouts
    checked(starts=(starts, 1), rollouts=(rollouts, 1), seed=(seed, 0))
    needed = cache.need(rig, engine)
    points = np.random.default_rng(seed).random((starts, len(PARAMETERS)))
    begin: Callable[..., Search] = STRATEGIES[method]
    searches = [begin(needed.rig_drive, point, seed + i) for i, point in enumerate(points)]
    return _searched(
        rig,
        needed,
        _observed(needed.segments),
        searches,
        rollouts=rollouts,
        began=began,
        method=method,
        seed=seed,
        threads=threads,
        progress=progress,
    )


def direct(
    rig: Rig,
    *,
    network: PathLike | None = None,
    seed: int = 0,
    engine: Engine = "rolling",
    progress: Progress | None = None,
    threads: int | None = None,
) -> FitResult:
    """Predict the five parameters from the recordings alone, by the paper's network with no proposal.

    Parameters
    ----------
    rig : Rig
        The recordings.
    network : path, optional
        A network trained for this; by default one is trained and kept in the user's cache.
    seed : int
        Not used: nothing is drawn.
    engine, progress, threads
        As of `irt_plus`.

    Raises
    ------
    IrtError
        If the network file is not as it must be, or the cache cannot be written.
    """
    began = time.perf_counter()
    needed = cache.need(rig, engine)
    file = cache.obtain(needed, network, task="parameters", threads=threads, progress=progress)
    observed = _observed(needed.segments)
    guess = predicted(needed, file, observed)
    loss = float(file.metadata["heldout_loss"])
    about = f"trained on {int(file.metadata['pairs']):,} simulations, held-out loss {loss:.4f}"
    return _searched(
        rig,
        needed,
        observed,
        [_once(guess)],
        rollouts=1,
        began=began,
        method="direct",
        seed=seed,
        threads=threads,
        progress=progress,
        notes=(cache.described(needed, "direct", network, about),),
    )


def _once(parameters: Array) -> Search:
    yield parameters


def _observed(segments: Sequence[Segment]) -> list[Array]:
    return [without_spikes(segment.observed) for segment in segments]


def _searched(
    rig: Rig,
    needed: cache.Need,
    observed: Sequence[Array],
    searches: Sequence[Search],
    *,
    rollouts: int,
    began: float,
    method: str,
    seed: int,
    threads: int | None,
    progress: Progress | None,
    notes: Sequence[str] = (),
) -> FitResult:
    drive = needed.rig_drive
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
