"""Baseline: a Gaussian process for the residual acceleration of the base model, given state and commands.

Rows of smoothed recordings give the difference of the velocity after a row from that of the base model from
the same state. A Gaussian process (Rasmussen and Williams, 2006, algorithm 2.1) learns this difference, with
one length scale for all standardised inputs. Length and noise are chosen from a grid by two-fold cross-
validation over recordings. A prediction is the base model's path plus the accumulated residual acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from irt.model import Model
from irt.proof.baselines.entry import Entry, Task, by_name
from irt.proof.baselines.residual_push import advance, features, histories, predicted_with, without_effects
from irt.proof.baselines.smooth import WINDOW, Smoothed, smoothed

Array = NDArray[np.float64]

TITLE = "Gaussian process on the residual"
#: Maximum number of rows to learn from, evenly spaced.
MOST = 600
LENGTHS = (1.0, 2.0, 4.0, 8.0)
NOISES = (0.3, 1.0, 3.0, 10.0, 30.0)
#: Earlier rows whose commands are inputs.
PAST = 1


@dataclass(frozen=True, eq=False)
class Process:
    """A Gaussian process of zero mean over f inputs with o outputs, given k points.

    Attributes
    ----------
    middle, spread : (f,) arrays
        Mean and standard deviation of the inputs.
    points : (k, f) array
        Standardised training inputs.
    weights : (k, o) array
        Weights of the points.
    length : float
        Length scale of the kernel.
    """

    middle: Array
    spread: Array
    points: Array
    weights: Array
    length: float

    @classmethod
    def fitted(cls, inputs: Array, outputs: Array, length: float, noise: float) -> Process:
        """Learn (k, o) outputs from (k, f) inputs; the noise is in deviations of the outputs."""
        from scipy.linalg import cho_factor, cho_solve  # noqa: PLC0415

        middle, spread = inputs.mean(axis=0), inputs.std(axis=0)
        spread = np.where(spread > 0.0, spread, 1.0)
        points = (inputs - middle) / spread
        factor = cho_factor(_kernel(points, points, length) + noise**2 * np.eye(len(points)), lower=True)
        return cls(middle, spread, points, cho_solve(factor, outputs), length)

    def mean(self, inputs: Array) -> Array:
        """Return the mean at (w, f) inputs, (w, o)."""
        return np.asarray(
            _kernel((inputs - self.middle) / self.spread, self.points, self.length) @ self.weights
        )


def enter(task: Task) -> Entry:
    """Learn the base model's residual acceleration, and predict; name nothing."""
    runs = smoothed(task)
    if len(runs) < 2:
        return Entry(missing=f"fewer than two recordings have {WINDOW} rows")
    rows = [_rows(task.base, run) for run in runs]
    best = min(product(LENGTHS, NOISES), key=lambda one: _error(task, rows, *one))
    paths = predicted_with(_process(rows, *best).mean, task, task.tests, PAST)
    return Entry(predictions=dict(by_name(task.tests, paths)))


def _process(rows: Sequence[tuple[Array, Array]], length: float, noise: float) -> Process:
    inputs, pushes = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    every = max(1, -(-len(inputs) // MOST))
    return Process.fitted(inputs[::every], pushes[::every], length, noise)


def _error(task: Task, rows: Sequence[tuple[Array, Array]], length: float, noise: float) -> float:
    """Return the mean absolute error [board edges] of each half of the recordings, learned from the other."""
    recordings = [one for one in task.rig.recordings if len(one.knobs) >= WINDOW]
    errors = []
    for half in range(2):
        process = _process(rows[1 - half :: 2], length, noise)
        judged = recordings[half::2]
        paths = predicted_with(process.mean, task, judged, PAST)
        errors += [np.nanmean(np.abs(path - one.marble)) for path, one in zip(paths, judged, strict=True)]
    return float(np.mean(errors))


def _rows(base: Model, run: Smoothed) -> tuple[Array, Array]:
    """Return inputs (k, 8) and residual accelerations of the base model (k, 2), without the ends."""
    after = advance(without_effects(base), run.states[:-1], run.knobs[:-1], run.row_s)
    push = (run.states[1:, 2:] - after[:, 2:]) / run.row_s
    edge = min(WINDOW // 2, (len(push) - 1) // 2)
    inner = slice(edge, len(push) - edge)
    return features(run.states[:-1], histories(run.knobs, PAST)[:-1])[inner], push[inner]


def _kernel(one: Array, other: Array, length: float) -> Array:
    squares = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2.0 * one @ other.T
    return np.asarray(np.exp(-0.5 * np.maximum(squares, 0.0) / length**2))
