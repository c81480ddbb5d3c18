"""Least squares where the tilt was measured: the chain from command to marble falls apart at the tilt.

The actuator, command to tilt, is fitted to the measured tilt: nothing in it is chaotic, and no marble is
needed. The board, tilt to marble, is fitted with the measured tilt played in the place of the commands,
straight from row to row, so that what the actuator does cannot be taken for physics of the marble. In a fit
of both at once the errors of the marble, many times its tracker's noise on a real rig, pull delays away from
what the tilt shows.
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
from irt.segments import segments

Array = NDArray[np.float64]

#: So long after the start of a run in motion the tilt is not fitted [s]: nobody knows the commands before it.
#: That is several delays and lags of the actuators of labyrinths (0.05 to 0.15 s).
_SETTLING_S = 0.5
#: The effect that levels the board. The tilt alone cannot tell it from the sensor's zero.
_LEVEL = "tilt_bias"
#: Where a further effect of the actuator is begun, all others where the fit without it ended: shares of its
#: range, and where the range has both signs, shares of the way from its neutral value to an end.
_BEGINNINGS = (0.02, 0.1, 0.3)
_BEGINNINGS_OF_EITHER_SIGN = (0.02, 0.3, -0.3)


@dataclass(frozen=True, eq=False)
class Stage:
    """One half of the chain, fitted.

    Attributes
    ----------
    problem : Problem
        What was fitted.
    solution : Solution
        The outcome.
    """

    problem: Problem
    solution: Solution

    @property
    def information(self) -> Information:
        """What the recordings tell about the values."""
        return Information.of(self.problem, self.solution.values, self.solution.information)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The values by name, with 95 % intervals where they were fitted."""
        return with_intervals(self.information)


def is_chain(rig: Rig) -> bool:
    """Whether some recording has a tilt that was measured about both axes."""
    return any(has_both_tilts(recording) for recording in rig.recordings)


def without_held_marbles(rig: Rig) -> Rig:
    """Return the rig without marbles that stay in place while the tilt would move them: held, or in a hole.

    Such a marble stays within its own radius though the tilt changes by more than twice the largest rolling
    friction that the rig may have, so that no tilt in between holds a free marble.
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
    """Return the range of each of two columns, (2,), without a hundredth of its values at either end."""
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

    Effects come in one after another, in the order in which they act, each begun small from where the fit
    without it ended: from random starts a gap of backlash and a gear trade places. Optional parameters, such
    as the difference between the axes, are opened where the tilt asks for them: by the Bayesian information
    criterion, over as many rows as are independent.

    Parameters
    ----------
    rig : Rig
        Recordings, some of them with a tilt.
    effects : sequence of Effect
        All of the model's; those that do not act between command and tilt are left out.
    time_scale : float or None
        As the stamps have it.
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
    """Fit what moves the marble, with the measured tilt played; None where no marble was seen beside a tilt.

    Gears are 1 here, unless the caller names gains of the tilt sensor: then they are what these are one over.

    Parameters
    ----------
    zero : (2,) array
        What the sensor reads while the commands are 0 [rad]; it is taken off the measured tilt.
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
    """Return the five parameters and those of the effects, by name, of the whole chain.

    With played tilt m - z (z what the sensor reads at command 0) the board's tilt is k (m - z) + bias. So
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
    """Return a recording without its marble, and without the rows that commands before its start decide."""
    assert recording.tilt is not None, recording.name
    tilt = recording.tilt.copy()
    if moving and recording.stamps is not None:
        settled = recording.stamps - recording.stamps[0] >= _SETTLING_S
        if np.isfinite(tilt[settled]).any():
            tilt[~settled] = np.nan
    return replace(recording, marble=np.full_like(recording.marble, np.nan), tilt=tilt)


def in_order(effects: Sequence[Effect]) -> list[Effect]:
    """Return effects in the order in which they act."""
    order = [info.name for info in catalogue()]
    return sorted(effects, key=lambda one: order.index(one.name) if one.name in order else len(order))


def _grown(problem: Problem, before: Stage, added: Effect) -> Stage:
    """Fit with one effect more, from where the fit without it ended."""
    info = effect(added.name)
    points = []
    for number in range(len(_BEGINNINGS)):
        begun = {f"{info.name}.{one.name}": _beginning(problem, info, one, number) for one in info.parameters}
        begun |= {f"{info.name}.{name}": value for name, value in added.parameters.items()}
        points.append(_begun_at(problem, before, begun))
    return Stage(problem, problem.fit(points=np.array(points), rounds=1))


def _beginning(problem: Problem, info: EffectInfo, parameter: EffectParameter, number: int) -> float:
    """Return where a parameter of an effect is begun, the first, second or third time."""
    name = f"{info.name}.{parameter.name}"
    if parameter.optional or name not in problem.names:
        return parameter.neutral
    low, high = problem.ranges[problem.names.index(name)]
    if low < parameter.neutral < high:
        return float(parameter.neutral + _BEGINNINGS_OF_EITHER_SIGN[number] * (high - parameter.neutral))
    return float(low + _BEGINNINGS[number] * (high - low))


def _continued(problem: Problem, before: Stage) -> Stage:
    """Fit with parameters more, from where the fit without them ended and they were neutral."""
    neutral = {f"{info.name}.{one.name}": one.neutral for info in _infos(problem) for one in info.parameters}
    return Stage(problem, problem.fit(points=_begun_at(problem, before, neutral)[None], rounds=1))


def _begun_at(problem: Problem, before: Stage, others: dict[str, float]) -> Array:
    known = dict(zip(before.problem.names, before.solution.values.tolist(), strict=True))
    return np.array([known[name] if name in known else others[name] for name in problem.names])


def _infos(problem: Problem) -> list[EffectInfo]:
    names = dict.fromkeys(name.split(".")[0] for name in problem.names[len(PARAMETERS) :])
    return [effect(name) for name in names]


def _opened(problem: Callable[[Sequence[Effect]], Problem], chosen: list[Effect], stage: Stage) -> Stage:
    """Open the optional parameters that the tilt asks for: one by one, or all at once.

    Each step takes what gains most by the Bayesian information criterion, as long as something gains.
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
    """Yield effect and name of the optional parameters of the actuator that nobody has named."""
    for one in chosen:
        info = effect(one.name)
        for parameter in info.parameters:
            if parameter.optional and parameter.name not in one.parameters and info.moves_board:
                yield info.name, parameter.name


def _widened(chosen: Sequence[Effect], opened: Sequence[tuple[str, str]]) -> list[Effect]:
    """Return effects with optional parameters opened, which begin neutral."""
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
    """Return what a wider model gains by the Bayesian information criterion [nats] (Schwarz, 1978).

    The residuals of a model that is not quite right remember many rows: only independent ones count.
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
    """Return the parameters of effects by the name of the effect, from ``effect.parameter``; no others."""
    found: dict[str, dict[str, Parameter]] = {}
    for name, parameter in parameters.items():
        if name not in PARAMETERS:
            of_effect, _, own = name.partition(".")
            found.setdefault(of_effect, {})[own] = parameter
    return found


def _times(one: Parameter, factor: Parameter) -> Parameter:
    """Return a product of two independent parameters: relative margins add in squares."""
    return _combined(one.value * factor.value, (one, abs(factor.value)), (factor, abs(one.value)))


def _less(one: Parameter, other: Parameter) -> Parameter:
    """Return a difference of two independent parameters: margins add in squares."""
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
