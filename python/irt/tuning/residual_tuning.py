"""The fit by IRT: network, several starts, the best proposal, and its intervals."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from irt.engine import Engine
from irt.files import PathLike
from irt.fitting.fit import FitResult, Progress
from irt.rig import PARAMETERS, Rig
from irt.tuning import cache
from irt.tuning.iterate import Tuner, without_spikes
from irt.tuning.outcome import checked, concluded
from irt.tuning.search import Path
from irt.tuning.tunenet import NetworkFile


def irt(
    rig: Rig,
    *,
    starts: int = 5,
    iterations: int = 20,
    seed: int = 0,
    network: PathLike | None = None,
    engine: Engine = "rolling",
    both_orders: bool = True,
    progress: Progress | None = None,
    threads: int | None = None,
) -> FitResult:
    """Fit the five parameters by iterative residual tuning (paper, sections 4 and 5).

    The starts are random points in the ranges, and the result is the proposal with the smallest state error
    over all of them. For recordings under the paper's drive the shipped network is used; for other drives a
    network is trained first and stored in the user's cache.

    Parameters
    ----------
    rig : Rig
        The recordings, and the ranges, which bound all proposals.
    starts : int
        Number of random start points.
    iterations : int
        Number of steps from each.
    seed : int
        Seed of the start points.
    network : path, optional
        A trained network to use instead.
    engine : {"rolling", "rapier"}
        The simulator.
    both_orders : bool
        Whether the network is evaluated in both orders (`irt.tuning.tunenet.TuneNet.both_orders`); False as
        in the paper.
    progress : callable, optional
        Called with (done, total, text).
    threads : int, optional
        Threads of the engine; the result does not depend on them.

    Returns
    -------
    FitResult
        Its 95 % intervals combine, as independent errors, those of Gauss-Newton theory at the solution and
        1.96 standard deviations of the starts' end points. If the marble starts in motion, errors are those
        after the removal of a straight line from each window, for its unknown start state.

    Raises
    ------
    IrtError
        If an option or the network file is invalid, or the cache cannot be written.
    """
    checked(starts=(starts, 1), iterations=(iterations, 1), seed=(seed, 0))
    began = time.perf_counter()
    needed = cache.need(rig, engine)
    drive = needed.rig_drive
    file = cache.obtain(needed, network, threads=threads, progress=progress)
    tuner = Tuner(drive, file.network, needed.joint, both_orders)
    start_points = np.random.default_rng(seed).random((starts, len(PARAMETERS)))
    observed = [without_spikes(segment.observed) for segment in needed.segments]
    trace = tuner.iterate(start_points, observed, iterations, threads=threads, progress=progress)
    return concluded(
        rig,
        needed,
        [Path(drive.parameters(trace.scaled[:, i]), trace.mae[:, i]) for i in range(starts)],
        observed,
        threads=threads,
        notes=tuple(network_notes(needed, file, network)),
        method="irt",
        rollouts=starts * (iterations + 1) * len(drive.runs),
        seed=seed,
        seconds=time.perf_counter() - began,
    )


def network_notes(needed: cache.Need, file: NetworkFile, network: PathLike | None) -> Iterator[str]:
    """Return a sentence about the network."""
    loss = float(file.metadata["heldout_loss"])
    trained = f"trained on {int(file.metadata['pairs']):,} simulated pairs, held-out loss {loss:.4f}"
    yield cache.described(needed, "irt", network, trained)
