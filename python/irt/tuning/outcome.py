"""From the end points of starts to a result: the model, its intervals, and notes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.engine import SUBSTEP_S
from irt.errors import IrtError
from irt.fitting.fit import Estimate, FitResult, Iteration
from irt.fitting.identifiability import informed, unidentifiable, with_intervals
from irt.fitting.least_squares import MISFIT
from irt.fitting.picture_error import with_scale_error
from irt.fitting.posterior import component
from irt.fitting.problem import tracker_noise
from irt.fitting.robust import deviation
from irt.model import Model, Parameter
from irt.rig import PARAMETERS, Rig
from irt.tuning.cache import Need
from irt.tuning.drive import Drive
from irt.tuning.search import Path, compare

Array = NDArray[np.float64]

#: Normal quantile of a two-sided 95 % interval.
_NORMAL_95 = 1.96
#: A start whose final error exceeds the best one by this factor has failed and is ignored.
_FAILED = 2.0
#: A parameter closer than this to an end of its range (in widths of it) was clipped.
_AT_END = 1e-3
#: Smallest noise of a camera [board edges].
_FINEST = 1e-6

_TIME_SCALE = PARAMETERS.index("time_scale")


def concluded(
    rig: Rig,
    needed: Need,
    paths: Sequence[Path],
    observed: Sequence[Array],
    *,
    threads: int | None,
    notes: Sequence[str] = (),
    **about: Any,
) -> FitResult:
    """Return the result of all starts' proposals.

    Parameters
    ----------
    rig : Rig
        The recordings.
    needed : Need
        The simulated drives.
    paths : sequence of Path
        Proposals of each start; the best proposal of all is the result.
    observed : sequence of (n, 2) arrays
        Their targets.
    threads : int, optional
        Threads of the engine.
    notes : sequence of str
        Notes of the method, which come first.
    **about
        Fields of the `FitResult`: ``method``, ``rollouts``, ``seed``, ``seconds``.
    """
    drive = needed.rig_drive
    found = sorted((_estimate(path) for path in paths), key=lambda estimate: estimate.best.mae)
    best = _model(rig, found[0].best.parameters)
    noise = noise_left(drive, best.values, observed, threads)
    information = informed(best, needed.segments, noise, engine=drive.engine, threads=threads)
    parameters = with_intervals(information)
    between = spread([each.best for each in found])
    sd = np.sqrt(np.diag(between))
    parameters = {
        name: widened(parameters[name], _NORMAL_95 * sd[i], rig.ranges[name])
        for i, name in enumerate(PARAMETERS)
    }
    parameters = with_scale_error(parameters, rig, tracker_noise(needed.segments))
    values = component(information, (), added=between)
    return FitResult(
        model=Model(
            rig.board,
            rig.marble,
            rig.start,
            dict(rig.ranges),
            parameters,
            maze=rig.maze,
            posterior=() if values.is_point else (values,),
        ),
        noise=noise,
        estimates=tuple(found),
        unidentifiable=unidentifiable(information),
        notes=(*notes, *_notes(needed, best, noise, about["method"])),
        **about,
    )


def noise_left(
    drive: Drive, parameters: Array, observed: Sequence[Array], threads: int | None = None
) -> float:
    """Return the robust standard deviation [board edges] of the residuals of (5,) parameters."""
    return max(deviation(compare(drive, parameters[None], observed, threads).residual), _FINEST)


def checked(**least: tuple[int, int]) -> None:
    """Check options given as (value, least value) by name.

    Raises
    ------
    IrtError
        If one is too small.
    """
    for name, (value, smallest) in least.items():
        if value < smallest:
            raise IrtError(f"{name}: expected at least {smallest}, found {value}")


def spread(best: Sequence[Iteration]) -> Array:
    """Return the covariance, (5, 5), of the end points of starts that did not fail."""
    ended = np.array([each.parameters for each in best if each.mae <= _FAILED * best[0].mae])
    return np.cov(ended.T) if len(ended) > 1 else np.zeros((len(PARAMETERS), len(PARAMETERS)))


def widened(parameter: Parameter, more: float, limits: tuple[float, float]) -> Parameter:
    """Return a parameter whose interval includes another independent half width, within the range."""
    if parameter.low is None or parameter.high is None:
        return parameter
    value = parameter.value
    low = value - np.hypot(value - parameter.low, more)
    high = value + np.hypot(parameter.high - value, more)
    return Parameter(value, min(value, max(float(low), limits[0])), max(value, min(float(high), limits[1])))


def _estimate(path: Path) -> Estimate:
    return Estimate(tuple(Iteration(p, float(mae)) for p, mae in zip(path.parameters, path.mae, strict=True)))


def _model(rig: Rig, values: Array) -> Model:
    """Return the model of a proposal, with a time scale of whole physics updates."""
    values = values.copy()
    if all(recording.stamps is None for recording in rig.recordings):
        values[_TIME_SCALE] = np.rint(values[_TIME_SCALE])
    return Model.from_rig(rig, values)


def _notes(needed: Need, model: Model, noise: float, method: str) -> Iterator[str]:
    """Yield the notes that apply to any result."""
    drive = needed.rig_drive
    if drive.time_scale is not None:
        yield (
            f"time_scale = {drive.time_scale:.4g} is from the stamps (240 times the median row of "
            f"{drive.time_scale * SUBSTEP_S:.4g} s) and was not estimated."
        )
    for i in np.flatnonzero(drive.open):
        name, value = PARAMETERS[i], model.values[i]
        low, high = model.ranges[name]
        if min(value - low, high - value) < _AT_END * (high - low):
            yield f"{name} = {value:.4g} is at an end of its range, which bounds {_NAMES[method]}."
    scatter = tracker_noise(needed.segments)
    if noise > MISFIT * scatter:
        yield (
            f"The residuals are {noise:.2g} of an edge, {noise / scatter:.0f} times the tracker's noise "
            f"({scatter:.2g}): five parameters do not explain these recordings, or the search has not "
            "converged."
        )


_NAMES = {
    "irt": "IRT",
    "irt+": "IRT+",
    "direct": "direct prediction",
    "cma-es": "CMA-ES",
    "es": "the evolution strategy",
}
