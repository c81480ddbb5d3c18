"""Least squares over rollouts: multi-start, bounded, robust, over all recordings of a rig at once."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.fitting import robust
from irt.fitting.fit import Estimate, FitResult, Iteration, Progress
from irt.fitting.identifiability import estimates
from irt.fitting.search import Search
from irt.model import Model
from irt.residual import segments
from irt.rig import PARAMETERS, Rig
from irt.rollouts import SUBSTEP_S, Engine

Array = NDArray[np.float64]

#: Residuals this many times the tracker's noise are no noise.
MISFIT = 2.0


def least_squares(
    rig: Rig,
    *,
    starts: int = 8,
    seed: int = 0,
    engine: Engine = "rolling",
    progress: Progress | None = None,
    threads: int | None = None,
) -> FitResult:
    """Fit the five parameters to all recordings of a rig.

    Start points are a space-filling draw over the ranges; the best ones of a screening are refined by
    Levenberg-Marquardt under a Student-t likelihood, which leaves rows where the tracker jumped no say. Start
    states are estimated along with the parameters. Ranges may be left by up to three times, which the notes
    then say. In stamped recordings the time scale is what the stamps say and is not fitted.

    Parameters
    ----------
    rig : Rig
        The recordings, and the ranges to search.
    starts : int
        Start points that are refined.
    seed : int
        Of the draw. The same seed gives the same bits for any number of threads.
    engine : {"rolling", "rapier"}
        What simulates.
    progress : callable, optional
        Called with (done, total, text).
    threads : int, optional
        Threads of the engine; by default one for each core.

    Raises
    ------
    IrtError
        If `starts` is less than one, some recordings are stamped and others not, or nothing was seen.
    """
    if starts < 1:
        raise IrtError(f"starts: expected at least 1, found {starts}")
    began = time.perf_counter()
    stretches, time_scale = segments(rig), stamped_time_scale(rig)
    search = Search(rig, stretches, time_scale, engine=engine, threads=threads, progress=progress)
    candidates = search.run(starts, seed)
    found = []
    for candidate in candidates:
        path = zip(search.coordinates.to_p(candidate.path), search.errors(candidate).tolist(), strict=True)
        found.append(Estimate(tuple(Iteration(parameters, mae) for parameters, mae in path)))
    best = candidates[0]
    count, unknowns = int(search.whole.known.sum()), 5 + search.whole.unknowns
    scale = float(robust.scale(best.residual[None], search.whole.known)[0])
    noise = scale * np.sqrt(count / max(count - unknowns, 1))
    model = Model.from_rig(rig, search.coordinates.to_p(best.z), time_step="continuous")
    parameters, unidentifiable = estimates(
        model, stretches, noise, engine=engine, threads=threads, states=best.states
    )
    return FitResult(
        method="least-squares",
        model=replace(model, parameters=parameters),
        noise=noise,
        estimates=tuple(found),
        rollouts=search.rollouts,
        unidentifiable=unidentifiable,
        notes=tuple(_notes(rig, model.values, time_scale, noise, search.noise)),
        seed=seed,
        seconds=time.perf_counter() - began,
    )


def stamped_time_scale(rig: Rig) -> float | None:
    """Return the time scale that the stamps of a rig tell: 240 times the median seconds of a row.

    Raises
    ------
    IrtError
        If some recordings are stamped and others are not: they have no common time base.
    """
    stamped = [recording.durations for recording in rig.recordings if recording.durations is not None]
    if not stamped:
        return None
    for recording in rig.recordings:
        if recording.durations is None:
            raise IrtError(
                f"{recording.path}: no column t_s, which other recordings of the rig have; "
                "add it here or remove it there"
            )
    return float(np.median(np.concatenate(stamped))) / SUBSTEP_S


def _notes(
    rig: Rig, values: Array, time_scale: float | None, noise: float, tracker_noise: float
) -> Iterator[str]:
    """Say what else the user should know of a fit."""
    if time_scale is not None:
        yield (
            f"time_scale = {time_scale:.4g} is what the stamps say, 240 times the median of "
            f"{time_scale * SUBSTEP_S:.4g} s a row; it was not fitted."
        )
    for name, value in zip(PARAMETERS, values, strict=True):
        low, high = rig.ranges[name]
        if not low <= value <= high and not (name == "time_scale" and time_scale is not None):
            yield f"{name} = {value:.4g} lies outside its range of {low:g} to {high:g}."
    if noise > MISFIT * tracker_noise:
        yield (
            f"The predictions miss by {noise:.2g} of an edge, {noise / tracker_noise:.0f} times the "
            f"tracker's scatter of {tracker_noise:.2g}: five parameters do not explain these recordings."
        )
