"""A hypothesis in short windows, each from a start state of its own: what it leaves over there.

In short windows everything is close to linear, and no chaos carries a small mismatch away. What start states
and the five parameters could do is taken away from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.case import Case, Fitted
from irt.engine import SUBSTEP_S
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
#: Rows before a row whose commands a window tells.
EARLIER = 10
#: Physics updates are this many times longer than the engine's own.
COARSENESS = 4.0
#: Residuals beyond so many standard deviations count no more than these.
_CLIP = 4.0


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


class Windows:
    """A hypothesis in windows of equal length, linearised.

    Parameters
    ----------
    fitted : Fitted
        The hypothesis.
    rows : int
        Of a window, at most those of the longest segment; last rows that fill none are left out.
    """

    def __init__(self, fitted: Fitted, rows: int = ROWS) -> None:
        case, self._model = fitted.case, fitted.model
        self._case = case
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

    def squared(self, nulls: int, seed: int, scale: float) -> tuple[Array, Array]:
        """Return squared residuals of each row of all windows in units of a variance, (w * n,).

        And the same of simulated noise in the same windows, (nulls, w * n): both freed of what start states
        and the five parameters could do.
        """
        noise = np.random.default_rng(seed).standard_normal((nulls, self._residual.size))
        told = np.concatenate([self._residual[None] / scale, self._freed(noise)])
        rows = (np.clip(told, -_CLIP, _CLIP) ** 2).reshape(nulls + 1, -1, 2).sum(axis=2)
        return rows[0], rows[1:]

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
