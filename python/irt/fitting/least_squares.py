"""Least squares over rollouts: multi-start, bounded, robust, over all recordings of a rig at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.engine import SUBSTEP_S, Engine
from irt.errors import IrtError, located
from irt.fitting.chain import (
    Stage,
    by_effect,
    fit_actuator,
    fit_board,
    in_order,
    is_chain,
    joined,
    joined_posterior,
    without_held_marbles,
)
from irt.fitting.fit import Estimate, FitResult, Iteration, Progress
from irt.fitting.identifiability import unidentifiable, with_intervals
from irt.fitting.information import Information
from irt.fitting.picture_error import SCALED, with_scale_error
from irt.fitting.posterior import component, with_leans
from irt.fitting.problem import Problem
from irt.measured_tilt import has_both_tilts
from irt.model import GEAR_MATRIX, TILT_SENSOR, Effect, Model, Parameter
from irt.rig import PARAMETERS, Rig
from irt.segments import segments

Array = NDArray[np.float64]

#: Smallest ratio of residuals to tracker noise that is reported as a misfit.
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

    Start points are a space-filling draw over the ranges. The best of a screening are refined by
    Levenberg-Marquardt under a Student-t likelihood, which is robust against jumps of the tracker. Start
    states are estimated along with the parameters. Values may leave their ranges by as much as those are
    wide, and magnitudes by at most a factor of three; the notes report this. The time scale of stamped
    recordings is taken from the stamps and not fitted.

    Parameters
    ----------
    rig : Rig
        The recordings, and the ranges to search.
    starts : int
        Number of start points that are refined.
    seed : int
        Seed of the draw. The same seed gives the same bits for any number of threads.
    effects : sequence of Effect
        Effects to add to the simulation. The sensor of a measured tilt, and the gear matrix of a rig that has
        one, are added automatically. Half of the start points have the given values; parameters without a
        value are searched over their ranges.
    engine : {"rolling", "rapier"}
        The simulator.
    progress : callable, optional
        Called with (done, total, text).
    threads : int, optional
        Threads of the engine; by default one per core.

    Raises
    ------
    IrtError
        If `starts` is less than one, only some recordings are stamped, no recording has a marble, or an
        effect is unknown.
    """
    if starts < 1:
        raise IrtError(f"starts: expected at least 1, found {starts}")
    began = time.perf_counter()
    given = {one.name for one in effects}
    effects = list(effects)
    if rig.commands.matrix and GEAR_MATRIX not in given:
        effects.append(Effect(GEAR_MATRIX, {}))
    if rig.has_tilt and TILT_SENSOR not in given:
        effects.append(Effect(TILT_SENSOR, {}))
    fit = _fit_chain if is_chain(rig) else _fit_at_once
    with located(f"{rig.path}"):
        fitted = fit(
            rig, effects, starts=starts, seed=seed, engine=engine, threads=threads, progress=progress
        )
    return replace(fitted, seed=seed, seconds=time.perf_counter() - began)


def _fit_at_once(
    rig: Rig,
    effects: Sequence[Effect],
    *,
    starts: int,
    seed: int,
    engine: Engine,
    threads: int | None,
    progress: Progress | None,
) -> FitResult:
    """Fit the complete chain from commands to positions jointly."""
    time_scale = stamped_time_scale(rig)
    problem = Problem.of(
        rig,
        segments(rig),
        effects=effects,
        time_scale=time_scale,
        tilt_noise=rig.tilt.noise_rad,
        engine=engine,
        threads=threads,
    )
    solution = problem.fit(starts=starts, seed=seed, progress=_report(progress, "least squares"))
    information = Information.of(problem, solution.values, solution.information)
    parameters = with_scale_error(with_intervals(information), rig, solution.tracker_noise)
    five = {name: parameters[name] for name in PARAMETERS}
    model, of_effects = _model(rig, five, by_effect(parameters))
    found = with_leans(component(information, [one.name for one in model.effects]), solution.shrunk)
    return FitResult(
        method="least-squares",
        model=replace(model, posterior=() if found.is_point else (found,)),
        noise=solution.noise,
        estimates=tuple(_estimate(path, errors) for path, errors in solution.estimates),
        rollouts=solution.rollouts,
        unidentifiable=unidentifiable(information),
        notes=tuple(_notes(rig, model, time_scale, solution.noise, solution.tracker_noise)),
        seed=seed,
        seconds=0.0,
        residuals=tuple(solution.residuals),
        effects=of_effects,
    )


def _fit_chain(
    rig: Rig,
    effects: Sequence[Effect],
    *,
    starts: int,
    seed: int,
    engine: Engine,
    threads: int | None,
    progress: Progress | None,
) -> FitResult:
    """Fit command to tilt and tilt to position separately; see `irt.fitting.chain`."""
    time_scale = stamped_time_scale(rig)
    used = without_held_marbles(rig)
    settings: dict[str, Any] = {
        "time_scale": time_scale,
        "starts": starts,
        "seed": seed,
        "engine": engine,
        "threads": threads,
    }
    actuator = fit_actuator(used, effects, progress=_report(progress, "command to tilt"), **settings)
    zero = np.array([actuator.parameters[f"tilt_sensor.zero_{axis}_rad"].value for axis in "xy"])
    board = fit_board(used, effects, zero, progress=_report(progress, "tilt to marble"), **settings)
    five, of_effects = joined(actuator, board)
    if board is not None:
        # What the marble shows: gears are known from the tilt, unless the sensor's gain is estimated.
        shown = [name for name in SCALED if board.parameters[name].low is not None]
        five = with_scale_error(five, rig, board.solution.tracker_noise, shown)
    model, of_effects = _model(rig, five, of_effects)
    found = joined_posterior(actuator, board, model.effects)
    model = replace(model, posterior=() if found.is_point else (found,))
    last = actuator if board is None else board
    gears = model.values[:2]
    notes = list(_tilt_notes(rig, used, actuator))
    if board is not None:
        notes += _notes(rig, model, time_scale, board.solution.noise, board.solution.tracker_noise)
    else:
        notes.append(
            "No recording has both a moving marble and a measured tilt: rolling_friction and "
            "observation_scale are set to the middle of their ranges."
        )
    return FitResult(
        method="least-squares",
        model=model,
        noise=last.solution.noise,
        estimates=tuple(_estimate(path, errors, gears) for path, errors in last.solution.estimates),
        rollouts=actuator.solution.rollouts + (0 if board is None else board.solution.rollouts),
        unidentifiable=tuple(
            dict.fromkeys(
                sentence
                for stage in (actuator, board)
                if stage is not None
                for sentence in unidentifiable(stage.information)
            )
        ),
        notes=tuple(notes),
        seed=seed,
        seconds=0.0,
        residuals=tuple(last.solution.residuals),
        effects=of_effects,
    )


def _model(
    rig: Rig, five: dict[str, Parameter], of_effects: dict[str, dict[str, Parameter]]
) -> tuple[Model, dict[str, dict[str, Parameter]]]:
    """Return the model with the fitted parameters, and its effects in the order in which they act."""
    effects = in_order(
        [
            Effect(name, {key: one.value for key, one in of_effect.items()})
            for name, of_effect in of_effects.items()
        ]
    )
    values = [five[name].value for name in PARAMETERS]
    model = Model.from_rig(rig, values, effects=effects, time_step="continuous")
    return replace(model, parameters=five), {one.name: of_effects[one.name] for one in effects}


def _tilt_notes(rig: Rig, used: Rig, actuator: Stage) -> Iterator[str]:
    """Yield notes on a fit to the measured tilt."""
    scales = ", ".join(
        f"{1000 * scale:.2g} mrad about {axis} (the sensor's noise is {1000 * noise:.2g})"
        for axis, scale, noise in zip(
            "xy", actuator.solution.tilt_scale, actuator.solution.tilt_noise, strict=True
        )
        if np.isfinite(scale)
    )
    yield f"The error of the tilt predicted from commands is {scales}."
    held = [
        before.name
        for before, after in zip(rig.recordings, used.recordings, strict=True)
        if before.has_marble and not after.has_marble
    ]
    if held:
        yield f"{', '.join(held)}: the marble does not move, as in a hole; only the tilt is used."
    unmeasured = [one.name for one in used.recordings if one.has_marble and not has_both_tilts(one)]
    if unmeasured:
        yield f"{', '.join(unmeasured)}: not used, because the tilt was not measured about both axes."


def _estimate(path: Array, errors: Array, gears: Array | None = None) -> Estimate:
    """Return the estimate of a start point from (t, n) values and (t,) errors; `gears` replace its own."""
    five = path[:, : len(PARAMETERS)].copy()
    if gears is not None:
        five[:, :2] = gears
    return Estimate(tuple(Iteration(p, mae) for p, mae in zip(five, errors.tolist(), strict=True)))


def _report(progress: Progress | None, what: str) -> Callable[[int, int, int], None] | None:
    if progress is None:
        return None
    return lambda done, total, rows: progress(done, total, f"{what}, {rows} rows at a time")


def stamped_time_scale(rig: Rig) -> float | None:
    """Return the time scale given by the stamps of a rig: 240 times the median duration of a row [s].

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
    """Yield notes on a fit."""
    if time_scale is not None:
        yield (
            f"time_scale = {time_scale:.4g} is taken from the stamps: 240 times the median row of "
            f"{time_scale * SUBSTEP_S:.4g} s; it was not fitted."
        )
    for name, value in zip(PARAMETERS, model.values, strict=True):
        low, high = rig.ranges[name]
        if not low <= value <= high and not (name == "time_scale" and time_scale is not None):
            yield f"{name} = {_beside(value, low, high)} lies outside its range of {low:g} to {high:g}."
    if noise > MISFIT * tracker_noise:
        named = " and ".join(effect.name for effect in model.effects)
        what = f"five parameters and {named} do" if named else "five parameters do"
        yield (
            f"The residuals are {noise:.2g} of an edge, {noise / tracker_noise:.0f} times the "
            f"tracker's noise of {tracker_noise:.2g}: {what} not explain these recordings."
        )


def _beside(value: float, *bounds: float) -> str:
    """Return a value with enough digits to differ from the bounds that it exceeds."""
    return next(
        (text for digits in range(4, 17) if float(text := f"{value:.{digits}g}") not in bounds), repr(value)
    )
