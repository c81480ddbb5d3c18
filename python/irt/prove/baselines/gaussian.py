"""A Gaussian process for what the base model leaves over: state and commands in, acceleration out, no physics.

Rows of smoothed recordings say how much faster the marble is after a row than the base model takes it from the
same state. A Gaussian process (Rasmussen and Williams, 2006, algorithm 2.1) with one length for all inputs,
each in its own deviation, learns that; length and noise have the largest marginal likelihood of a grid. A
prediction goes row by row: the base model, then the push.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from irt.model import Model, Parameter
from irt.prove.baselines.entry import Entry, Task, by_name
from irt.prove.baselines.smooth import WINDOW, Smoothed, smoothed
from irt.start_state import Inputs, simulate

Array = NDArray[np.float64]

TITLE = "Gaussian process on the residual"
#: Rows learned from at most, evenly taken.
MOST = 600
LENGTHS = (1.0, 2.0, 4.0, 8.0)
NOISES = (0.1, 0.3, 1.0, 3.0)
#: Parts into which a row is cut, to see how fast the marble is at its end.
_PARTS = 4


@dataclass(frozen=True, eq=False)
class Process:
    """A Gaussian process of zero mean over f inputs with o outputs, given k points.

    Attributes
    ----------
    middle, spread : (f,) arrays
        By which inputs are made alike.
    points : (k, f) array
        Inputs learned from, made alike.
    weights : (k, o) array
        Of each point.
    length : float
        Of the kernel.
    """

    middle: Array
    spread: Array
    points: Array
    weights: Array
    length: float

    @classmethod
    def fitted(cls, inputs: Array, outputs: Array) -> Process:
        """Learn (k, o) outputs from (k, f) inputs."""
        middle, spread = inputs.mean(axis=0), inputs.std(axis=0)
        spread = np.where(spread > 0.0, spread, 1.0)
        points, scale = (inputs - middle) / spread, max(float(outputs.std()), 1e-300)
        told = [
            (*_learned(points, outputs / scale, length, noise), length)
            for length, noise in product(LENGTHS, NOISES)
        ]
        _, weights, length = max(told, key=lambda one: one[0])
        return cls(middle, spread, points, scale * weights, length)

    def mean(self, inputs: Array) -> Array:
        """Return what is expected at (w, f) inputs, (w, o)."""
        return np.asarray(
            _kernel((inputs - self.middle) / self.spread, self.points, self.length) @ self.weights
        )


def enter(task: Task) -> Entry:
    """Learn what the base model leaves over, and predict; it says nothing of what that is."""
    runs = smoothed(task)
    if not runs:
        return Entry(missing=f"no recording has {WINDOW} rows")
    inputs, pushes = (np.concatenate(all_of) for all_of in zip(*(_rows(task.base, run) for run in runs), strict=True))
    every = max(1, -(-len(inputs) // MOST))
    process = Process.fitted(inputs[::every], pushes[::every])
    return Entry(predictions=dict(by_name(task.tests, _predicted(task, process))))


def features(states: Array, knobs: Array, before: Array) -> Array:
    """Return what a push may depend on, (w, 8): states (w, 4), this row's commands and the last's (w, 2)."""
    return np.concatenate([states, knobs, before], axis=1)


def advance(base: Model, states: Array, knobs: Array, row_s: float) -> Array:
    """Return where the base model takes (w, 4) states in a row of (w, 2) commands, (w, 4)."""
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
    """Return inputs (n - 1, 8) and the acceleration that the base model lacks (n - 1, 2)."""
    after = advance(base, run.states[:-1], run.knobs[:-1], run.row_s)
    push = (run.states[1:, 2:] - after[:, 2:]) / run.row_s
    before = np.concatenate([run.knobs[:1], run.knobs[:-2]])
    return features(run.states[:-1], run.knobs[:-1], before), push


def _predicted(task: Task, process: Process) -> list[Array]:
    """Return the path in each test, all tests of one length together."""
    paths: list[Array] = [np.zeros((0, 2))] * len(task.tests)
    lengths = {len(test.knobs) for test in task.tests}
    starts = task.starts()
    for rows in lengths:
        chosen = [i for i, test in enumerate(task.tests) if len(test.knobs) == rows]
        knobs = np.array([task.tests[i].knobs for i in chosen])
        row_s = task.row_s(task.tests[chosen[0]])
        for i, path in zip(chosen, _rolled(task.base, process, starts[chosen], knobs, row_s), strict=True):
            paths[i] = path
    return paths


def _rolled(base: Model, process: Process, states: Array, knobs: Array, row_s: float) -> Sequence[Array]:
    """Return paths (w, n, 2) from (w, 4) states under (w, n, 2) commands."""
    path = [states[:, :2]]
    for row in range(knobs.shape[1] - 1):
        push = process.mean(features(states, knobs[:, row], knobs[:, max(row - 1, 0)]))
        states = advance(base, states, knobs[:, row], row_s)
        states[:, 2:] += push * row_s
        states[:, :2] += 0.5 * push * row_s**2
        states[:, :2] = np.clip(states[:, :2], -base.reach, base.reach)
        path.append(states[:, :2].copy())
    return list(np.stack(path, axis=1))


def _learned(points: Array, outputs: Array, length: float, noise: float) -> tuple[float, Array]:
    """Return the log marginal likelihood, up to a constant, and the weights (k, o)."""
    from scipy.linalg import cho_factor, cho_solve  # noqa: PLC0415

    factor = cho_factor(_kernel(points, points, length) + noise**2 * np.eye(len(points)), lower=True)
    weights = cho_solve(factor, outputs)
    volume = outputs.shape[1] * float(np.log(np.diag(factor[0])).sum())
    return -0.5 * float((outputs * weights).sum()) - volume, weights


def _kernel(one: Array, other: Array, length: float) -> Array:
    squares = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2.0 * one @ other.T
    return np.asarray(np.exp(-0.5 * np.maximum(squares, 0.0) / length**2))
