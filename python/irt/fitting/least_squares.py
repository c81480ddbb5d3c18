"""Least squares over rollouts: multi-start, bounded, robust, over all recordings of a rig at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError, located
from irt.fitting.fit import Estimate, FitResult, Iteration, Progress
from irt.fitting.identifiability import unidentifiable, with_intervals
from irt.fitting.information import Information
from irt.fitting.problem import Problem
from irt.model import Effect, Model
from irt.rig import PARAMETERS, Rig
from irt.rollouts import SUBSTEP_S, Engine
from irt.segments import segments

Array = NDArray[np.float64]

#: Residuals this many times the tracker's noise are no noise.
MISFIT = 2.0


def least_squares(
    rig: Rig,
    *,
    starts: int = 8,
    seed: int = 0,
    effects: Sequence[Effect] = (),
    engine: Engine = "rolling",
    progress: Progress | None = None,
    threads: int | None = None,
) -> FitResult:
    """Fit the five parameters, and those of any effects, to all recordings of a rig.

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
    effects : sequence of Effect
        What is added to the simulation. Half of the start points have the values given; a parameter that is
        left out is looked for over its range.
    engine : {"rolling", "rapier"}
        What simulates.
    progress : callable, optional
        Called with (done, total, text).
    threads : int, optional
        Threads of the engine; by default one for each core.

    Raises
    ------
    IrtError
        If `starts` is less than one, some recordings are stamped and others not, nothing was seen, or the
        engine knows no such effect.
    """
    if starts < 1:
        raise IrtError(f"starts: expected at least 1, found {starts}")
    began = time.perf_counter()
    stretches, time_scale = segments(rig), stamped_time_scale(rig)
    problem = Problem.of(
        rig,
        stretches,
        effects=effects,
        time_scale=time_scale,
        tilt_noise=rig.tilt.noise_rad,
        engine=engine,
        threads=threads,
    )
    with located(f"{rig.path}"):
        solution = problem.fit(starts=starts, seed=seed, progress=_report(progress))
    information = Information.of(problem, solution.values, solution.information)
    parameters = with_intervals(information)
    fitted = {
        effect.name: {
            name.removeprefix(f"{effect.name}."): parameter
            for name, parameter in parameters.items()
            if name.startswith(f"{effect.name}.")
        }
        for effect in effects
    }
    model = Model.from_rig(
        rig,
        solution.values[: len(PARAMETERS)],
        effects=[
            Effect(name, {key: one.value for key, one in of_effect.items()})
            for name, of_effect in fitted.items()
        ],
        time_step="continuous",
    )
    return FitResult(
        method="least-squares",
        model=replace(model, parameters={name: parameters[name] for name in PARAMETERS}),
        noise=solution.noise,
        estimates=tuple(_estimate(path, errors) for path, errors in solution.estimates),
        rollouts=solution.rollouts,
        unidentifiable=unidentifiable(information),
        notes=tuple(_notes(rig, model, time_scale, solution.noise, solution.tracker_noise)),
        seed=seed,
        seconds=time.perf_counter() - began,
        residuals=tuple(solution.residuals),
        effects=fitted,
    )


def _estimate(path: Array, errors: Array) -> Estimate:
    """Return what one start point led to, from (t, n) values and (t,) errors."""
    five = path[:, : len(PARAMETERS)]
    return Estimate(tuple(Iteration(p, mae) for p, mae in zip(five, errors.tolist(), strict=True)))


def _report(progress: Progress | None) -> Callable[[int, int, int], None] | None:
    if progress is None:
        return None
    return lambda done, total, rows: progress(done, total, f"least squares, {rows} rows at a time")


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
    rig: Rig, model: Model, time_scale: float | None, noise: float, tracker_noise: float
) -> Iterator[str]:
    """Say what else the user should know of a fit."""
    if time_scale is not None:
        yield (
            f"time_scale = {time_scale:.4g} is what the stamps say, 240 times the median of "
            f"{time_scale * SUBSTEP_S:.4g} s a row; it was not fitted."
        )
    for name, value in zip(PARAMETERS, model.values, strict=True):
        low, high = rig.ranges[name]
        if not low <= value <= high and not (name == "time_scale" and time_scale is not None):
            yield f"{name} = {value:.4g} lies outside its range of {low:g} to {high:g}."
    if noise > MISFIT * tracker_noise:
        named = " and ".join(effect.name for effect in model.effects)
        what = f"five parameters and {named} do" if named else "five parameters do"
        yield (
            f"The predictions miss by {noise:.2g} of an edge, {noise / tracker_noise:.0f} times the "
            f"tracker's scatter of {tracker_noise:.2g}: {what} not explain these recordings."
        )
