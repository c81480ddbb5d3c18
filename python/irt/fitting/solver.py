"""Levenberg-Marquardt for many candidates in lockstep, with the windows' start states eliminated.

A start state touches only its own window's residuals, so the normal equations have an arrow's shape: small
diagonal blocks for the states, one dense border for the five coordinates. Eliminating the blocks leaves a
5 x 5 system (Triggs et al. 2000, "Bundle adjustment", sect. 6), whatever the number of windows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from irt.fitting import robust

if TYPE_CHECKING:
    from collections.abc import Callable

    from irt.fitting.shooting import Linearisation, Shooting

Array = NDArray[np.float64]

#: Dampings tried at once, relative to the last one that worked: one batch of rollouts for all of them.
TRIALS = (0.01, 0.3, 10.0)
#: Largest change of a coordinate in one step: further away the linearisation is not to be believed.
LONGEST_STEP = 0.7
#: Damping above which a candidate has nowhere left to go, and the gain below which it has arrived.
STUCK, ARRIVED = 1e3, 1e-5


@dataclass(frozen=True, eq=False)
class Solution:
    """Where k candidates ended.

    Attributes
    ----------
    z : (k, 5) array
    states : (k, w, 4) array
    residual : (k, w, N) array
    path : (t, k, 5) array
        z after each iteration, the start included.
    """

    z: Array
    states: Array
    residual: Array
    path: Array


def minimise(
    shooting: Shooting,
    z: Array,
    states: Array,
    noise: float,
    iterations: int,
    held: NDArray[np.bool_] | None = None,
    on_iteration: Callable[[int], None] = lambda _: None,
) -> Solution:
    """Minimise the Student-t loss of the residuals from k start points at once.

    Parameters
    ----------
    shooting : Shooting
        The residuals.
    z, states : (k, 5) and (k, w, 4) arrays
        Start points.
    noise : float
        The tracker's standard deviation [board edges]: the residuals' scale is never taken to be smaller.
    iterations : int
        At most.
    held : (5,) bool array, optional
        Coordinates that stay where they are.
    on_iteration : callable
        Called after each iteration with how many there were.
    """
    k, known = len(z), shooting.windows.known
    z, states, path = shooting.coordinates.clip(z), states.copy(), []
    residual = shooting.residuals(z, states)
    damping, active = np.full(k, 1e-2), np.ones(k, dtype=bool)
    path.append(z.copy())
    for iteration in range(iterations):
        live = np.flatnonzero(active)
        if not len(live):
            break
        line = shooting.linearise(z[live], states[live])
        scale = np.maximum(robust.scale(line.residual, known), noise)
        equations = Normal.of(line, scale)
        free = equations.free(*shooting.coordinates.bounds(z[live]), z[live])
        if held is not None:
            free &= ~held
        now = _cost(line.residual, scale)
        best = now.copy()
        chosen = damping[live] * TRIALS[-1] * 3
        trials = [
            _moved(shooting, z[live], states[live], *equations.step(damping[live] * factor, free))
            for factor in TRIALS
        ]
        tried = shooting.residuals(
            np.concatenate([trial[0] for trial in trials]), np.concatenate([trial[1] for trial in trials])
        ).reshape(len(TRIALS), *line.residual.shape)
        for factor, (trial_z, trial_states), trial_residual in zip(TRIALS, trials, tried, strict=True):
            cost = _cost(trial_residual, scale)
            better = cost < best
            at = live[better]
            z[at], states[at], residual[at] = trial_z[better], trial_states[better], trial_residual[better]
            best[better], chosen[better] = cost[better], (damping[live] * factor)[better]
        damping[live] = np.maximum(chosen, 1e-9)
        gained = now - best
        active[live] = np.where(gained > 0, gained > ARRIVED * now + 1e-3, damping[live] < STUCK)
        path.append(z.copy())
        on_iteration(iteration + 1)
    return Solution(z, states, residual, np.array(path))


def _cost(residual: Array, scale: Array) -> Array:
    return robust.loss(residual, scale[:, None, None]).sum(axis=(1, 2))


def _moved(shooting: Shooting, z: Array, states: Array, dz: Array, dstate: Array) -> tuple[Array, Array]:
    longest = np.abs(dz).max(axis=1, keepdims=True)
    shorten = np.minimum(1.0, LONGEST_STEP / np.maximum(longest, LONGEST_STEP))
    moved = states.copy()
    moved[..., : dstate.shape[-1]] += shorten[:, :, None] * dstate
    return shooting.coordinates.clip(z + shorten * dz), moved


@dataclass(frozen=True, eq=False)
class Normal:
    """The blocks of the weighted normal equations of k candidates.

    Attributes
    ----------
    zz, z : (k, 5, 5) and (k, 5) arrays
        Border and gradient of the coordinates.
    ss, s, sz : (k, w, s, s), (k, w, s) and (k, w, s, 5) arrays
        Blocks and gradients of the start states, and what ties them to the coordinates.
    """

    zz: Array
    z: Array
    ss: Array
    s: Array
    sz: Array

    @classmethod
    def of(cls, line: Linearisation, scale: Array) -> Normal:
        """Blocks at this linearisation, with the robust weights of its residuals at `scale` (k,)."""
        weight = robust.weight(line.residual, scale[:, None, None])
        weighted = weight * line.residual
        by_z = weight[..., None] * line.by_z
        by_state = np.swapaxes(line.by_state, -1, -2)
        return cls(
            (np.swapaxes(line.by_z, -1, -2) @ by_z).sum(axis=1),
            np.einsum("kwni,kwn->ki", line.by_z, weighted),
            by_state @ (weight[..., None] * line.by_state),
            (by_state @ weighted[..., None])[..., 0],
            by_state @ by_z,
        )

    def free(self, low: Array, high: Array, z: Array) -> NDArray[np.bool_]:
        """(k, 5): which coordinates may move, being inside their bounds or drawn inwards."""
        _, _, gradient = self._eliminated(np.zeros(len(z)))
        return ~(((z <= low) & (gradient > 0)) | ((z >= high) & (gradient < 0)))

    def step(self, damping: Array, free: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Damped step of the free coordinates and of all states: (k, 5) and (k, w, s) arrays."""
        blocks, matrix, gradient = self._eliminated(damping)
        matrix = matrix + _ridge(self.zz, damping)
        matrix = np.where(free[:, :, None] & free[:, None, :], matrix, np.eye(5))
        dz = -np.linalg.solve(matrix, np.where(free, gradient, 0.0)[..., None])[..., 0]
        pull = self.s + (self.sz @ dz[:, None, :, None])[..., 0]
        return dz, -np.linalg.solve(blocks, pull[..., None])[..., 0]

    def _eliminated(self, damping: Array) -> tuple[Array, Array, Array]:
        """Damped blocks of the states; border and gradient of the coordinates without the states' share."""
        blocks = self.ss + _ridge(self.ss, damping[:, None])
        share = np.swapaxes(np.linalg.solve(blocks, self.sz), -1, -2)
        matrix = self.zz - (share @ self.sz).sum(axis=1)
        return blocks, matrix, self.z - (share @ self.s[..., None]).sum(axis=1)[..., 0]


def _ridge(blocks: Array, damping: Array) -> Array:
    """Marquardt's damping of (..., m, m) blocks: relative to the diagonal, and positive where that is zero."""
    diagonal = np.einsum("...ii->...i", blocks)
    floor = 1e-9 * diagonal.max(axis=-1, keepdims=True) + 1e-300
    return (damping[..., None] * diagonal + floor)[..., None] * np.eye(blocks.shape[-1])
