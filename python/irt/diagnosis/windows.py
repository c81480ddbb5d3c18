"""Residuals of a hypothesis in short windows with individual start states.

In short windows the motion is nearly linear, so small mismatches are not amplified by chaos. The directions
of start states and of the five parameters are projected out of the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.dataset import Dataset, Fitted
from irt.engine import SUBSTEP_S
from irt.fitting.robust import deviation
from irt.rig import PARAMETERS, RANGES
from irt.segments import Segment, inputs_of
from irt.start_state import Inputs, estimate_start_states, simulate

Array = NDArray[np.float64]

#: Rows of a short window: long enough for the marble to move, short enough for predictions not to diverge.
ROWS = 24
#: Finite-difference step of start states: board edges, and board edges per row.
_STEP = 1e-4
#: Finite-difference step of the five parameters, relative to their values.
_PART = 1e-3
#: Number of past commands that a window contains for each row.
EARLIER = 10
#: Time step of derivatives relative to the engine's own.
COARSENESS = 4.0
#: Residuals are clipped at this number of standard deviations.
_CLIP = 4.0


@dataclass(frozen=True, eq=False)
class Window:
    """A window of n rows with its prediction.

    Attributes
    ----------
    run, first : int
        Index of the fold, and first row in the recording.
    place : (n, 2) array
        Predicted positions [board edges].
    residual : (n, 2) array
        Observed minus predicted [board edges], NaN in rows without a marble.
    knobs, turn : (n, 2) arrays
        The command [rad], and its difference from the one before.
    turned : (n, EARLIER, 2) array
        These differences for this row and the rows before it.
    of_base : (5, n, 2) array
        Derivative of the prediction with each of the five parameters.
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
    """A linearised hypothesis in windows of equal length.

    Parameters
    ----------
    fitted : Fitted
        The hypothesis.
    rows : int
        Length of a window, at most that of the longest segment; incomplete windows are dropped.
    """

    def __init__(self, fitted: Fitted, rows: int = ROWS) -> None:
        dataset, self._model = fitted.dataset, fitted.model
        self._dataset = dataset
        rows = min(rows, max(len(segment.knobs) for segment in dataset.segments))
        self._inputs, self._observed, guess, self._runs = _cut(dataset, rows)
        self._at_rest = np.array([dataset.rig.start == "rest" and first == 0 for first in self._inputs.first])
        self._states = estimate_start_states(self._model, self._inputs, self._observed, guess)
        self._states[self._at_rest, 2:] = 0.0
        self._predicted = simulate(self._model, self._inputs, self._states)
        # Derivatives use differences between simulations of equal time step.
        self._coarse = self._simulated(self._states)
        residual = self._observed - self._predicted
        self._known = np.isfinite(residual)
        scale = max(dataset.noise, deviation(residual))
        self._weights = np.where(
            self._known, 1.0 / np.maximum(1.0, np.abs(np.nan_to_num(residual)) / (_CLIP * scale)), 0.0
        )
        self._of_states = self._state_directions()
        self._of_base = np.zeros((0, residual.size))
        self._base = self._base_directions()
        base = self._projected(self._base)
        norms = np.linalg.norm(base, axis=1)
        self._of_base = np.linalg.qr(base[norms > 1e-9 * max(norms.max(initial=0.0), 1e-300)].T)[0].T
        self._residual = self._projected(np.nan_to_num(residual)[None])[0]

    def windows(self) -> list[Window]:
        """Return all windows with their predictions."""
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
        """Return squared residuals of all rows in units of a variance, (w * n,), and those of nulls.

        Nulls are simulated noise in the same windows, (nulls, w * n). The directions of start states and of
        the five parameters are projected out of both.
        """
        noise = np.random.default_rng(seed).standard_normal((nulls, self._residual.size))
        scaled = np.concatenate([self._residual[None] / scale, self._projected(noise)])
        rows = (np.clip(scaled, -_CLIP, _CLIP) ** 2).reshape(nulls + 1, -1, 2).sum(axis=2)
        return rows[0], rows[1:]

    def _state_directions(self) -> Array:
        """Return orthonormal derivatives of each window with its start state, (w, 4, n * 2), or zeros."""
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
        """Return derivatives of all windows with the five parameters, (5, w * n * 2)."""
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
        """Simulate all windows k times from (k * w, 4) states: (k * w, n, 2)."""
        # A coarse time step suffices for derivatives.
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
            threads=self._dataset.threads,
        )

    def _projected(self, changes: Array) -> Array:
        """Weight (k, w * n * 2) changes, and project out start states and the five parameters."""
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
    """Return orthonormal rows that span those of (w, a, n); dependent rows are zero."""
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


def _cut(dataset: Dataset, rows: int) -> tuple[Inputs, Array, Array, NDArray[np.int64]]:
    """Return commands, positions (w, n, 2), initial start states (w, 4) and folds of windows."""
    pieces: list[Segment] = []
    folds: list[int] = []
    for segment, fold in zip(dataset.segments, dataset.folds, strict=True):
        pieces += [
            segment.cut(first, first + rows)
            for first in range(0, len(segment.knobs) - rows + 1, rows)
            if np.isfinite(segment.observed[first : first + rows]).all(axis=1).sum() >= rows // 2
        ]
        folds += [int(fold)] * (len(pieces) - len(folds))
    observed = np.array([piece.observed for piece in pieces])
    middle = (
        float(np.mean(dataset.rig.ranges["time_scale"])) if dataset.time_scale is None else dataset.time_scale
    )
    guesses = _guesses(observed, middle * SUBSTEP_S)
    return inputs_of(pieces, whole=True), observed, guesses, np.array(folds)


def _guesses(observed: Array, step_s: float) -> Array:
    """Return start states (w, 4) from a parabola fitted to the first observed rows."""
    states = np.zeros((len(observed), 4))
    for state, seen in zip(states, observed, strict=True):
        rows = np.flatnonzero(np.isfinite(seen).all(axis=1))[:8]
        coefficients = np.polynomial.polynomial.polyfit(rows, seen[rows], min(2, len(rows) - 1))
        state[:2] = coefficients[0]
        state[2:] = coefficients[1] / step_s
    return states
