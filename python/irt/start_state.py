"""Where the marble was and how fast it rolled at the first row of a window, as the simulator sees it."""

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

#: Steps of the finite differences, in x, y [board edges] and their rates [board edges per second].
_STEPS = np.array([1e-4, 1e-4, 1e-3, 1e-3])
#: Gauss-Newton steps; with the base physics the third hardly moves the state any more.
_ITERATIONS = 6


@dataclass(frozen=True, eq=False)
class Inputs:
    """What is commanded in w windows of n rows.

    Attributes
    ----------
    knobs : (w, m, 2) array
        Commanded knob angles [rad]: those of the window, or of the whole recording that it is of.
    durations : (w, m) array or None
        How long each command holds [s]; without it the model's time scale tells.
    first : (w,) array
        The row of its commands in which a window begins; those before it are its history.
    issued : (w,) array
        How many commands there are; the rest fills shorter ones up.
    rows : int
        n, the rows of each window.
    rolled : (w,) array
        How far the marble has rolled before each window [board edges].
    paths : tuple of (m, 2) arrays
        Where marbles have rolled in whole recordings, a place a row [board edges].
    path : (w,) int array or None
        Which of them each window is of; by default no marble has been turned.
    hold : {"zero", "first"}
        What a command does from its row to the next, as of a `Recording`.
    before : (w, 2) array or None
        The commands before row 0, where they are known.
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
        """Return the inputs of windows without history, (w, n, 2) knob angles [rad] and (w, n) seconds."""
        windows, rows = knobs.shape[:2]
        none = np.zeros(windows, dtype=np.int64)
        return cls(knobs, durations, none, np.full(windows, rows), rows, np.zeros(windows))

    def repeated(self, times: int) -> Inputs:
        """Return each window so many times."""
        return self._taken(np.repeat(np.arange(len(self.first)), times))

    def tiled(self, times: int) -> Inputs:
        """Return all windows so many times, one set after another."""
        return self._taken(np.tile(np.arange(len(self.first)), times))

    def turned(self, radius: float) -> Array:
        """Return how that has turned marbles of a radius [board edges]: axis times angle, (w, 3) [rad]."""
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
        """Return the commands before row 0 that a simulation begins with, (w, 2); None where they were level.

        Who starts in motion has held the knobs somewhere: the first command is the best guess.
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
    """Simulate windows of one length, each from its own start state.

    Parameters
    ----------
    model : Model
        The simulator.
    inputs : Inputs
        What is commanded in w windows of n rows.
    states : (w, 4) array
        Start states: x, y [board edges] and their rates [board edges per second of simulated time].
    values : (5,) array, optional
        Parameters in the place of the model's.
    added : mapping, optional
        An effect beside the model's, or in the place of the one with its name; its values may be (w,) arrays.
    substeps : int, optional
        Physics updates a row; by default as many as the time scale says.
    seed : int or (w,) array
        Of what effects draw.
    threads : int, optional
        As for `irt.rollouts`.

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
    """Predict what the tilt sensor reads, (w, n, 2) [rad]: from the commands alone, wherever the marble is.

    Parameters
    ----------
    model : Model
        The simulator.
    inputs : Inputs
        What is commanded in w windows of n rows.
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
    """Return the start states from which the simulator meets the observations best, in least squares.

    Gauss-Newton with Levenberg's damping over position and velocity; one batch of rollouts an iteration holds
    all windows and their finite differences. The marble stays between the walls.

    Parameters
    ----------
    model : Model
        The simulator.
    inputs : Inputs
        What is commanded in w windows of n rows.
    observed : (w, n, 2) array
        Positions [board edges], NaN rows where the tracker lost the marble.
    guess : (w, 4) array
        Where to begin, as the states of `simulate`.

    Returns
    -------
    (w, 4) array
        As the states of `simulate`.
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
        # Where friction holds the marble, nothing depends on its velocity: there the step stays zero.
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
    # A marble that falls tells nothing more.
    predicted = np.where(np.isnan(predicted).any(axis=1, keepdims=True), target[:, None], predicted)
    residual = np.where(known, predicted[:, 0] - target, 0.0)
    change = (predicted[:, 1:] - predicted[:, :1]) / steps[:, :, None]
    return residual, np.where(known[:, None, :], change, 0.0).swapaxes(1, 2)
