"""Estimate start states of windows: position and velocity of the marble in the first row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.engine import rollouts, turned
from irt.model import Model
from irt.recording import Hold
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Finite-difference steps of x, y [board edges] and their rates [board edges per second].
_STEPS = np.array([1e-4, 1e-4, 1e-3, 1e-3])
#: Gauss-Newton steps; with the base physics three suffice.
_ITERATIONS = 6


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of w windows of n rows.

    Attributes
    ----------
    knobs : (w, m, 2) array
        Commanded knob angles [rad], of the window or of its complete recording.
    durations : (w, m) array or None
        Duration of each command [s]; None to use the model's time scale.
    first : (w,) array
        Row of the commands in which a window starts; earlier commands are its history.
    issued : (w,) array
        Number of commands; the rest is padding.
    rows : int
        n, the rows of each window.
    rolled : (w,) array
        Path length of the marble before each window [board edges].
    paths : tuple of (m, 2) arrays
        Paths of the marble in complete recordings [board edges].
    path : (w,) int array or None
        Index of the path of each window; by default the marble has not been rotated.
    hold : {"zero", "first"}
        Hold of a command until the next row, as in `Recording`.
    before : (w, 2) array or None
        The commands before row 0, if known.
    """

    knobs: Array
    durations: Array | None
    first: NDArray[np.int64]
    issued: NDArray[np.int64]
    rows: int
    rolled: Array
    paths: tuple[Array, ...] = ()
    path: NDArray[np.int64] | None = None
    hold: Hold = "zero"
    before: Array | None = None

    @classmethod
    def of_whole(cls, knobs: Array, durations: Array | None = None) -> Inputs:
        """Return the inputs of windows without history: knob angles (w, n, 2) [rad], durations (w, n) [s]."""
        windows, rows = knobs.shape[:2]
        none = np.zeros(windows, dtype=np.int64)
        return cls(knobs, durations, none, np.full(windows, rows), rows, np.zeros(windows))

    def repeated(self, times: int) -> Inputs:
        """Return each window repeated `times` times."""
        return self._taken(np.repeat(np.arange(len(self.first)), times))

    def tiled(self, times: int) -> Inputs:
        """Return the sequence of windows repeated `times` times."""
        return self._taken(np.tile(np.arange(len(self.first)), times))

    def turned(self, radius: float) -> Array:
        """Return the rotation vectors (w, 3) [rad] of marbles of a radius [board edges] by the paths."""
        found = np.zeros((len(self.first), 3))
        for index, path in enumerate(self.paths):
            own = np.asarray(self.path == index)
            if self.first[own].any():
                found[own] = turned(path, radius)[self.first[own]]
        return found

    def _taken(self, windows: NDArray[np.int64]) -> Inputs:
        durations = None if self.durations is None else self.durations[windows]
        return Inputs(
            self.knobs[windows],
            durations,
            self.first[windows],
            self.issued[windows],
            self.rows,
            self.rolled[windows],
            self.paths,
            None if self.path is None else self.path[windows],
            self.hold,
            None if self.before is None else self.before[windows],
        )

    def knobs_before(self, model: Model) -> Array | None:
        """Return the commands before row 0, (w, 2); None for level knobs.

        For recordings in motion, the first command is the best estimate if they are unknown.
        """
        if self.before is not None:
            return self.before
        return self.knobs[:, 0] if model.start == "moving" else None


def simulate(
    model: Model,
    inputs: Inputs,
    states: Array,
    *,
    values: Array | None = None,
    added: Mapping[str, Any] | None = None,
    substeps: int | None = None,
    seed: NDArray[np.int64] | int = 0,
    threads: int | None = None,
) -> Array:
    """Simulate windows of equal length, each from its own start state.

    Parameters
    ----------
    model : Model
        The model.
    inputs : Inputs
        Inputs of w windows of n rows.
    states : (w, 4) array
        Start states: x, y [board edges] and their rates [board edges per second of simulated time].
    values : (5,) array, optional
        Parameters that replace the model's.
    added : mapping, optional
        An additional effect, which replaces one with the same name; its values may be (w,) arrays.
    substeps : int, optional
        Physics updates per row; by default given by the time scale.
    seed : int or (w,) array
        Random seed of stochastic effects.
    threads : int, optional
        As in `irt.rollouts`.

    Returns
    -------
    (w, n, 2) array
        Predicted positions [board edges], the start in row 0.
    """
    effects: list[Mapping[str, Any]] = [
        {"name": effect.name, **effect.parameters}
        for effect in model.effects
        if added is None or effect.name != added["name"]
    ]
    own = model.values if values is None else values
    if added is not None:
        effects.append(added)
    edge_m = model.board.edge_x_m / own[PARAMETERS.index("observation_scale")]
    turns = any(effect(one["name"]).turns for one in effects)
    return rollouts(
        np.tile(own, (len(states), 1)),
        inputs.knobs,
        rig=model,
        effects=effects,
        start=states[:, :2],
        start_velocity=states[:, 2:],
        rolled=inputs.rolled * edge_m,
        turned=inputs.turned(model.marble.radius_m / edge_m) if turns else None,
        durations=inputs.durations,
        time_step=model.time_step,
        substeps=None if substeps is None else np.full(len(states), substeps),
        first=inputs.first,
        issued=inputs.issued,
        rows=inputs.rows,
        knobs_before=inputs.knobs_before(model),
        hold=inputs.hold,
        seed=seed,
        threads=threads,
    )


def simulate_tilt(model: Model, inputs: Inputs) -> Array:
    """Predict the readings of the tilt sensor from the commands, (w, n, 2) [rad].

    Parameters
    ----------
    model : Model
        The model.
    inputs : Inputs
        Inputs of w windows of n rows.
    """
    _, tilt = rollouts(
        np.tile(model.values, (len(inputs.first), 1)),
        inputs.knobs,
        rig=model,
        effects=[{"name": one.name, **one.parameters} for one in model.effects],
        durations=inputs.durations,
        time_step=model.time_step,
        first=inputs.first,
        issued=inputs.issued,
        rows=inputs.rows,
        knobs_before=inputs.knobs_before(model),
        hold=inputs.hold,
        tilt=True,
    )
    return tilt


def estimate_start_states(model: Model, inputs: Inputs, observed: Array, guess: Array) -> Array:
    """Return the start states that fit the observations best, by least squares.

    Levenberg-Marquardt over position and velocity. Each iteration is one batch of rollouts of all windows and
    their finite differences. The marble stays between the walls.

    Parameters
    ----------
    model : Model
        The model.
    inputs : Inputs
        Inputs of w windows of n rows.
    observed : (w, n, 2) array
        Observed positions [board edges], NaN in rows where the tracker lost the marble.
    guess : (w, 4) array
        Initial start states, as in `simulate`.

    Returns
    -------
    (w, 4) array
        Start states, as in `simulate`.
    """
    reach = np.append(model.reach, [np.inf, np.inf])

    def linearise(states: Array) -> tuple[Array, Array]:
        return _linearise(model, inputs, observed, states)

    states = np.clip(guess, -reach, reach)
    residual, jacobian = linearise(states)
    damping = np.full((len(states), 1), 1e-3)
    for _ in range(_ITERATIONS):
        gradient = np.einsum("wij,wi->wj", jacobian, residual)
        normal = np.einsum("wij,wik->wjk", jacobian, jacobian)
        # If friction holds the marble, nothing depends on its velocity, and the step stays zero.
        diagonal = damping * np.einsum("wjj->wj", normal) + 1e-12
        step = np.linalg.solve(normal + np.eye(4) * diagonal[:, None, :], gradient[..., None])[..., 0]
        trial = np.clip(states - step, -reach, reach)
        trial_residual, trial_jacobian = linearise(trial)
        better = (trial_residual**2).sum(axis=1) < (residual**2).sum(axis=1)
        damping[better] /= 10.0
        damping[~better] *= 10.0
        states[better] = trial[better]
        residual[better] = trial_residual[better]
        jacobian[better] = trial_jacobian[better]
    return states


def _linearise(model: Model, inputs: Inputs, observed: Array, states: Array) -> tuple[Array, Array]:
    """Return (w, 2n) residuals, zero in lost rows, and their (w, 2n, 4) derivatives."""
    windows = len(states)
    steps = np.where(states > 0.0, -_STEPS, _STEPS)  # towards the centre, away from the walls
    moved = states[:, None, :] + steps[:, None, :] * np.eye(4)
    tried = np.concatenate([states[:, None, :], moved], axis=1).reshape(-1, 4)
    predicted = simulate(model, inputs.repeated(5), tried).reshape(windows, 5, -1)
    target = observed.reshape(windows, -1)
    known = ~np.isnan(target)
    # A fallen marble carries no further information.
    predicted = np.where(np.isnan(predicted).any(axis=1, keepdims=True), target[:, None], predicted)
    residual = np.where(known, predicted[:, 0] - target, 0.0)
    change = (predicted[:, 1:] - predicted[:, :1]) / steps[:, :, None]
    return residual, np.where(known[:, None, :], change, 0.0).swapaxes(1, 2)
