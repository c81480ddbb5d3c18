"""Levenberg-Marquardt for many candidates in lockstep, with the windows' start states eliminated.

A start state touches only its own window's residuals, so the normal equations have an arrow's shape: small
diagonal blocks for the states, one dense border for the five coordinates. Eliminating the blocks leaves a 5 x
5 system (Triggs et al. 2000, "Bundle adjustment", sect. 6), whatever the number of windows.

The ground is rough: every stop and every impact that moves by a physics step is a small jump of the loss. So
steps are tried with several dampings and several start states at once, and since windows know nothing of each
other, each window takes the start state that suits it best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.fitting import robust
from irt.fitting.shooting import Linearisation, Shooting

Array = NDArray[np.float64]

#: Dampings tried at once, relative to the last one that worked, and start states tried with each.
TRIALS, VARIANTS = (0.01, 0.3, 10.0), 4
FIRST_DAMPING, LEAST_DAMPING = 1e-2, 1e-9
#: Damping above which a candidate has nowhere left to go, and the relative gain below which it has arrived.
STUCK, ARRIVED = 1e3, 1e-5
#: Largest change of a coordinate in one step, and of a start state in one draw [board edges, a row].
LONGEST_STEP, LONGEST_DRAW = 0.7, 0.01
#: Candidates and start states drawn in each round of the search nearby, and the furthest they may lie (in z).
DRAWS, STATE_DRAWS, FURTHEST = 12, 8, 0.1
#: Relative ridge that keeps the spread of what nothing determines finite.
RIDGE = 1e-6


@dataclass(frozen=True, eq=False)
class Solution:
    """Where k candidates ended.

    Attributes
    ----------
    z : (k, 5) array
        Coordinates.
    states : (k, w, 4) array
        Start states.
    residual : (k, w, N) array
        Predicted minus observed [board edges].
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
    *,
    noise: float,
    iterations: int,
    held: bool = False,
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
    held : bool
        Whether the coordinates stay where they are, and only start states move.
    on_iteration : callable
        Called after each iteration with how many there were.
    """
    z, states = shooting.coordinates.clip(z), states.copy()
    residual = shooting.residuals(z, states)
    damping, active = np.full(len(z), FIRST_DAMPING), np.ones(len(z), dtype=bool)
    path, rng = [z.copy()], np.random.default_rng(0)
    for iteration in range(iterations):
        live = np.flatnonzero(active)
        if not len(live):
            break
        line = shooting.linearise(z[live], states[live])
        scale = np.maximum(robust.scale(line.residual, shooting.windows.known), noise)
        equations = Normal.of(line, scale, *shooting.coordinates.excess(z[live]))
        free = equations.free(*shooting.coordinates.bounds(z[live]), z[live]) & (not held)
        now = _loss(line.residual, scale).sum(axis=1) + _outside(shooting, z[live])
        best, chosen = now.copy(), np.full(len(live), 3.0 * max(TRIALS))
        steps = [equations.step(damping[live] * factor, free) for factor in TRIALS]
        trials = _trials(shooting, z[live], states[live], steps, equations.loose(), scale=scale, rng=rng)
        for factor, trial in zip(TRIALS, trials, strict=True):
            better = trial.loss < best
            at = live[better]
            z[at], states[at], residual[at] = trial.z[better], trial.states[better], trial.residual[better]
            best[better], chosen[better] = trial.loss[better], factor
        damping[live] = np.maximum(damping[live] * chosen, LEAST_DAMPING)
        active[live] = np.where(best < now, now - best > ARRIVED * (now + 1.0), damping[live] < STUCK)
        path.append(z.copy())
        on_iteration(iteration + 1)
    return Solution(z, states, residual, np.array(path))


def search_nearby(
    shooting: Shooting, z: Array, states: Array, *, noise: float, rounds: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Look around a solution for a better one, where the ground is too rough for slopes to lead on.

    Each round draws candidates from the normal distribution that the normal equations describe, and start
    states for each of them.

    Parameters
    ----------
    shooting : Shooting
        The residuals.
    z, states : (5,) and (w, 4) arrays
        The solution.
    noise : float
        As for `minimise`.
    rounds : int
        How many batches are drawn.
    rng : Generator
        Source of the draws.

    Returns
    -------
    z, states : (5,) and (w, 4) arrays
        The best that was met.
    """
    for _ in range(rounds):
        line = shooting.linearise(z[None], states[None])
        scale = np.maximum(robust.scale(line.residual, shooting.windows.known), noise)
        equations = Normal.of(line, scale, *shooting.coordinates.excess(z[None]))
        spread, follow = equations.spread()
        step = np.clip(rng.standard_normal((DRAWS, 5)) @ spread[0].T, -FURTHEST, FURTHEST)
        step[0] = 0.0
        drawn = shooting.coordinates.clip(z + step)
        moved = np.repeat(states[None], DRAWS, axis=0)
        moved[..., : follow.shape[2]] += np.einsum("wsi,mi->mws", follow[0], drawn - z)
        variants = _varied(moved, np.repeat(equations.loose(), DRAWS, axis=0), STATE_DRAWS, rng)
        trial = _suited(shooting, drawn, variants, np.repeat(scale, DRAWS))
        best = int(trial.loss.argmin())
        z, states = trial.z[best], trial.states[best]
    return z, states


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
    def of(cls, line: Linearisation, scale: Array, excess: Array, slope: Array) -> Normal:
        """Blocks at a linearisation, with robust weights at `scale` (k,), and `Coordinates.excess` added."""
        weight = robust.weight(line.residual, scale[:, None, None])
        weighted = weight * line.residual
        by_z = weight[..., None] * line.by_z
        by_state = np.swapaxes(line.by_state, -1, -2)
        return cls(
            (np.swapaxes(line.by_z, -1, -2) @ by_z).sum(axis=1) + np.swapaxes(slope, 1, 2) @ slope,
            np.einsum("kwni,kwn->ki", line.by_z, weighted) + np.einsum("kij,ki->kj", slope, excess),
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
        dz = -_solve(matrix, np.where(free, gradient, 0.0)[..., None])[..., 0]
        pull = self.s + (self.sz @ dz[:, None, :, None])[..., 0]
        return dz, -_solve(blocks, pull[..., None])[..., 0]

    def spread(self) -> tuple[Array, Array]:
        """Return a root of the coordinates' covariance, (k, 5, 5), and how states follow, (k, w, s, 5)."""
        ridge = np.full(len(self.zz), RIDGE)
        blocks, matrix, _ = self._eliminated(ridge)
        return _inverse_root(matrix + _ridge(self.zz, ridge)), -_solve(blocks, self.sz)

    def loose(self) -> Array:
        """Return a root of the start states' covariance at fixed coordinates, (k, w, s, s)."""
        return _inverse_root(self.ss + _ridge(self.ss, np.full((len(self.ss), 1), RIDGE)))

    def _eliminated(self, damping: Array) -> tuple[Array, Array, Array]:
        """Damped blocks of the states; border and gradient of the coordinates without the states' share."""
        blocks = self.ss + _ridge(self.ss, damping[:, None])
        share = np.swapaxes(_solve(blocks, self.sz), -1, -2)
        matrix = self.zz - (share @ self.sz).sum(axis=1)
        gradient: Array = self.z - (share @ self.s[..., None]).sum(axis=1)[..., 0]
        return blocks, matrix, gradient


@dataclass(frozen=True, eq=False)
class _Trial:
    """k candidates z (k, 5), with the start states that suit them best, their residuals and loss (k,)."""

    z: Array
    states: Array
    residual: Array
    loss: Array


def _trials(
    shooting: Shooting,
    z: Array,
    states: Array,
    steps: Sequence[tuple[Array, Array]],
    loose: Array,
    *,
    scale: Array,
    rng: np.random.Generator,
) -> Iterator[_Trial]:
    """Yield where each of some steps leads, all from one batch of rollouts."""
    moved_z, moved = [], []
    for dz, ds in steps:
        shorten = LONGEST_STEP / np.abs(dz).max(axis=1, initial=LONGEST_STEP)
        moved_z.append(shooting.coordinates.clip(z + shorten[:, None] * dz))
        moved.append(states.copy())
        moved[-1][..., : ds.shape[-1]] += shorten[:, None, None] * ds
    count = len(steps)
    variants = _varied(np.concatenate(moved), np.tile(loose, (count, 1, 1, 1)), VARIANTS, rng)
    trial = _suited(shooting, np.concatenate(moved_z), variants, np.tile(scale, count))
    for part in np.split(np.arange(len(trial.z)), count):
        yield _Trial(trial.z[part], trial.states[part], trial.residual[part], trial.loss[part])


def _varied(states: Array, loose: Array, count: int, rng: np.random.Generator) -> Array:
    """Start states (k, w, 4) and draws around them with roots of covariance `loose`: (k, count, w, 4)."""
    k, w, s = len(states), states.shape[1], loose.shape[-1]
    variants = np.repeat(states[:, None], count, axis=1)
    draws = np.einsum("kwst,kvwt->kvws", loose, rng.standard_normal((k, count - 1, w, s)))
    variants[:, 1:, :, :s] += np.clip(draws, -LONGEST_DRAW, LONGEST_DRAW)
    return variants


def _suited(shooting: Shooting, z: Array, variants: Array, scale: Array) -> _Trial:
    """Simulate candidates (k, 5) from variants (k, v, w, 4) of their states; each window takes the best."""
    k, v, w = variants.shape[:3]
    residual = shooting.residuals(np.repeat(z, v, axis=0), variants.reshape(k * v, w, 4)).reshape(k, v, w, -1)
    loss = _loss(residual, scale[:, None])
    best = loss.argmin(axis=1)
    at = np.arange(k)[:, None], best, np.arange(w)
    return _Trial(z, variants[at], residual[at], loss.min(axis=1).sum(axis=1) + _outside(shooting, z))


def _loss(residual: Array, scale: Array) -> Array:
    """Return the negative log-likelihood (..., w) of the windows' residuals (..., w, N) at scale (...)."""
    loss: Array = robust.loss(residual, scale[..., None, None]).sum(axis=-1)
    return loss


def _outside(shooting: Shooting, z: Array) -> Array:
    """Return what it costs (k,) to leave the ranges."""
    cost: Array = 0.5 * (shooting.coordinates.excess(z)[0] ** 2).sum(axis=1)
    return cost


def _solve(matrix: Array, right: Array) -> Array:
    """Solve linear systems (..., m, m) for (..., m, r); NumPy's own is typed for any precision."""
    return np.linalg.solve(matrix, right).astype(np.float64, copy=False)


def _inverse_root(matrix: Array) -> Array:
    """Return a square root of the inverse of symmetric (..., m, m) matrices."""
    values, vectors = np.linalg.eigh(matrix)
    root: Array = vectors / np.sqrt(np.maximum(values, np.finfo(float).tiny))[..., None, :]
    return root


def _ridge(blocks: Array, damping: Array) -> Array:
    """Marquardt's damping of (..., m, m) blocks: relative to the diagonal, positive where that is zero."""
    diagonal = np.einsum("...ii->...i", blocks)
    floor = 1e-9 * diagonal.max(axis=-1, keepdims=True) + 1e-300
    ridge: Array = (damping[..., None] * diagonal + floor)[..., None] * np.eye(blocks.shape[-1])
    return ridge
