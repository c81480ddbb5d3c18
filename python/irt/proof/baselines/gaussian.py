"""Baseline: a Gaussian process for the residual acceleration of the base model, given state and commands.

Rows of smoothed recordings give the difference of the velocity after a row from that of the base model from
the same state. A Gaussian process (Rasmussen and Williams, 2006, algorithm 2.1) learns this difference, with
one length scale for all standardised inputs. Length and noise are chosen from a grid by two-fold cross-
validation over recordings. A prediction is the base model's path plus the accumulated residual acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from irt.model import Model, Parameter
from irt.proof.baselines.entry import Entry, Task, by_name, predicted
from irt.proof.baselines.smooth import WINDOW, Smoothed, smoothed
from irt.recording import Recording
from irt.start_state import Inputs, simulate

Array = NDArray[np.float64]

TITLE = "Gaussian process on the residual"
#: Maximum number of rows to learn from, evenly spaced.
MOST = 600
LENGTHS = (1.0, 2.0, 4.0, 8.0)
NOISES = (0.3, 1.0, 3.0, 10.0, 30.0)
#: Parts of a row, the last of which gives the velocity at its end.
_PARTS = 4


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
    paths = _predicted(task, _process(rows, *best), task.tests)
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
        paths = _predicted(task, process, judged)
        errors += [np.nanmean(np.abs(path - one.marble)) for path, one in zip(paths, judged, strict=True)]
    return float(np.mean(errors))


def features(states: Array, knobs: Array, before: Array) -> Array:
    """Return the inputs (w, 8): states (w, 4), commands of this row and of the last one (w, 2)."""
    return np.concatenate([states, knobs, before], axis=1)


def advance(base: Model, states: Array, knobs: Array, row_s: float) -> Array:
    """Return the states (w, 4) after a row of the base model, from (w, 4) states under (w, 2) commands."""
    part = row_s / _PARTS
    inputs = Inputs.of_whole(
        np.repeat(knobs[:, None], _PARTS + 1, axis=1), np.full((len(knobs), _PARTS + 1), part)
    )
    level = replace(base, start="moving", effects=(), parameters=_closed(base))
    path = simulate(level, inputs, states, threads=1)
    # Exact under constant acceleration.
    speed = (3.0 * path[:, -1] - 4.0 * path[:, -2] + path[:, -3]) / (2.0 * part)
    return np.concatenate([path[:, -1], speed], axis=1)


def _closed(base: Model) -> dict[str, Parameter]:
    return {name: Parameter(one.value) for name, one in base.parameters.items()}


def _rows(base: Model, run: Smoothed) -> tuple[Array, Array]:
    """Return inputs (k, 8) and residual accelerations of the base model (k, 2), without the ends."""
    after = advance(base, run.states[:-1], run.knobs[:-1], run.row_s)
    push = (run.states[1:, 2:] - after[:, 2:]) / run.row_s
    before = np.concatenate([run.knobs[:1], run.knobs[:-2]])
    edge = min(WINDOW // 2, (len(push) - 1) // 2)
    inner = slice(edge, len(push) - edge)
    return features(run.states[:-1], run.knobs[:-1], before)[inner], push[inner]


def _predicted(task: Task, process: Process, tests: Sequence[Recording]) -> list[Array]:
    """Return the path (n, 2) in each test, all tests of one length together."""
    predictions = predicted(task.base, tests)
    paths: list[Array] = [np.zeros((0, 2))] * len(tests)
    for rows in sorted({len(test.knobs) for test in tests}):
        chosen = [i for i, test in enumerate(tests) if len(test.knobs) == rows]
        knobs = np.array([tests[i].knobs for i in chosen])
        base = np.array([predictions[tests[i].name] for i in chosen])
        rolled = _rolled(process, base, knobs, task.row_s(tests[chosen[0]]), task.base.reach)
        for i, path in zip(chosen, rolled, strict=True):
            paths[i] = path
    return paths


def _rolled(process: Process, base: Array, knobs: Array, row_s: float, reach: Array) -> Array:
    """Return paths (w, n, 2): base paths (w, n, 2) plus the residual acceleration, inside the rim.

    Apart from friction and walls, the base model's acceleration depends only on the commands. Therefore its
    path is kept, and the displacement by the residual acceleration is added to it.
    """
    velocity = np.gradient(base, row_s, axis=1)
    added, rate = np.zeros_like(base), np.zeros_like(base[:, 0])
    for row in range(base.shape[1] - 1):
        states = np.concatenate([base[:, row] + added[:, row], velocity[:, row] + rate], axis=1)
        push = process.mean(features(states, knobs[:, row], knobs[:, max(row - 1, 0)]))
        moved = base[:, row + 1] + added[:, row] + rate * row_s + 0.5 * push * row_s**2
        inside = np.clip(moved, -reach, reach)
        rate = np.where(inside == moved, rate + push * row_s, 0.0)
        added[:, row + 1] = inside - base[:, row + 1]
    return base + added


def _kernel(one: Array, other: Array, length: float) -> Array:
    squares = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2.0 * one @ other.T
    return np.asarray(np.exp(-0.5 * np.maximum(squares, 0.0) / length**2))
