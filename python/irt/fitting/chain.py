"""Least squares with a measured tilt: fit the actuator and the board one after the other.

The actuator stage (command to tilt) is fitted to the measured tilt; it is not chaotic and needs no marble.
The board stage (tilt to marble) is fitted with the measured tilt in place of the commands, interpolated
linearly between rows, so that errors of the actuator cannot be mistaken for physics of the marble. In a joint
fit the errors of the marble, on real rigs many times the tracker's noise, would bias delays of the actuator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectInfo, EffectParameter, effect
from irt.catalogue import effects as catalogue
from irt.engine import Engine
from irt.fitting.identifiability import with_intervals
from irt.fitting.information import Information
from irt.fitting.posterior import component, with_leans
from irt.fitting.problem import Problem
from irt.fitting.solution import Solution
from irt.measured_tilt import has_both_tilts, play_tilt
from irt.model import TILT_SENSOR, Effect, Parameter
from irt.posterior import Component, Spread, rounded
from irt.recording import Recording
from irt.rig import PARAMETERS, Rig
from irt.segments import SETTLING_S, segments

Array = NDArray[np.float64]

#: The effect of a board that is not level. The tilt alone cannot distinguish it from the sensor's zero.
_LEVEL = "tilt_bias"
#: Initial values of an added effect of the actuator, with all others at their fitted values: shares of its
#: range, or, if the range has both signs, of the distance from its neutral value to an end.
_BEGINNINGS = (0.02, 0.1, 0.3)
_BEGINNINGS_OF_EITHER_SIGN = (0.02, 0.3, -0.3)


@dataclass(frozen=True, eq=False)
class Stage:
    """A fitted stage of the chain: actuator or board.

    Attributes
    ----------
    problem : Problem
        The fitted problem.
    solution : Solution
        Its solution.
    """

    problem: Problem
    solution: Solution

    @property
    def information(self) -> Information:
        """Information of the recordings about the values."""
        return Information.of(self.problem, self.solution.values, self.solution.information)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The values by name, with 95 % intervals where they were fitted."""
        return with_intervals(self.information)


def is_chain(rig: Rig) -> bool:
    """Whether at least one recording has a tilt measured about both axes."""
    return any(has_both_tilts(recording) for recording in rig.recordings)


def without_held_marbles(rig: Rig) -> Rig:
    """Return the rig without marbles that are held or in a hole.

    Such a marble moves by less than its radius, although the tilt changes by more than twice the largest
    rolling friction in the rig's range, which would move a free marble.
    """
    radius = rig.marble.radius_m / rig.board.edge_x_m
    friction = rig.ranges["rolling_friction"][1]

    def kept(recording: Recording) -> Recording:
        if recording.tilt is None or not (recording.has_tilt and recording.has_marble):
            return recording
        moved = _spread(recording.marble)
        tilted = _spread(recording.tilt)
        if moved.max() > radius or tilted.min() < 2.0 * friction:
            return recording
        return replace(recording, marble=np.full_like(recording.marble, np.nan))

    return replace(rig, recordings=tuple(kept(recording) for recording in rig.recordings))


def _spread(columns: Array) -> Array:
    """Return the range between the 1 % and 99 % quantiles of each of two columns, (2,)."""
    low, high = np.nanquantile(columns, [0.01, 0.99], axis=0)
    return np.asarray(high - low)


def fit_actuator(
    rig: Rig,
    effects: Sequence[Effect],
    *,
    time_scale: float | None,
    starts: int,
    seed: int,
    engine: Engine,
    threads: int | None,
    progress: Callable[[int, int, int], None] | None = None,
) -> Stage:
    """Fit the gears, the effects between command and tilt, and the sensor's zero to the measured tilt.

    Effects are added one by one, in the order in which they act. Each starts small, with all other parameters
    at their fitted values: from random starts, the gap of backlash and a gear compensate each other. Optional
    parameters, such as a difference between the axes, are added by the Bayesian information criterion, with
    the number of independent rows as sample size.

    Parameters
    ----------
    rig : Rig
        Recordings, some of them with a tilt.
    effects : sequence of Effect
        All effects of the model; those that do not act between command and tilt are ignored.
    time_scale : float or None
        The time scale of the stamps.
    starts, seed, engine, threads, progress
        As for `least_squares`.
    """
    measured = tuple(_tilt_alone(one, moving=rig.start == "moving") for one in rig.recordings if one.has_tilt)
    alone = replace(rig, recordings=measured)
    stretches = segments(alone)
    middle = {name: sum(rig.ranges[name]) / 2 for name in ("rolling_friction", "observation_scale")}
    sensor = next((one for one in effects if one.name == TILT_SENSOR), Effect(TILT_SENSOR, {}))
    chosen = [Effect(TILT_SENSOR, {k: v for k, v in sensor.parameters.items() if not k.startswith("gain")})]

    def problem(chosen: Sequence[Effect]) -> Problem:
        return Problem.of(
            alone,
            stretches,
            effects=chosen,
            time_scale=time_scale,
            tilt_noise=rig.tilt.noise_rad,
            fixed=middle,
            engine=engine,
            threads=threads,
        )

    base = problem(chosen)
    stage = Stage(base, base.fit(starts=starts, seed=seed, rounds=1, progress=progress))
    of_chain = [one for one in effects if effect(one.name).moves_board and one.name != _LEVEL]
    for one in in_order(of_chain):
        chosen = [*chosen, one]
        stage = _grown(problem(chosen), stage, one)
    return _opened(problem, chosen, stage)


def fit_board(
    rig: Rig,
    effects: Sequence[Effect],
    zero: Array,
    *,
    time_scale: float | None,
    starts: int,
    seed: int,
    engine: Engine,
    threads: int | None,
    progress: Callable[[int, int, int], None] | None = None,
) -> Stage | None:
    """Fit the motion of the marble under the measured tilt; None if no recording has both.

    Gears are 1, unless `effects` contain gains of the tilt sensor; then the gears are fitted, as inverses of
    these gains.

    Parameters
    ----------
    zero : (2,) array
        Reading of the sensor at command 0 [rad]; it is subtracted from the measured tilt.
    rig, effects, time_scale, starts, seed, engine, threads, progress
        As for `fit_actuator`.
    """
    both = [one for one in rig.recordings if one.has_marble and has_both_tilts(one)]
    if not both:
        return None
    played = replace(
        rig,
        recordings=tuple(play_tilt(one, zero, np.ones(2)) for one in both),
        ranges={**rig.ranges, "gear_x": (0.5, 2.0), "gear_y": (0.5, 2.0)},
    )
    kept = [one for one in effects if not effect(one.name).moves_board or one.name == _LEVEL]
    kept = [one for one in kept if one.name != TILT_SENSOR]
    sensor = next((one.parameters for one in effects if one.name == TILT_SENSOR), {})
    problem = Problem.of(
        played,
        segments(played),
        effects=kept,
        time_scale=time_scale,
        fixed={f"gear_{axis}": 1.0 for axis in "xy" if f"gain_{axis}" not in sensor},
        engine=engine,
        threads=threads,
    )
    return Stage(problem, problem.fit(starts=starts, seed=seed, progress=progress))


def joined(
    actuator: Stage, board: Stage | None
) -> tuple[dict[str, Parameter], dict[str, dict[str, Parameter]]]:
    """Return the five parameters and those of the effects, by name, of the complete chain.

    Let m be the measured tilt and z its value at command 0. The board's tilt is k (m - z) + bias. Hence
    gear = k G, gain = 1/k and zero = z - bias/k, for a gear G from command to measured tilt.
    """
    first = actuator.parameters
    second = board.parameters if board is not None else {}
    five = {name: second.get(name, first[name]) for name in PARAMETERS}
    effects = by_effect(first) | by_effect(second)
    sensor = effects.get(TILT_SENSOR, {})
    for axis in "xy":
        gain = second.get(f"gear_{axis}", Parameter(1.0))
        five[f"gear_{axis}"] = _times(first[f"gear_{axis}"], gain)
        bias = second.get(f"{_LEVEL}.bias_{axis}_rad", Parameter(0.0))
        reading = first[f"{TILT_SENSOR}.zero_{axis}_rad"]
        offset = _times(bias, Parameter(1.0 / gain.value))
        sensor[f"zero_{axis}_rad"] = _less(reading, offset)
        if gain.low is not None and gain.high is not None:
            sensor[f"gain_{axis}"] = Parameter(1.0 / gain.value, 1.0 / gain.high, 1.0 / max(gain.low, 1e-9))
    effects[TILT_SENSOR] = sensor
    if board is None:
        for name in ("rolling_friction", "observation_scale"):
            five[name] = Parameter(five[name].value)
    return five, effects


def joined_posterior(actuator: Stage, board: Stage | None, effects: Sequence[Effect]) -> Component:
    """Return the distribution of the values of the whole chain, as `joined` has them, with these effects."""
    named = [one.name for one in effects]
    first = component(actuator.information, named)
    if board is None:
        held = {
            name: Spread(first.parameters[name].value) for name in ("rolling_friction", "observation_scale")
        }
        return replace(first, parameters=first.parameters | held)
    second = with_leans(component(board.information, named), board.solution.shrunk)
    before, after = (first.size, second.size)
    one, other = _padded(first, 0, after), _padded(second, before, 0)
    found = one | other
    none = np.zeros(before + after)
    for axis in "xy":
        gear, gain = one[f"gear_{axis}"], other[f"gear_{axis}"]
        reading = one[f"{TILT_SENSOR}.zero_{axis}_rad"]
        bias = other.get(f"{_LEVEL}.bias_{axis}_rad", Spread(0.0, linear=tuple(none), power=tuple(none)))
        by_gear, by_gain, by_reading, by_bias = (
            np.array(each.linear) for each in (gear, gain, reading, bias)
        )
        powers = np.array(gear.power) + np.array(gain.power)
        k = gain.value
        found[f"gear_{axis}"] = replace(
            gear,
            value=k * gear.value,
            linear=rounded(k * by_gear + gear.value * by_gain),
            power=rounded(powers),
        )
        found[f"{TILT_SENSOR}.zero_{axis}_rad"] = replace(
            reading,
            value=reading.value - bias.value / k,
            linear=rounded(by_reading - by_bias / k + bias.value / k**2 * by_gain),
        )
        if by_gain.any() or any(gain.power):
            found[f"{TILT_SENSOR}.gain_{axis}"] = Spread(
                1.0 / k, 0.0, linear=rounded(-by_gain / k**2), power=rounded(-np.array(gain.power))
            )
    return replace(first, parameters=found)


def _padded(one: Component, before: int, after: int) -> dict[str, Spread]:
    """Return distributions by name with as many more z, which move nothing, before their own and after."""
    own = (0.0,) * one.size

    def padded(numbers: tuple[float, ...]) -> tuple[float, ...]:
        return (*(0.0,) * before, *(numbers or own), *(0.0,) * after)

    return {
        name: replace(spread, linear=padded(spread.linear), power=padded(spread.power))
        for name, spread in one.parameters.items()
    }


def _tilt_alone(recording: Recording, *, moving: bool) -> Recording:
    """Return a recording without its marble and without tilts that depend on commands before its start."""
    assert recording.tilt is not None, recording.name
    tilt = recording.tilt.copy()
    if moving and recording.stamps is not None:
        settled = recording.stamps - recording.stamps[0] >= SETTLING_S
        if np.isfinite(tilt[settled]).any():
            tilt[~settled] = np.nan
    return replace(recording, marble=np.full_like(recording.marble, np.nan), tilt=tilt)


def in_order(effects: Sequence[Effect]) -> list[Effect]:
    """Return effects in the order in which they act."""
    order = [info.name for info in catalogue()]
    return sorted(effects, key=lambda one: order.index(one.name) if one.name in order else len(order))


def _grown(problem: Problem, before: Stage, added: Effect) -> Stage:
    """Fit with one more effect, starting at the solution without it."""
    info = effect(added.name)
    points = []
    for number in range(len(_BEGINNINGS)):
        begun = {f"{info.name}.{one.name}": _beginning(problem, info, one, number) for one in info.parameters}
        begun |= {f"{info.name}.{name}": value for name, value in added.parameters.items()}
        points.append(_begun_at(problem, before, begun))
    return Stage(problem, problem.fit(points=np.array(points), rounds=1))


def _beginning(problem: Problem, info: EffectInfo, parameter: EffectParameter, number: int) -> float:
    """Return the initial value of an effect's parameter in the first, second or third start."""
    name = f"{info.name}.{parameter.name}"
    if parameter.optional or name not in problem.names:
        return parameter.neutral
    low, high = problem.ranges[problem.names.index(name)]
    if low < parameter.neutral < high:
        return float(parameter.neutral + _BEGINNINGS_OF_EITHER_SIGN[number] * (high - parameter.neutral))
    return float(low + _BEGINNINGS[number] * (high - low))


def _continued(problem: Problem, before: Stage) -> Stage:
    """Fit with more parameters, starting at the solution without them and their neutral values."""
    neutral = {f"{info.name}.{one.name}": one.neutral for info in _infos(problem) for one in info.parameters}
    return Stage(problem, problem.fit(points=_begun_at(problem, before, neutral)[None], rounds=1))


def _begun_at(problem: Problem, before: Stage, others: dict[str, float]) -> Array:
    known = dict(zip(before.problem.names, before.solution.values.tolist(), strict=True))
    return np.array([known[name] if name in known else others[name] for name in problem.names])


def _infos(problem: Problem) -> list[EffectInfo]:
    names = dict.fromkeys(name.split(".")[0] for name in problem.names[len(PARAMETERS) :])
    return [effect(name) for name in names]


def _opened(problem: Callable[[Sequence[Effect]], Problem], chosen: list[Effect], stage: Stage) -> Stage:
    """Add the optional parameters that the tilt supports, one by one or all at once.

    Each step takes the addition with the largest gain by the Bayesian information criterion, until none
    gains.
    """
    while closed := list(_optional(chosen)):
        steps = [[one] for one in closed] + ([closed] if len(closed) > 1 else [])
        widened = [_widened(chosen, step) for step in steps]
        stages = [_continued(problem(wider), stage) for wider in widened]
        gains = [
            _gain(stage.solution, wider.solution, len(step))
            for wider, step in zip(stages, steps, strict=True)
        ]
        best = int(np.argmax(gains))
        if gains[best] <= 0.0:
            break
        chosen, stage = widened[best], stages[best]
    return stage


def _optional(chosen: Sequence[Effect]) -> Iterator[tuple[str, str]]:
    """Yield effect and name of the actuator's optional parameters that have no value."""
    for one in chosen:
        info = effect(one.name)
        for parameter in info.parameters:
            if parameter.optional and parameter.name not in one.parameters and info.moves_board:
                yield info.name, parameter.name


def _widened(chosen: Sequence[Effect], opened: Sequence[tuple[str, str]]) -> list[Effect]:
    """Return effects with optional parameters added at their neutral values."""
    neutral = {
        (one.name, parameter.name): parameter.neutral
        for one in chosen
        for parameter in effect(one.name).parameters
    }
    return [
        replace(one, parameters={**one.parameters, **{n: neutral[e, n] for e, n in opened if e == one.name}})
        for one in chosen
    ]


def _gain(narrow: Solution, wide: Solution, more: int) -> float:
    """Return the gain of a wider model by the Bayesian information criterion [nats] (Schwarz, 1978).

    Residuals of an imperfect model are correlated over many rows, so only independent rows are counted.
    """
    gain, rows = 0.0, 0.0
    for axis in (0, 1):
        before, after = (_column(one, axis) for one in (narrow, wide))
        count = sum(len(part) for part in after) / _memory(after)
        if count == 0.0:
            continue
        squares = [sum(float((part**2).sum()) for part in parts) for parts in (before, after)]
        gain += 0.5 * count * float(np.log(squares[0] / max(squares[1], 1e-300)))
        rows += count
    return gain - 0.5 * more * float(np.log(max(rows, 1.0)))


def _column(solution: Solution, axis: int) -> list[Array]:
    """Return the residuals of the tilt about an axis, by segment, without gaps."""
    return [part[np.isfinite(part[:, axis]), axis] for part in solution.tilt_residuals]


def _memory(parts: Sequence[Array]) -> float:
    """Return the integrated autocorrelation time of residuals [rows], at least 1 (Sokal, 1997)."""
    power = sum(float((part**2).sum()) for part in parts)
    total = 1.0
    if power == 0.0:
        return total
    for lag in range(1, max((len(part) for part in parts), default=1)):
        share = sum(float((part[:-lag] * part[lag:]).sum()) for part in parts if len(part) > lag) / power
        if share <= 0.0:
            break
        total += 2.0 * share
    return total


def by_effect(parameters: dict[str, Parameter]) -> dict[str, dict[str, Parameter]]:
    """Group parameters named ``effect.parameter`` by effect; other parameters are dropped."""
    found: dict[str, dict[str, Parameter]] = {}
    for name, parameter in parameters.items():
        if name not in PARAMETERS:
            of_effect, _, own = name.partition(".")
            found.setdefault(of_effect, {})[own] = parameter
    return found


def _times(one: Parameter, factor: Parameter) -> Parameter:
    """Return the product of two independent parameters; relative margins add in quadrature."""
    return _combined(one.value * factor.value, (one, abs(factor.value)), (factor, abs(one.value)))


def _less(one: Parameter, other: Parameter) -> Parameter:
    """Return the difference of two independent parameters; margins add in quadrature."""
    return _combined(one.value - other.value, (one, 1.0), (other, 1.0))


def _combined(value: float, *terms: tuple[Parameter, float]) -> Parameter:
    margins = [
        slope * 0.5 * (one.high - one.low)
        for one, slope in terms
        if one.low is not None and one.high is not None
    ]
    if not margins:
        return Parameter(value)
    margin = float(np.hypot.reduce(margins))
    return Parameter(value, value - margin, value + margin)
