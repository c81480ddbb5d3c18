"""What effects would change, window by window, beside what a hypothesis leaves over: where to look first.

In short windows, each from a start state of its own, everything is close to linear: what a draw of an
effect's parameters changes is simulated, freed of what start states and the five parameters could do as well,
and laid beside the residuals. So thousands of draws cost less than one fit.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectParameter, effect
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.hypotheses import is_rough
from irt.engine import SUBSTEP_S
from irt.fitting.effect_size import size_of
from irt.fitting.robust import deviation
from irt.rig import PARAMETERS, RANGES
from irt.segments import Segment, inputs_of
from irt.start_state import Inputs, estimate_start_states, simulate

Array = NDArray[np.float64]

#: Rows of a short window: the marble gets some way, and yet is not led astray.
ROWS = 24
#: Changes of start states for derivatives: board edges, and board edges a row.
_STEP = 1e-4
#: Change of the five parameters for derivatives, relative to their values.
_PART = 1e-3
#: Draws of an effect with one, two, and more parameters.
DRAWS = (32, 128, 512)
#: Draws of an effect of which a little more is another.
OF_ROUGH = 1024
#: Rows before a row whose commands a window tells.
EARLIER = 10
#: Physics updates are this many times longer than the engine's own.
COARSENESS = 4.0
#: Residuals beyond so many standard deviations count no more than these.
_CLIP = 4.0
#: Share of a parameter's range over which its changes are taken for straight lines.
_STRAIGHT = 0.02
#: Smallest size drawn, as a share of the largest.
_LEAST = 1e-3
#: Without stamps a row may last so many times as long as a hypothesis has it, or so many times less.
_SLOWER = 3.0


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of an effect's p parameters, the best first.

    Attributes
    ----------
    values : (k, p) array
        In the catalogue's order.
    explained : (k,) array
        Share of the sum of squares that each takes away, from 0 to 1.
    """

    values: Array
    explained: Array


@dataclass(frozen=True, eq=False)
class Window:
    """One window of n rows, as the hypothesis predicts it.

    Attributes
    ----------
    run, first : int
        Which fold it is of, and the recording's row where it begins.
    place : (n, 2) array
        Predicted [board edges].
    residual : (n, 2) array
        Observed minus predicted [board edges], NaN where nothing was seen.
    knobs, turn : (n, 2) arrays
        The command that holds [rad], and its difference from the one before.
    turned : (n, EARLIER, 2) array
        Those differences of this row and of rows before it.
    of_base : (5, n, 2) array
        Change of the prediction with each of the five parameters.
    """

    run: int
    first: int
    place: Array
    residual: Array
    knobs: Array
    turn: Array
    turned: Array
    of_base: Array


class Screen:
    """A hypothesis in windows of equal length, linearised.

    Parameters
    ----------
    case : Case
        The recordings.
    fitted : Fitted
        The hypothesis.
    rows : int
        Of a window, at most those of the longest segment; last rows that fill none are left out.
    """

    def __init__(self, case: Case, fitted: Fitted, rows: int = ROWS) -> None:
        self._case, self._model = case, case.model(fitted)
        rows = min(rows, max(len(segment.knobs) for segment in case.segments))
        self._inputs, self._observed, guess, self._runs = _cut(case, rows)
        self._at_rest = np.array([case.rig.start == "rest" and first == 0 for first in self._inputs.first])
        self._states = estimate_start_states(self._model, self._inputs, self._observed, guess)
        self._states[self._at_rest, 2:] = 0.0
        self._predicted = simulate(self._model, self._inputs, self._states)
        # What changes is taken from what is simulated as coarsely.
        self._coarse = self._simulated(self._states)
        residual = self._observed - self._predicted
        self._known = np.isfinite(residual)
        scale = max(case.noise, deviation(residual))
        self._weights = np.where(
            self._known, 1.0 / np.maximum(1.0, np.abs(np.nan_to_num(residual)) / (_CLIP * scale)), 0.0
        )
        self._of_states = self._state_directions()
        self._of_base = np.zeros((0, residual.size))
        self._base = self._base_directions()
        base = self._freed(self._base)
        norms = np.linalg.norm(base, axis=1)
        self._of_base = np.linalg.qr(base[norms > 1e-9 * max(norms.max(initial=0.0), 1e-300)].T)[0].T
        self._residual = self._freed(np.nan_to_num(residual)[None])[0]

    @property
    def squares(self) -> float:
        """Weighted sum of squares that is left."""
        return float(self._residual @ self._residual)

    def windows(self) -> list[Window]:
        """Return what the hypothesis makes of each window."""
        count, rows = len(self._states), self._inputs.rows
        of_base = self._base.reshape(len(PARAMETERS), count, rows, 2)
        found = []
        for i, first in enumerate(self._inputs.first):
            knobs = self._inputs.knobs[i]
            turns = np.concatenate([np.zeros((EARLIER - 1, 2)), np.diff(knobs, axis=0, prepend=0.0)])
            earlier = np.arange(rows)[:, None] + EARLIER - 1 - np.arange(EARLIER)
            found.append(
                Window(
                    run=int(self._runs[i]),
                    first=int(first),
                    place=self._predicted[i],
                    residual=self._observed[i] - self._predicted[i],
                    knobs=knobs[first : first + rows],
                    turn=turns[EARLIER - 1 :][first : first + rows],
                    turned=turns[first + earlier],
                    of_base=of_base[:, i],
                )
            )
        return found

    def misfits(self) -> Array:
        """Return how far each window is from noise, (w,): 1 on average if noise is all that is left.

        Wild rows count no more than a few standard deviations.
        """
        windows = len(self._states)
        left = np.clip(self._residual.reshape(windows, -1) / self._case.noise, -_CLIP, _CLIP)
        seen = self._known.reshape(windows, -1).sum(axis=1)
        return np.asarray((left**2).sum(axis=1) / np.maximum(seen - 4, 1))

    def squared(self, nulls: int, seed: int, scale: float) -> tuple[Array, Array]:
        """Return squared residuals of each row of all windows in units of a variance, (w * n,).

        And the same of simulated noise in the same windows, (nulls, w * n): both freed of what start states
        and the five parameters could do.
        """
        noise = np.random.default_rng(seed).standard_normal((nulls, self._residual.size))
        told = np.concatenate([self._residual[None] / scale, self._freed(noise)])
        rows = (np.clip(told, -_CLIP, _CLIP) ** 2).reshape(nulls + 1, -1, 2).sum(axis=2)
        return rows[0], rows[1:]

    def draws(self, name: str, count: int | None = None) -> Draws:
        """Draw an effect's parameters over their ranges, and rank the draws by what they would explain.

        The size of an effect, where one parameter is that, is the one that suits each draw best, unless a
        little more of it is another effect: a knob that moves in steps shows it only if the step is exact.
        """
        parameters, size, rough = self._plausible(name), size_of(name), is_rough(name)
        if count is None:
            count = OF_ROUGH if rough else DRAWS[min(len(parameters), len(DRAWS)) - 1]
        drawn = drawn_values(parameters, size, count, self._case.seed)
        if size is None:
            drawn = np.concatenate([self._straight(name), drawn])
        changed = self._freed(self._changes(name, drawn))
        along, length = changed @ self._residual, (changed**2).sum(axis=1)
        if size is None or rough:
            gain = 2.0 * along - length
        else:
            factor = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
            one = parameters[size]
            scaled = one.neutral + factor * (drawn[:, size] - one.neutral)
            clipped = np.clip(scaled, one.low, one.high)
            span = drawn[:, size] - one.neutral
            factor = np.divide(clipped - one.neutral, span, out=np.zeros_like(span), where=span != 0.0)
            drawn[:, size] = clipped
            gain = 2.0 * factor * along - factor**2 * length
        order = np.argsort(-gain, kind="stable")
        return Draws(drawn[order], gain[order] / max(self.squares, 1e-300))

    def _plausible(self, name: str) -> tuple[EffectParameter, ...]:
        """Return an effect's parameters, their ranges as wide as the hypothesis' time scale may be wrong."""
        parameters = effect(name).required
        return parameters if self._case.time_scale is not None else tuple(map(_of_any_clock, parameters))

    def _straight(self, name: str) -> Array:
        """Return the values that explain most if changes add up and are straight lines, (1, p)."""
        parameters = self._plausible(name)
        neutral = np.array([one.neutral for one in parameters])
        if not np.isfinite(neutral).all():
            return np.zeros((0, len(parameters)))
        low, high = np.array([(one.low, one.high) for one in parameters]).T
        steps = _STRAIGHT * np.where(high - neutral >= neutral - low, high - neutral, low - neutral)
        changed = self._freed(self._changes(name, neutral + np.diag(steps)))
        factors = np.linalg.lstsq(changed.T, self._residual)[0]
        return np.asarray(np.clip(neutral + factors * steps, low, high))[None]

    def gains(self, name: str, values: Array) -> Array:
        """Return by how many nats (k, p) values of an effect, were they true, raise the likelihood, (k,)."""
        changed = self._freed(self._changes(name, values))
        return np.asarray((changed**2).sum(axis=1) / (2.0 * self._case.noise**2))

    def _changes(self, name: str, drawn: Array) -> Array:
        """Return what draws of an effect add to the prediction, (k, w * n * 2)."""
        keys = [parameter.name for parameter in effect(name).required]
        windows, count = len(self._states), len(drawn)
        added = {"name": name, **{key: np.repeat(drawn[:, i], windows) for i, key in enumerate(keys)}}
        predicted = self._simulated(np.tile(self._states, (count, 1)), added=added)
        return (predicted.reshape(count, -1) - self._coarse.ravel()).reshape(count, -1)

    def _state_directions(self) -> Array:
        """Return orthonormal changes of each window by its start state, (w, 4, n * 2); zeros for none."""
        windows = len(self._states)
        found = np.zeros((windows, 4, self._predicted[0].size))
        for axis in range(4):
            moved = self._states.copy()
            step = _STEP if axis < 2 else _STEP / self._step_s()
            moved[:, axis] += np.where(moved[:, axis] > 0.0, -step, step)
            change = (self._simulated(moved) - self._coarse) / _STEP
            found[:, axis] = (change * self._weights).reshape(windows, -1)
        found[self._at_rest, 2:] = 0.0
        return _orthonormal(found)

    def _base_directions(self) -> Array:
        """Return changes of all windows by the five parameters, (5, w * n * 2)."""
        changes = []
        for index, name in enumerate(PARAMETERS):
            moved = self._model.values
            step = _PART * max(abs(moved[index]), _PART * (RANGES[name][1] - RANGES[name][0]))
            moved[index] += step
            changes.append((self._simulated(self._states, values=moved) - self._coarse).ravel() / step)
        return np.array(changes)

    def _simulated(
        self, states: Array, *, values: Array | None = None, added: dict[str, Any] | None = None
    ) -> Array:
        """Simulate all windows, once or more, from (k * w, 4) states: (k * w, n, 2)."""
        # Long updates: what matters is what changes, and by how much.
        substeps = max(1, round(self._model.values[PARAMETERS.index("time_scale")] / COARSENESS))
        inputs = self._inputs.tiled(len(states) // len(self._states))
        return simulate(
            self._model,
            inputs,
            states,
            values=values,
            added=added,
            substeps=None if self._inputs.durations is not None else substeps,
            seed=inputs.first,
            threads=self._case.threads,
        )

    def _freed(self, changes: Array) -> Array:
        """Weight (k, w * n * 2) changes, and take away what start states and the five parameters could do."""
        windows = len(self._states)
        weighted = changes.reshape(len(changes), windows, -1) * self._weights.reshape(windows, -1)
        inside = np.einsum("wan,kwn->kwa", self._of_states, weighted)
        weighted = (weighted - np.einsum("kwa,wan->kwn", inside, self._of_states)).reshape(len(changes), -1)
        return np.asarray(weighted - (weighted @ self._of_base.T) @ self._of_base)

    def _step_s(self) -> float:
        if self._inputs.durations is not None:
            return float(np.median(self._inputs.durations))
        return float(self._model.values[PARAMETERS.index("time_scale")]) * SUBSTEP_S


def drawn_values(parameters: tuple[EffectParameter, ...], size: int | None, count: int, seed: int) -> Array:
    """Return draws that fill the ranges, (k, p).

    Where no parameter is the effect's size, small values are as frequent as large ones.
    """
    places = _filling(len(parameters), count, seed)
    spread = _uniform if size is not None and len(parameters) > 1 else _by_magnitude
    columns = [
        _drawn(one, places[:, index], _by_factors if index != size and _is_timed(one) else spread)
        for index, one in enumerate(parameters)
    ]
    return np.stack(columns, axis=1)


@functools.cache
def _filling(dimensions: int, count: int, seed: int) -> Array:
    """Return points that fill the unit cube, (count, dimensions)."""
    from scipy.stats import qmc  # noqa: PLC0415

    return np.asarray(qmc.Sobol(dimensions, seed=seed).random(count))


def _drawn(one: EffectParameter, places: Array, spread: Callable[[EffectParameter, Array], Array]) -> Array:
    return np.where(places < 0.5, one.most, one.least) if one.is_choice else spread(one, places)


def _is_timed(one: EffectParameter) -> bool:
    """Whether it is a time, a speed or such, of one sign: what the clock is wrong by multiplies it."""
    return one.time_power != 0 and one.low > 0.0


def _of_any_clock(one: EffectParameter) -> EffectParameter:
    """Return a parameter with the values that are plausible if the time scale is wrong."""
    factor = _SLOWER ** abs(one.time_power)
    low, high = (min(end * factor, end / factor) for end in (one.low, -one.high))
    return replace(one, low=max(low, one.least), high=min(-high, one.most))


def _by_factors(one: EffectParameter, places: Array) -> Array:
    """Return values of which each factor is as frequent, (k,)."""
    return np.asarray(one.low * (one.high / one.low) ** places)


def _uniform(one: EffectParameter, places: Array) -> Array:
    return np.asarray(one.low + (one.high - one.low) * places)


def _by_magnitude(one: EffectParameter, places: Array) -> Array:
    """Return values of all magnitudes, from a thousandth of the range on, to either side of neutral."""
    if not one.low <= one.neutral <= one.high:
        return _by_factors(one, places)
    below, above = one.neutral - one.low, one.high - one.neutral
    side = places * (below + above) - below
    reach = np.where(side < 0.0, below, above)
    share = np.divide(np.abs(side), reach, out=np.zeros_like(side), where=reach > 0.0)
    return np.asarray(one.neutral + np.sign(side) * reach * _LEAST ** (1.0 - share))


def _orthonormal(directions: Array) -> Array:
    """Return orthonormal rows that span those of (w, a, n); zeros for rows that add nothing."""
    found = np.zeros_like(directions)
    for axis in range(directions.shape[1]):
        row = directions[:, axis].copy()
        length = np.linalg.norm(row, axis=1)
        for before in range(axis):
            row -= np.einsum("wn,wn->w", found[:, before], row)[:, None] * found[:, before]
        rest = np.linalg.norm(row, axis=1)
        keep = rest > 1e-6 * np.maximum(length, 1e-300)
        found[keep, axis] = row[keep] / rest[keep, None]
    return found


def _cut(case: Case, rows: int) -> tuple[Inputs, Array, Array, NDArray[np.int64]]:
    """Return commands, positions (w, n, 2), guesses of start states (w, 4) and folds of windows."""
    pieces: list[Segment] = []
    folds: list[int] = []
    for segment, fold in zip(case.segments, case.folds, strict=True):
        pieces += [
            segment.cut(first, first + rows)
            for first in range(0, len(segment.knobs) - rows + 1, rows)
            if np.isfinite(segment.observed[first : first + rows]).all(axis=1).sum() >= rows // 2
        ]
        folds += [int(fold)] * (len(pieces) - len(folds))
    observed = np.array([piece.observed for piece in pieces])
    middle = float(np.mean(case.rig.ranges["time_scale"])) if case.time_scale is None else case.time_scale
    guesses = _guesses(observed, middle * SUBSTEP_S)
    return inputs_of(pieces, whole=True), observed, guesses, np.array(folds)


def _guesses(observed: Array, step_s: float) -> Array:
    """Return start states (w, 4) from a parabola through the first rows seen."""
    states = np.zeros((len(observed), 4))
    for state, seen in zip(states, observed, strict=True):
        rows = np.flatnonzero(np.isfinite(seen).all(axis=1))[:8]
        coefficients = np.polynomial.polynomial.polyfit(rows, seen[rows], min(2, len(rows) - 1))
        state[:2] = coefficients[0]
        state[2:] = coefficients[1] / step_s
    return states
