"""Identifiability of the five parameters, and detectability of each effect of the catalogue.

To first order around a fit from one start, in windows of some seconds. Changes of the predicted path are
projected off those by start states and, for effects, by the five parameters. The remainder is compared with
the tracker's noise; residuals of missing physics are not included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectInfo, EffectParameter, effect, hypothetical
from irt.checking.responses import Answer, first_values
from irt.checking.result import Detectable, Identified
from irt.checking.runs import row_step
from irt.display import in_rows
from irt.engine import SUBSTEP_S
from irt.fitting.effect_size import size_of, sizes_of, strong_values, try_path
from irt.fitting.information import Information
from irt.fitting.problem import Problem, in_unit_of
from irt.fitting.robust import mean_absolute
from irt.fitting.sentences import unidentifiable
from irt.model import Model
from irt.recording import MARBLE
from irt.rig import PARAMETERS, Rig
from irt.segments import LEAD_ROWS, Segment, guess, inputs_of, segments
from irt.start_state import estimate_start_states, simulate

Array = NDArray[np.float64]

#: Standard errors for a detectable effect: five are not reached by chance among all effects and sizes, and
#: with 1.645 more they are reached in 95 of 100 recordings.
SHOWS = 5.0 + 1.645
#: Most iterations of the fit: from gears of a regression it converges in 8 to 30, a few milliseconds each.
_ITERATIONS = 40
#: Standard errors of a 95 % interval.
_INTERVAL = 1.96
#: Length of a window [s], and its minimum number of rows; in longer windows the linearisation fails.
_WINDOW_S, _WINDOW_ROWS = 2.5, 24
#: Maximum number of simulated windows, spread over all runs, and of simulated rows including their histories.
#: The windows that are left out count by their number.
_LEAST_WINDOWS, _MOST_WINDOWS = 12, 48
_MOST_ROWS = 5000
#: Minimum share of a window's rows with a tracked marble.
_SEEN = 0.5
#: Number of sizes of each effect, over three decades, and of draws of its other parameters.
_SIZES, _OTHERS = 7, 4
_DECADES = 3.0
#: Changes of start states for derivatives [board edges, board edges a row], and of parameters [their share].
_STEP, _PART = 1e-4, 1e-3
#: Length of physics updates in the screening relative to the engine's own.
_COARSENESS = 4.0

#: Distance from the rim below which the marble touches it [board edges].
_AT_RIM = 0.002
#: Share of an undetermined direction above which a parameter is not identified.
_FREE = 0.1
#: Number of standard errors below which a change is rounding.
_NOTHING = 1e-3

_TIME, _SCALE = PARAMETERS.index("time_scale"), PARAMETERS.index("observation_scale")


def identify(
    rig: Rig, noise: Mapping[str, float | None], answers: Mapping[str, Answer], *, threads: int | None = None
) -> Identified | None:
    """Return what the recordings can identify; None without a window with a tracked marble.

    Parameters
    ----------
    rig : Rig
        The recordings.
    noise : mapping
        Noise of each column [its own unit]; None for a constant axis.
    answers : mapping
        From `irt.checking.responses.responses`; start values of the fit.
    threads : int, optional
        Threads of the engine; by default one for each core.
    """
    step = row_step(rig)
    time_scale = None if step is None else step / SUBSTEP_S
    stretches = [one for one in segments(rig) if one.run.has_marble]
    windows = _windows(rig, stretches, time_scale)
    if not windows or all(noise.get(name) is None for name in MARBLE):
        return None
    begin = first_values(rig, time_scale, answers.get("marble"))
    problem = Problem.of(rig, stretches, time_scale=time_scale, threads=threads)
    (found,) = problem.refine(begin[None], iterations=_ITERATIONS)
    values = np.where(np.isfinite(found.values), found.values, begin)
    linear = _Linear.of(rig, windows, values, noise, stamped=time_scale is not None, threads=threads)
    information = _information(rig, linear, values, time_scale)
    low, high = information.ranges.T
    widths = [information.margin(axis) for axis in np.eye(len(PARAMETERS))]
    held = np.linalg.norm(information.directions[information.flat], axis=0)
    intervals = {
        name: None
        if not information.free[index] or held[index] > _FREE
        else float(widths[index] * information.widths[index])
        for index, name in enumerate(PARAMETERS)
    }
    if time_scale is not None:
        intervals["time_scale"] = 0.0
    return Identified(
        intervals=intervals,
        values=dict(zip(PARAMETERS, values.tolist(), strict=True)),
        misses=_misses(found.residuals, [noise.get(name) for name in MARBLE]),
        unidentifiable=unidentifiable(information, low, high),
        effects=tuple(
            shown
            for info in hypothetical()
            for one in _of_effect(linear, in_unit_of(rig, info))
            if (shown := one if time_scale is not None else _without_time(one, values[_TIME] * SUBSTEP_S))
        ),
    )


def _misses(residuals: Sequence[Array], noise: Sequence[float | None]) -> float:
    """Return the mean absolute residual of (n, 2) residuals over that of the noise of each axis."""
    known = [axis for axis, one in enumerate(noise) if one]
    scales = mean_absolute(1.0) * np.array([noise[axis] for axis in known], dtype=np.float64)
    return float(np.nanmean(np.abs(np.concatenate(residuals)[:, known]) / scales)) if known else math.nan


def _windows(rig: Rig, stretches: Sequence[Segment], time_scale: float | None) -> list[Segment]:
    """Return windows of one length, spread over all runs; shorter if all runs are."""
    step_s = (sum(rig.ranges["time_scale"]) / 2.0 if time_scale is None else time_scale) * SUBSTEP_S
    runs = list(dict.fromkeys(one.run for one in stretches))
    rows = max(_WINDOW_ROWS, round(_WINDOW_S / step_s))
    rows = min(rows, max((len(run.knobs) for run in runs), default=0))
    found = []
    for run in runs:
        for first in range(0, len(run.knobs) - rows + 1, max(rows, 1)):
            stretch = slice(first, first + rows)
            seen = run.seen[stretch]
            if seen.sum() >= max(LEAD_ROWS, _SEEN * rows):
                start = guess(run, stretch, step_s, 2)
                found.append(Segment(run, stretch, start[:2], start[2:]))
    return found


@dataclass(frozen=True, eq=False)
class _Projection:
    """Projection of changes of w windows of n rows off those by start states and parameters.

    Attributes
    ----------
    weights : (w, 2 n) array
        Inverse noise, times the square root of the number of windows that each represents; 0 in ignored rows.
    of_states : (w, 4, 2 n) array
        Orthonormal weighted changes by the start state; zeros for missing ones.
    of_base : (b, w * 2 n) array
        Orthonormal weighted changes by the five parameters.
    base : (5, w * 2 n) array
        Weighted changes by the whole range of a parameter, projected off start states.
    """

    weights: Array
    of_states: Array
    of_base: Array
    base: Array

    @classmethod
    def of(cls, weights: Array, by_states: Array, by_base: Array) -> _Projection:
        """Return the projection, from (w, 4, 2 n) changes by start states and (5, w, 2 n) by parameters."""
        of_states = _orthonormal(by_states * weights[:, None, :])
        none = cls(weights, of_states, np.zeros((0, weights.size)), by_base)
        base = none.freed(by_base)
        directions, sizes, _ = np.linalg.svd(base.T, full_matrices=False)
        keep = sizes > 1e-6 * max(float(sizes.max(initial=0.0)), 1e-300)
        return cls(weights, of_states, directions[:, keep].T, base)

    def freed(self, changes: Array) -> Array:
        """Return (k, w, 2 n) changes weighted and projected, (k, w * 2 n)."""
        weighted = changes * self.weights
        inside = np.einsum("wan,kwn->kwa", self.of_states, weighted)
        weighted = (weighted - np.einsum("kwa,wan->kwn", inside, self.of_states)).reshape(len(changes), -1)
        return np.asarray(weighted - (weighted @ self.of_base.T) @ self.of_base)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Predictions in windows, and the significance of their changes in standard errors.

    Attributes
    ----------
    simulate : callable
        From start states (k * w, 4) to predictions (k * w, n, 2), with coarse updates.
    states : (w, 4) array
        Start states.
    plain : (w, 2 n) array
        Predictions without effects.
    between : _Projection
        Projection over the rows before a window's first impact; after it small changes grow nonlinearly.
    whole : _Projection
        Projection over all rows, for effects on impacts.
    of_scale : float
        Significance of the whole range of the observation scale from positions at the rim, in standard
        errors.
    """

    simulate: Callable[..., Array]
    states: Array
    plain: Array
    between: _Projection
    whole: _Projection
    of_scale: float

    @classmethod
    def of(
        cls,
        rig: Rig,
        windows: Sequence[Segment],
        values: Array,
        noise: Mapping[str, float | None],
        *,
        stamped: bool,
        threads: int | None,
    ) -> _Linear:
        """Return the windows of a rig around five values, linearised."""
        played = float(np.mean([one.first_row + len(one.knobs) for one in windows]))
        count = int(np.clip(_MOST_ROWS / played, _LEAST_WINDOWS, _MOST_WINDOWS))
        taken = np.unique(np.linspace(0, len(windows) - 1, min(len(windows), count)).astype(int))
        chosen = [windows[index] for index in taken]
        count = len(chosen)
        model = Model.from_rig(rig, values, time_step="continuous")
        inputs = inputs_of(chosen, whole=True)
        observed = np.array([one.observed for one in chosen])
        states = np.array([np.append(one.start, one.start_velocity) for one in chosen])
        at_rest = (inputs.first == 0) & (rig.start == "rest")
        states = estimate_start_states(model, inputs, observed, states)
        states[at_rest, 2:] = 0.0

        def predict(states: Array, coarseness: float = 1.0, **changes: Any) -> Array:
            substeps = None if stamped else max(1, round(values[_TIME] / coarseness))
            many = inputs.tiled(len(states) // count)
            return simulate(model, many, states, substeps=substeps, threads=threads, **changes)

        def change(moved: Array, **changes: Any) -> Array:
            return np.asarray(
                (predict(moved, **changes).reshape(-1, *plain.shape) - plain).reshape(-1, count, size)
            )

        plain = predict(states)
        size = plain[0].size
        step_s = values[_TIME] * SUBSTEP_S
        moves = np.array([_STEP, _STEP, _STEP / step_s, _STEP / step_s])
        signs = np.where(states > 0.0, -1.0, 1.0)
        by_states = change(np.concatenate([states + signs * moves * axis for axis in np.eye(4)])).swapaxes(
            0, 1
        )
        by_states[at_rest, 2:] = 0.0
        by_base = np.zeros((len(PARAMETERS), count, size))
        for index, name in enumerate(PARAMETERS):
            if index == _TIME and stamped:
                continue
            low, high = rig.ranges[name]
            step = _PART * max(abs(values[index]), _PART * (high - low))
            moved = values + step * (np.arange(len(values)) == index)
            by_base[index] = change(states, values=moved)[0] * (high - low) / step
        scale = np.array([noise.get(name) or np.inf for name in MARBLE])
        share = len(windows) / count
        weights = np.where(np.isfinite(observed), math.sqrt(share) / scale, 0.0)
        touches = np.abs(plain) > model.reach - _AT_RIM
        free = ~np.logical_or.accumulate(touches.any(axis=2), axis=1)
        at_rim = (touches.any(axis=1) * model.reach / scale * np.ptp(rig.ranges["observation_scale"])) ** 2
        return cls(
            simulate=predict,
            states=states,
            plain=predict(states, _COARSENESS).reshape(count, size),
            between=_Projection.of((weights * free[:, :, None]).reshape(count, size), by_states, by_base),
            whole=_Projection.of(weights.reshape(count, size), by_states, by_base),
            of_scale=math.sqrt(share * float(at_rim.sum())),
        )

    def strengths(self, name: str, draws: Array, keys: Sequence[str]) -> Array:
        """Return the significance of (k, p) values of an effect in standard errors, (k,)."""
        count = len(self.states)
        added = {"name": name, **{key: np.repeat(draws[:, i], count) for i, key in enumerate(keys)}}
        predicted = self.simulate(np.tile(self.states, (len(draws), 1)), _COARSENESS, added=added)
        changes = predicted.reshape(len(draws), count, -1) - self.plain
        found = np.linalg.norm(self.between.freed(changes), axis=1)
        if found.max() < _NOTHING:
            found = np.linalg.norm(self.whole.freed(changes), axis=1)
        return np.asarray(found)


def _information(rig: Rig, linear: _Linear, values: Array, time_scale: float | None) -> Information:
    """Return the information of the windows about the five parameters, at the tracker's noise."""
    free = np.ones(len(PARAMETERS), dtype=bool)
    free[_TIME] = time_scale is None
    ranges = np.array([rig.ranges[name] for name in PARAMETERS])
    # One more observation: positions at the rim determine the observation scale.
    of_rim = linear.of_scale * (np.arange(len(PARAMETERS)) == _SCALE)
    singular, directions = _principal(np.column_stack([linear.between.base, of_rim])[free])
    own = np.zeros((len(singular), len(PARAMETERS)))
    own[:, free] = directions
    with np.errstate(divide="ignore"):
        half_width = _INTERVAL / singular
    return Information(
        names=PARAMETERS,
        values=values,
        widths=np.where(free, np.ptp(ranges, axis=1), 1.0),
        ranges=np.stack([np.minimum(ranges[:, 0], values), np.maximum(ranges[:, 1], values)], axis=1),
        allowed=np.array([(-np.inf, np.inf)] * 2 + [(0.0, np.inf)] * 3),
        free=free,
        directions=own,
        half_width=half_width,
        offset=np.zeros(len(singular)),
    )


def _principal(changes: Array) -> tuple[Array, Array]:
    """Return the significance of principal directions of parameters [standard errors], and these."""
    lengths, directions = np.linalg.eigh(changes @ changes.T)
    return np.sqrt(np.maximum(lengths, 0.0)), directions.T


def _of_effect(linear: _Linear, info: EffectInfo) -> Iterator[Detectable]:
    """Yield the smallest detectable size of an effect, for its size or for each of its parameters alone.

    Effects with random numbers are left out.
    """
    parameters = info.required
    paths = try_path([{"name": info.name, **strong_values(info.name)}], seeds=[1, 2])
    if not np.array_equal(*paths):
        # The draws of a real rig are unknown, so a path with random numbers is not informative.
        return
    names, alone = {one.name for one in sizes_of(info.name)}, size_of(info.name) is None
    indices = [
        index
        for index, one in enumerate(parameters)
        if one.name in names and math.isfinite(one.neutral) and not one.is_choice
    ]
    if not indices:
        return
    ladders = [_ladder(parameters, index, alone=alone) for index in indices]
    draws = np.concatenate([values for values, _ in ladders])
    strengths = linear.strengths(info.name, draws, [one.name for one in parameters])
    for index, (_, sizes), found in zip(indices, ladders, np.split(strengths, len(indices)), strict=True):
        one = parameters[index]
        typical = np.median(found.reshape(_SIZES, -1), axis=1)
        usual = 0.5 * float(sizes[-1])
        at_usual = float(np.exp(np.interp(np.log(usual), np.log(sizes), np.log(np.maximum(typical, 1e-9)))))
        runs = (SHOWS / at_usual) ** 2 if at_usual > 1e-6 else math.inf
        below = sizes < usual
        smallest = _smallest(np.append(sizes[below], usual), np.append(typical[below], at_usual))
        yield Detectable(info.name, one.name, one.unit, smallest, usual, runs)


def _without_time(one: Detectable, row_s: float) -> Detectable | None:
    """Return sizes in rows instead of seconds; None if they depend on the unknown time scale."""
    known = next(p for p in effect(one.effect).parameters if p.name == one.parameter)
    name, usual, unit = in_rows(one.parameter, one.usual, one.unit, row_s)
    if known.time_power and unit == one.unit:
        return None
    smallest = None if one.smallest is None else in_rows(name, one.smallest, one.unit, row_s)[1]
    return replace(one, parameter=name, unit=unit, usual=usual, smallest=smallest)


def _ladder(parameters: tuple[EffectParameter, ...], index: int, *, alone: bool) -> tuple[Array, Array]:
    """Return values (sizes * others, p) with a ladder of sizes of one parameter, and the sizes.

    The other parameters are neutral if it acts alone, otherwise drawn.
    """
    random = np.random.default_rng(index)
    one = parameters[index]
    end = one.high if abs(one.high - one.neutral) >= abs(one.low - one.neutral) else one.low
    ladder = np.logspace(-_DECADES, 0.0, _SIZES)
    others = 1 if alone or len(parameters) == 1 else _OTHERS
    values = np.array([[p.neutral if alone else p.drawn(random) for p in parameters] for _ in range(others)])
    values = np.tile(values, (_SIZES, 1))
    values[:, index] = np.repeat(one.neutral + (end - one.neutral) * ladder, others)
    return values, abs(end - one.neutral) * ladder


def _smallest(sizes: Array, strengths: Array) -> float | None:
    """Return the size above which all sizes are detectable, by log-linear interpolation."""
    hidden = np.flatnonzero(strengths < SHOWS)
    if len(hidden) == 0:
        return float(sizes[0])
    last = int(hidden[-1])
    if last == len(sizes) - 1:
        return None
    low, high = np.log(np.maximum(strengths[last : last + 2], 1e-9))
    part = (math.log(SHOWS) - low) / (high - low)
    return float(np.exp(np.log(sizes[last]) + part * np.log(sizes[last + 1] / sizes[last])))


def _orthonormal(directions: Array) -> Array:
    """Return orthonormal rows that span those of each of (w, a, n); zeros for rows that add nothing."""
    found, sizes, _ = np.linalg.svd(directions.swapaxes(1, 2), full_matrices=False)
    keep = sizes > 1e-9 * np.maximum(sizes[:, :1], 1e-300)
    return np.asarray((found * keep[:, None, :]).swapaxes(1, 2))
