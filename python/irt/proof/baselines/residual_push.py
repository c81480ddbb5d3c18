"""Rollouts of the base model with a learned residual acceleration, given state and commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.model import Model, Parameter
from irt.proof.baselines.entry import Task, predicted
from irt.recording import Recording
from irt.start_state import Inputs, simulate

Array = NDArray[np.float64]

#: Residual acceleration (w, 2) [edges/s^2] for `features` (w, f).
Push = Callable[[Array], Array]
#: Parts of a row, the last of which gives the velocity at its end.
_PARTS = 4


def histories(knobs: Array, past: int) -> Array:
    """Return the commands (n, 2) of each row and of p rows before it, (n, 2 + 2 p)."""
    rows = np.arange(len(knobs))
    return np.concatenate([knobs[np.maximum(rows - back, 0)] for back in range(past + 1)], axis=1)


def features(states: Array, commands: Array) -> Array:
    """Return the inputs (w, 4 + c): states (w, 4), and commands with their `histories` (w, c)."""
    return np.concatenate([states, commands], axis=1)


def predicted_with(push: Push, task: Task, tests: Sequence[Recording], past: int) -> list[Array]:
    """Return the path (n, 2) in each test, all of one length together; `past` is that of `histories`."""
    predictions = predicted(task.base, tests)
    paths: list[Array] = [np.zeros((0, 2))] * len(tests)
    for rows in sorted({len(test.knobs) for test in tests}):
        chosen = [i for i, test in enumerate(tests) if len(test.knobs) == rows]
        commands = np.array([histories(tests[i].knobs, past) for i in chosen])
        base = np.array([predictions[tests[i].name] for i in chosen])
        path = rolled(push, base, commands, task.row_s(tests[chosen[0]]), task.base.reach)
        for i, one in zip(chosen, path, strict=True):
            paths[i] = one
    return paths


def rolled(push: Push, base: Array, commands: Array, row_s: float, reach: Array) -> Array:
    """Return paths (w, n, 2): base paths (w, n, 2) plus the residual acceleration, inside the rim.

    The commands (w, n, c) have their `histories`.
    Apart from friction and walls, the base model's acceleration depends only on the commands. Therefore its
    path is kept, and the displacement by the residual acceleration is added to it.
    """
    velocity = np.gradient(base, row_s, axis=1)
    added, rate = np.zeros_like(base), np.zeros_like(base[:, 0])
    for row in range(base.shape[1] - 1):
        states = np.concatenate([base[:, row] + added[:, row], velocity[:, row] + rate], axis=1)
        pushed = push(features(states, commands[:, row]))
        moved = base[:, row + 1] + added[:, row] + rate * row_s + 0.5 * pushed * row_s**2
        inside = np.clip(moved, -reach, reach)
        rate = np.where(inside == moved, rate + pushed * row_s, 0.0)
        added[:, row + 1] = inside - base[:, row + 1]
    return base + added


def stepped(push: Push, base: Model, starts: Array, signals: tuple[Array, Array], row_s: float) -> Array:
    """Return paths (w, n, 2) of the base model, row by row, with the residual acceleration in between.

    Starts are states (w, 4) in row 0; signals are commands (w, n, 2) and their `histories` (w, n, c).
    """
    reach, states = base.reach, starts
    knobs, commands = signals
    level = without_effects(base)
    path = [states[:, :2]]
    for row in range(knobs.shape[1] - 1):
        pushed = push(features(states, commands[:, row]))
        after = advance(level, states, knobs[:, row], row_s)
        moved = after[:, :2] + 0.5 * pushed * row_s**2
        inside = np.clip(moved, -reach, reach)
        rate = np.where(inside == moved, after[:, 2:] + pushed * row_s, 0.0)
        states = np.concatenate([inside, rate], axis=1)
        path.append(inside)
    return np.stack(path, axis=1)


def without_effects(base: Model) -> Model:
    """Return the base model for marbles in motion, as `advance` takes it."""
    parameters = {name: Parameter(one.value) for name, one in base.parameters.items()}
    return replace(base, start="moving", effects=(), parameters=parameters)


def advance(level: Model, states: Array, knobs: Array, row_s: float) -> Array:
    """Return the states (w, 4) after a row of a model without effects, for (w, 4) states, (w, 2) commands."""
    part = row_s / _PARTS
    inputs = Inputs.of_whole(
        np.repeat(knobs[:, None], _PARTS + 1, axis=1), np.full((len(knobs), _PARTS + 1), part)
    )
    path = simulate(level, inputs, states, threads=1)
    # Exact under constant acceleration.
    speed = (3.0 * path[:, -1] - 4.0 * path[:, -2] + path[:, -3]) / (2.0 * part)
    return np.concatenate([path[:, -1], speed], axis=1)
