"""IRT from a rig to a result: the network, several starts, the best of them, and how sure it is."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.files import PathLike
from irt.fitting.fit import Estimate, FitResult, Iteration, Progress
from irt.fitting.identifiability import estimates
from irt.fitting.least_squares import MISFIT
from irt.fitting.problem import tracker_noise
from irt.model import Model, Parameter
from irt.rig import PARAMETERS, Rig
from irt.rollouts import SUBSTEP_S, Engine
from irt.tuning import cache
from irt.tuning.drive import Drive
from irt.tuning.iterate import Trace, Tuner, without_spikes
from irt.tuning.tunenet import NetworkFile

Array = NDArray[np.float64]

#: Normal quantile of a two-sided 95 % interval.
_NORMAL_95 = 1.96
#: A start that ends with more than this many times the best one's error has failed; its place says nothing.
_FAILED = 2.0
#: This close to an end of its range (in widths of it) a parameter has been clipped.
_AT_END = 1e-3

_TIME_SCALE = PARAMETERS.index("time_scale")


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

    From random start points in the ranges; the answer is the proposal with the smallest state error that any
    of them met. The network is the one shipped for recordings under the paper's drive; for others one is
    trained first and kept in the user's cache.

    Parameters
    ----------
    rig : Rig
        The recordings, and the ranges, which no proposal leaves.
    starts : int
        Random start points.
    iterations : int
        Steps from each.
    seed : int
        Of the start points.
    network : path, optional
        A trained network to use instead.
    engine : {"rolling", "rapier"}
        What simulates.
    both_orders : bool
        Whether the network is asked in both orders (`irt.tuning.tunenet.TuneNet.both_orders`); False is the
        paper's way.
    progress : callable, optional
        Called with (done, total, text).
    threads : int, optional
        Of the engine; the result does not depend on it.

    Returns
    -------
    FitResult
        Its 95 % intervals hold what Gauss-Newton theory says at the solution, and 1.96 standard deviations of
        where the starts ended, as independent errors. Where the marble starts in motion, errors are what is
        left after a straight line is taken out of each window, for its unknown start state.

    Raises
    ------
    IrtError
        If an option or the network file is not as it must be, or the cache cannot be written.
    """
    for name, value, least in (("starts", starts, 1), ("iterations", iterations, 1), ("seed", seed, 0)):
        if value < least:
            raise IrtError(f"{name}: expected at least {least}, found {value}")
    began = time.perf_counter()
    needed = cache.need(rig, engine)
    drive = needed.rig_drive
    file = cache.obtain(needed, network, threads=threads, progress=progress)
    tuner = Tuner(drive, file.network, needed.joint, both_orders)
    start_points = np.random.default_rng(seed).random((starts, len(PARAMETERS)))
    observed = [without_spikes(segment.observed) for segment in needed.segments]
    trace = tuner.iterate(start_points, observed, iterations, threads=threads, progress=progress)
    order = np.argsort(trace.mae.min(axis=0), kind="stable")
    found = tuple(_estimate(drive, trace, start) for start in order)
    best = _model(rig, found[0].best.parameters)
    noise = tuner.noise_left(best.values, observed, threads)
    parameters, unidentifiable = estimates(best, needed.segments, noise, engine=engine, threads=threads)
    sd = spread([each.best for each in found])
    parameters = {
        name: widened(parameters[name], _NORMAL_95 * sd[i], rig.ranges[name])
        for i, name in enumerate(PARAMETERS)
    }
    return FitResult(
        method="irt",
        model=Model(rig.board, rig.marble, rig.start, dict(rig.ranges), parameters),
        noise=noise,
        estimates=found,
        rollouts=starts * (iterations + 1) * len(drive.runs),
        unidentifiable=unidentifiable,
        notes=tuple(_notes(needed, file, network, best, noise)),
        seed=seed,
        seconds=time.perf_counter() - began,
    )


def _estimate(drive: Drive, trace: Trace, start: int) -> Estimate:
    values = drive.parameters(trace.scaled[:, start])
    return Estimate(
        tuple(Iteration(p, float(mae)) for p, mae in zip(values, trace.mae[:, start], strict=True))
    )


def _model(rig: Rig, values: Array) -> Model:
    """Return the model of a proposal, its time scale as the simulator takes it: in whole physics updates."""
    values = values.copy()
    if all(recording.stamps is None for recording in rig.recordings):
        values[_TIME_SCALE] = np.rint(values[_TIME_SCALE])
    return Model.from_rig(rig, values)


def spread(best: Sequence[Iteration]) -> Array:
    """Return the standard deviation, (5,), of where those starts ended that did not fail."""
    ended = np.array([each.parameters for each in best if each.mae <= _FAILED * best[0].mae])
    return ended.std(axis=0, ddof=1) if len(ended) > 1 else np.zeros(len(PARAMETERS))


def widened(parameter: Parameter, more: float, limits: tuple[float, float]) -> Parameter:
    """Return a parameter whose interval holds another, independent half width, within the range."""
    if parameter.low is None or parameter.high is None:
        return parameter
    value = parameter.value
    low = value - np.hypot(value - parameter.low, more)
    high = value + np.hypot(parameter.high - value, more)
    return Parameter(value, min(value, max(float(low), limits[0])), max(value, min(float(high), limits[1])))


def _notes(
    needed: cache.Need, file: NetworkFile, network: PathLike | None, model: Model, noise: float
) -> Iterator[str]:
    """Say what else the user should know."""
    loss = float(file.metadata["heldout_loss"])
    trained = f"trained on {int(file.metadata['pairs']):,} simulated pairs, held-out loss {loss:.4f}"
    if network is not None:
        yield f"The network is {network}: {trained}."
    elif needed.path == cache.SHIPPED:
        yield f"The network is the one shipped for the paper's drive: {trained}."
    else:
        yield f"The network was made for this rig's drive and is kept in {needed.path}: {trained}."
    drive = needed.rig_drive
    if drive.time_scale is not None:
        yield (
            f"time_scale is {drive.time_scale:.4g}, which is what the stamps say (240 times the median of "
            f"{drive.time_scale * SUBSTEP_S:.4g} s a row); it was not estimated."
        )
    for i in np.flatnonzero(drive.open):
        name, value = PARAMETERS[i], model.values[i]
        low, high = model.ranges[name]
        if min(value - low, high - value) < _AT_END * (high - low):
            yield f"{name} = {value:.4g} is an end of its range, which IRT does not leave."
    scatter = tracker_noise(needed.segments)
    if noise > MISFIT * scatter:
        yield (
            f"The predictions miss by {noise:.2g} of an edge, {noise / scatter:.0f} times what the tracker "
            f"scatters ({scatter:.2g}): five parameters do not explain these recordings, or these five are "
            "not yet the best."
        )
