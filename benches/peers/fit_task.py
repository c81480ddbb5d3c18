"""The common fitting problem of all methods: eight recordings, five unknown parameters, and the clock.

All methods except this project's get the start state. A run ends when a prediction is within 1 % of the best
fit, or when the method ends.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from irt.engine import rollouts
from irt.rig import PARAMETERS, RANGES
from peers.workload import Array

RECORDINGS, ROWS = 8, 120
#: Tracker noise, sd [board edges].
NOISE = 0.001
TRUTH = np.array([0.038, 0.068, 0.0004, 16.0, 1.06])
LOW, HIGH = np.array([RANGES[name] for name in PARAMETERS]).T
#: Numbers of periods per recording of the sines on each knob; slow ones cause many rim impacts.
DRIVES = {
    "off the rim": ((3, 4, 5, 7), (3, 4, 6, 8)),
    "with rim impacts": ((1, 2, 4, 7), (1, 3, 5, 6)),
}
#: Ratio to the best fit's error at which a fit has arrived.
CLOSE, ARRIVED = 1.1, 1.01


class Arrival(Exception):  # noqa: N818 - it is no error to arrive
    """Raised when a prediction is good enough, to end the run."""


@dataclass(frozen=True, eq=False)
class Task:
    """Recordings to fit.

    Attributes
    ----------
    commands : (8, 120, 2) array
        Knob angles [rad].
    observed : (8, 120, 2) array
        Noisy positions [board edges] of a marble that starts at rest in the centre.
    floor : float
        Root mean square error of the best fit [board edges].
    """

    commands: Array
    observed: Array
    floor: float

    def predict(self, parameters: Array, substeps: NDArray[np.int64] | None = None) -> Array:
        """Return predictions (k, 8, 120, 2) [board edges] of parameters (k, 5), all in one batch."""
        return predict(self.commands, parameters, substeps)

    def error(self, predicted: Array) -> Array:
        """Return the root mean square error (...) [board edges] of predictions (..., 8, 120, 2)."""
        return np.asarray(np.sqrt(np.mean((predicted - self.observed) ** 2, axis=(-3, -2, -1))))


@dataclass
class Trace:
    """Cost of a run so far, and times of its milestones.

    Attributes
    ----------
    rollouts : int
        Simulated recordings.
    error : float
        The smallest root mean square error so far [board edges].
    close, arrived : (float, int) or None
        Seconds and rollouts until the error was within 10 % and 1 % of the best fit's.
    """

    task: Task
    rollouts: int = 0
    error: float = np.inf
    close: tuple[float, int] | None = None
    arrived: tuple[float, int] | None = None
    began: float = field(default_factory=time.perf_counter)

    def note(self, predicted: Array) -> None:
        """Record predictions (k, 8, 120, 2).

        Raises
        ------
        Arrival
            If one of them is within 1 % of the best fit.
        """
        self.rollouts += len(predicted) * RECORDINGS
        self.reach(float(self.task.error(predicted).min()))
        if self.arrived is not None:
            raise Arrival

    def reach(self, error: float) -> None:
        """Record an error [board edges]."""
        self.error = min(self.error, error)
        now = (self.seconds, self.rollouts)
        if self.close is None and self.error <= CLOSE * self.task.floor:
            self.close = now
        if self.arrived is None and self.error <= ARRIVED * self.task.floor:
            self.arrived = now

    @property
    def seconds(self) -> float:
        """Return the seconds since the run began."""
        return time.perf_counter() - self.began


class Method(Protocol):
    """A method. It reports every prediction to the trace, and may end by `Arrival`."""

    def __call__(self, trace: Trace, start: Array, seed: int) -> None:
        """Fit from the start point (5,)."""


def predict(commands: Array, parameters: Array, substeps: NDArray[np.int64] | None = None) -> Array:
    """Return predictions (k, r, rows, 2) [board edges] of parameters (k, 5) under commands (r, rows, 2)."""
    many, runs = len(parameters), len(commands)
    predicted = rollouts(
        np.repeat(parameters, runs, axis=0),
        np.tile(commands, (many, 1, 1)),
        time_step="continuous",
        substeps=None if substeps is None else np.repeat(substeps, runs),
    )
    return predicted.reshape(many, runs, *commands.shape[1:])


def make_task(drive: str, seed: int) -> Task:
    """Record the marble of `TRUTH` under eight multisine drives of one of the `DRIVES`."""
    rng = np.random.default_rng(seed)
    commands = np.stack([_multisine(DRIVES[drive], rng) for _ in range(RECORDINGS)])
    clean = predict(commands, TRUTH[None])[0]
    observed = clean + rng.normal(0.0, NOISE, clean.shape)
    best = least_squares(
        lambda unit: (predict(commands, from_unit(unit)[None])[0] - observed).ravel(),
        to_unit(TRUTH),
        bounds=(0.0, 1.0),
        diff_step=1e-4,
    )
    return Task(commands, observed, float(np.sqrt(np.mean(best.fun**2))))


def _multisine(periods: Sequence[Sequence[int]], rng: np.random.Generator) -> Array:
    """Return the sum of sines with random phases on each knob (rows, 2), at most 0.1 rad."""
    phases = rng.uniform(0, 2 * np.pi, np.shape(periods))
    angles = 2 * np.pi * np.arange(ROWS)[:, None, None] / ROWS * periods + phases
    knobs = np.sin(angles).sum(axis=2)
    return np.asarray(0.1 * knobs / np.abs(knobs).max(axis=0))


def to_unit(parameters: Array) -> Array:
    """Return parameters (..., 5) as shares of the paper's ranges."""
    return np.asarray((parameters - LOW) / (HIGH - LOW))


def from_unit(unit: Array) -> Array:
    """Return the parameters (..., 5) of shares of the paper's ranges."""
    return np.asarray(LOW + unit * (HIGH - LOW))
