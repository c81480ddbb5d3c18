"""Intervals of the parameters of a set, from curvature, jackknife, time symmetry and errors of the picture.

The curvature of the free runs' likelihood assumes white noise of constant size around a correct model. The
curvature of the filter also includes a random push. The jackknife over recordings (Efron and Stein, 1981,
"The jackknife estimate of variance") covers differences between recordings, such as in rebounds from the rim.
The widest of the three intervals is used.

Recordings without stamps do not determine the duration of a row: the same path results from slower motion
under weaker pushes. Slip after impacts, and the time discretisation of impacts by an engine, break this
symmetry, but neither is known well enough of a board to measure time by. Therefore nothing counts as known
along this symmetry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from irt.catalogue import EffectInfo
from irt.diagnosis import config
from irt.diagnosis.dataset import Fitted
from irt.diagnosis.hypotheses import JITTER, MEAN, SHIFT_S, SIZES_OF_TIMES, SMOOTHED_S, SMOOTHING
from irt.diagnosis.score import KICK, SCALE_OF_NORMAL, Scored, Scores, mean_delay
from irt.diagnosis.time_symmetry import at_one_time_scale, powers, time_is_known
from irt.diagnosis.validation import HeldOut
from irt.engine import SUBSTEP_S
from irt.fitting.effect_size import size_of, sizes_of
from irt.fitting.identifiability import unidentifiable, with_intervals
from irt.fitting.information import CONFIDENCE, FLAT, Information
from irt.fitting.picture_error import with_scale_error
from irt.fitting.problem import Problem
from irt.model import Parameter

Array = NDArray[np.float64]

#: Fewest recordings for the jackknife.
FEWEST = 3
#: Half-width along the symmetry, in ranges, which stands for no knowledge.
_UNKNOWN = 10.0
#: Smallest half-widths. A measured tilt may show times to a fraction of a millisecond, but engines differ by
#: a time step in when a command takes effect, and a rig does from any engine.
_RESOLVED = dict.fromkeys(SIZES_OF_TIMES.values(), SUBSTEP_S)
#: Shares of a time at which that of another effect begins beside it.
_SHARES = (0.1, 0.5)
#: Half-width of a 95 % interval in standard deviations.
_NORMAL = float(ndtri(0.5 + CONFIDENCE / 2.0))
#: Factors of the spread of delays at which its likelihood is evaluated.
_FACTORS = np.geomspace(0.2, 5.0, 41)
#: The 95 % point of a chi-squared variable of one degree of freedom, halved.
_FALLEN = 1.92


def parameters(
    one: Scored, held: HeldOut, losses: Mapping[str, float]
) -> tuple[dict[str, Parameter], tuple[str, ...]]:
    """Return the parameters of a set with 95 % intervals, and sentences on unidentifiable combinations.

    Parameters
    ----------
    one : Scored
        The set.
    held : HeldOut
        The fits of the set without each recording.
    losses : mapping
        Loss of log-likelihood without each effect [nats].
    """
    information = information_of(one, held)
    deviations = dict(zip(one.names, one.top.deviations.tolist(), strict=True))
    allowed = dict(zip(information.names, information.allowed.tolist(), strict=True))
    # Where time is unknown the filter's deviations reach as far along the symmetry as the prior.
    deviations = dict.fromkeys(deviations, 0.0) if not time_is_known(one.dataset) else deviations
    found = {
        name: _wider(parameter, max(_NORMAL * deviations[name], _RESOLVED.get(name, 0.0)), *allowed[name])
        for name, parameter in with_intervals(information).items()
    }
    found = with_scale_error(found, one.dataset.rig, one.tracker)
    for name, loss in losses.items():
        sizes = [each for each in sizes_of(name) if f"{name}.{each.name}" in found]
        if sizes:
            size = max(sizes, key=lambda each: _distance(found[f"{name}.{each.name}"], each.neutral))
            key = f"{name}.{size.name}"
            share = _least_share(key, one.fitted, found["time_scale"])
            found[key] = _apart(found[key], size.neutral, loss, share)
    if JITTER in one.effects:
        found[f"{JITTER}.sd_s"] = _spread(one, found["time_scale"])
        found[f"{JITTER}.mean_s"] = _mean_delay(one, information, found["time_scale"])
    return found, unidentifiable(information)


def _distance(one: Parameter, neutral: float) -> float:
    """Return the distance of a parameter from its neutral value, in widths of its interval."""
    if one.low is None or one.high is None or not np.isfinite(neutral):
        return 0.0
    return abs(one.value - neutral) / max(one.high - one.low, 1e-300)


def _least_share(name: str, fitted: Fitted, time_scale: Parameter) -> float:
    """Return the smallest share of a parameter's value in the interval of the time scale."""
    (power,) = [0.0] if time_is_known(fitted.dataset) else powers([name], fitted)
    ends = [one for one in (time_scale.low, time_scale.high) if one]
    return float(min([1.0, *((end / time_scale.value) ** power for end in ends)]))


def _apart(one: Parameter, neutral: float, loss: float, share: float) -> Parameter:
    """Return a parameter whose interval excludes the neutral value if the likelihood does.

    Effects with stick and slip have little curvature at the maximum, although the recordings exclude their
    absence. The loss of log-likelihood at the neutral value is known. If it were quadratic in the parameter,
    the 95 % interval would end at a share of the distance that is the square root of the ratio of the two
    losses. Where time is unknown the likelihood is the same at other time scales, at which the distance is as
    small as `share` of it.
    """
    if one.low is None or one.high is None or not np.isfinite(neutral) or loss <= _FALLEN:
        return one
    nearest = neutral + share * (one.value - neutral) * (1.0 - float(np.sqrt(_FALLEN / loss)))
    if neutral < one.value:
        return Parameter(one.value, one.low if one.low > neutral else nearest, one.high)
    return Parameter(one.value, one.low, one.high if one.high < neutral else nearest)


def may_be_absent(name: str, found: Mapping[str, Parameter]) -> bool:
    """Whether the intervals of an effect's size parameters contain the neutral values."""
    asked = [
        (found[f"{name}.{one.name}"], one.neutral) for one in sizes_of(name) if f"{name}.{one.name}" in found
    ]
    return all(
        one.low is None or one.high is None or one.low <= neutral <= one.high for one, neutral in asked
    )


def spanning(found: Mapping[str, Parameter], others: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """Return parameters whose intervals contain those of the same parameters in another set, too.

    An effect that does not matter to predictions may be there, and may matter to the values of others: of a
    dead time and a lag the marble shows little more than their sum. Effects stay distinct from their absence.
    """
    wide = dict(found)
    for name, one in found.items():
        other = others.get(name)
        if other is not None and other.low is not None and other.high is not None:
            wide[name] = _containing(one, other.low, other.high)
    for effect in {name.partition(".")[0] for name in found if "." in name}:
        if may_be_absent(effect, wide) and not may_be_absent(effect, found):
            wide.update({name: one for name, one in found.items() if name.startswith(f"{effect}.")})
    return wide


def with_delay_and_lag(one: Scored) -> Scored | None:
    """Return a set with a delay beside its lag, or a lag beside its delay; None if it has both or neither.

    Every actuator has a dead time and a lag, and of the two the marble shows little more than the sum. A
    delay of 20 ms beside a lag of 100 ms is less probable than a lag of 117 ms alone, as it gains a few nats
    at most and is one effect more. That is no knowledge that the lag is longer than 100 ms.
    """
    own = [name for name in SIZES_OF_TIMES if name in one.effects]
    if JITTER in one.effects or not own or (SMOOTHING in own and len(own) > 1):
        return None
    more = MEAN if SMOOTHING in own else SMOOTHING
    scores, effects = Scores.of(one), (*one.effects, more)
    problem = scores.problem(effects)
    values = np.tile(scores.from_where(problem, one), (len(_SHARES), 1))
    columns = [problem.names.index(SIZES_OF_TIMES[name]) for name in (own[0], more)]
    shares = np.array([[1.0 - share, share] for share in _SHARES])
    values[:, columns] = shares * one.values[SIZES_OF_TIMES[own[0]]]
    noise = np.tile(one.noise, (len(values), 1))
    found = scores.ascend(effects, values, noise, one.top.states, iterations=config.THOROUGH)
    best = max(found, key=lambda each: each.score)
    return best if math.isfinite(best.score) else None


def _wider(one: Parameter, half_width: float, least: float, most: float) -> Parameter:
    """Return a parameter whose interval has at least this half-width, within what physics allows."""
    if one.low is None or one.high is None:
        return one
    low = max(least, min(one.low, one.value - half_width))
    high = min(most, max(one.high, one.value + half_width))
    return Parameter(one.value, min(low, one.value), max(high, one.value))


def _containing(one: Parameter, low: float, high: float) -> Parameter:
    """Return a parameter whose interval contains another one."""
    if one.low is None or one.high is None:
        return one
    return Parameter(one.value, min(one.low, low), max(one.high, high))


def information_of(one: Scored, held: HeldOut) -> Information:
    """Return what recordings say of a set, as far as the fits without each recording in turn agree."""
    fitted = one.fitted
    own = [one.names.index(name) for name in fitted.names]
    return _with_scatter(curvature(one), at_one_time_scale(one.names, held.values, one.fitted)[:, own])


def curvature(one: Scored) -> Information:
    """Return what recordings say of a set by the curvature of the likelihood of its free runs.

    Beside a measured tilt, which free runs do not see, it is that of the filter.
    """
    fitted = one.fitted
    problem = one.dataset.problem(fitted.effects)
    if one.dataset.has_tilt:
        return _of_filter(one, problem)
    information = Information.of(problem, fitted.values, problem.inform(fitted.values, one.dataset.noise))
    return _without_time(fitted, information)


def _of_filter(one: Scored, problem: Problem) -> Information:
    """Return what recordings say of the values of a problem by the posterior of the filter."""
    own = [one.names.index(name) for name in problem.names]
    values, free = one.top.values[own], one.top.deviations[own] > 0.0
    widths = np.ptp(problem.ranges, axis=1)[free]
    covariance = one.top.covariance[np.ix_(own, own)][np.ix_(free, free)]
    variance, vectors = np.linalg.eigh(covariance / np.outer(widths, widths))
    directions = np.zeros((len(variance), len(values)))
    directions[:, free] = vectors.T
    half_width = _NORMAL * np.sqrt(np.maximum(variance, 0.0))
    return Information.along(problem, values, free, directions, half_width)


def _with_scatter(information: Information, values: Array) -> Information:
    """Return the information with half-widths along all directions of at least those of the jackknife.

    The (k, n) values are those of fits without each recording.
    """
    by_folds = scatter(values / information.widths @ information.directions.T)
    wider = np.maximum(information.half_width, by_folds)
    return replace(information, half_width=np.where(information.flat, information.half_width, wider))


def scatter(values: Array) -> Array:
    """Return half-widths of 95 % intervals by the jackknife, from (k, ...) fits without each recording."""
    count = len(values)
    if count < FEWEST:
        return np.zeros(values.shape[1:])
    deviation = np.sqrt((count - 1) / count * np.sum((values - values.mean(axis=0)) ** 2, axis=0))
    return np.asarray(float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2.0)) * deviation)


def _without_time(fitted: Fitted, information: Information) -> Information:
    """Return the information without knowledge along the time symmetry.

    If stamps or a damping determine the time scale, the information is unchanged.
    """
    dataset = fitted.dataset
    if time_is_known(dataset):
        return information
    along = powers(fitted.names, fitted) * fitted.values / information.widths
    along = np.where(information.free, along, 0.0)
    along /= np.linalg.norm(along)
    known = np.where(
        np.isfinite(information.half_width), np.minimum(information.half_width, _UNKNOWN), _UNKNOWN
    )
    spread = (
        information.directions * known[:, None] ** 2
    ).T @ information.directions + _UNKNOWN**2 * np.outer(along, along)
    free = np.flatnonzero(information.free)
    variance, vectors = np.linalg.eigh(spread[np.ix_(free, free)])
    directions = np.zeros((len(free), len(information.values)))
    directions[:, free] = vectors.T[::-1]
    half_width = np.sqrt(np.maximum(variance[::-1], 0.0))
    offset = np.where(half_width < FLAT, directions @ (information.offset @ information.directions), 0.0)
    return replace(information, directions=directions, half_width=half_width, offset=offset)


def _spread(one: Scored, time_scale: Parameter) -> Parameter:
    """Return the standard deviation of jittered delays [s], with its 95 % interval by the likelihood.

    The filter's size is a scale of Student's t, which is smaller than that of normal delays, unless delays
    are longer than a row: commands then overtake each other, and the delays of those that arrive are
    correlated. Therefore the interval spans both.
    """
    size = float(one.noise[KICK])
    problem = Scores.of(one).problem(one.effects)
    noises = np.tile(one.noise, (len(_FACTORS), 1))
    noises[:, KICK] *= _FACTORS
    count = len(noises)
    found = problem.filter(np.tile(one.top.values, (count, 1)), noises, [one.top.states] * count)
    likelihood = np.array([float(each.log_likelihood.sum()) for each in found])
    inside = np.flatnonzero(likelihood > likelihood.max() - _FALLEN)
    # The ends of the interval are between those of the grid inside and the next ones.
    ends = noises[np.clip([inside[0] - 1, inside[-1] + 1], 0, count - 1), KICK]
    low, high = min(float(ends[0]), size), max(float(ends[1]), size)
    return _of_time(Parameter(size / SCALE_OF_NORMAL, low, high / SCALE_OF_NORMAL), one, time_scale)


def _mean_delay(one: Scored, information: Information, time_scale: Parameter) -> Parameter:
    """Return the mean of jittered delays [s], the sum of shift and smoothing, which alone is known well."""
    mean = mean_delay(one.values)
    sizes = [SHIFT_S, SMOOTHED_S]
    along = np.where(np.isin(information.names, sizes), information.widths, 0.0)
    half_width = max(SUBSTEP_S, information.margin(along))
    if time_is_known(one.dataset):
        own = [one.names.index(name) for name in sizes]
        variance = float(one.top.covariance[np.ix_(own, own)].sum())
        half_width = max(half_width, _NORMAL * math.sqrt(max(0.0, variance)))
    return _of_time(Parameter(mean, max(0.0, mean - half_width), mean + half_width), one, time_scale)


def _of_time(found: Parameter, one: Scored, time_scale: Parameter) -> Parameter:
    """Return a time [s] whose interval is as much wider as the time scale is unknown, without stamps."""
    if one.dataset.time_scale is not None:
        return found
    if time_scale.low is None or time_scale.high is None or found.low is None or found.high is None:
        return Parameter(found.value)
    shares = time_scale.low / time_scale.value, time_scale.high / time_scale.value
    return Parameter(found.value, found.low * shares[0], found.high * shares[1])


def is_named(info: EffectInfo, found: dict[str, Parameter]) -> bool:
    """Whether an effect is distinct from its absence, and from what engines differ by.

    Rebounds from the rim differ between engines, and between any engine and a rig. A law of impacts that is
    within these differences, or may be, is a part of the model, but no missing physics.
    """
    if not is_distinct(info, found):
        return False
    if not info.of_rims:
        return True
    law = info.required[0]
    least = config.LEAST_OF_IMPACTS * (law.high - law.low)
    known = found[f"{info.name}.{law.name}"]
    if known.low is None or known.high is None:
        return False
    return max(known.low - law.neutral, law.neutral - known.high) > least


def is_distinct(info: EffectInfo, found: dict[str, Parameter]) -> bool:
    """Whether an effect is distinct from its absence: delay jitter by its spread, others by their size.

    It must also be distinct from other effects, by the width or speed on which it acts. Delay jitter must
    exceed what engines differ by: where commands take effect at an engine's next step, their delays have a
    uniform distribution over a step.
    """
    name = info.name
    if name == JITTER:
        low = found[f"{JITTER}.sd_s"].low
        return low is not None and low > SUBSTEP_S / math.sqrt(12.0)
    return not may_be_absent(name, found) and _is_plausible(info, found)


def _is_plausible(info: EffectInfo, found: dict[str, Parameter]) -> bool:
    """Whether the width or speed on which an effect acts is in its range; the size itself may be larger.

    Beyond that range it describes another effect: Stribeck friction at the lowest speeds is static friction,
    and a very wide bump is a tilt of the board.
    """
    size = size_of(info.name)
    scales = [
        one
        for index, one in enumerate(info.required)
        if size is not None and index != size and one.low > 0.0 and not one.is_choice
    ]
    return all(one.low <= found[f"{info.name}.{one.name}"].value <= one.high for one in scales)
