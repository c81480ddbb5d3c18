"""The search for the best parameters: from a draw over the ranges to the bottom of the deepest valley found.

The way goes from short windows to whole recordings: in short ones nearly every start point finds the gears;
in long ones friction, walls and stops come in. All starts move in lockstep, so that an iteration is two
batches of rollouts, whatever the number of starts, recordings and parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.fitting import robust
from irt.fitting.coordinates import GEAR_X, GEAR_Y, TIME, Coordinates, along_time
from irt.fitting.fit import Progress
from irt.fitting.shooting import Shooting, Windows, cut
from irt.fitting.solver import minimise, search_nearby
from irt.residual import Segment
from irt.rig import PARAMETERS, Rig
from irt.rollouts import Engine

Array = NDArray[np.float64]

#: Rows of the windows, stage after stage, and iterations spent on each; whole segments come last.
HORIZONS = ((10, 7), (40, 6))
WHOLE_ITERATIONS, FAMILY_ITERATIONS, SETTLE_ITERATIONS = 12, 10, 5
#: How often the best one's family and surroundings are searched, and batches drawn of the surroundings.
ROUNDS = 2
NEARBY_ROUNDS = 6
#: Physics steps on the way to whole segments are this many times longer than the engine's.
COARSENESS = 5
#: Rows of the windows in which start points are screened, and how many are drawn for each that is refined.
SCREEN_ROWS, SCREENED_PER_START = 24, 32
#: A whole number of physics steps is taken where the log-likelihood does not fall by more.
TIE = 0.5


@dataclass(frozen=True, eq=False)
class Candidate:
    """Where one start point has led.

    Attributes
    ----------
    z : (5,) array
        Coordinates.
    states : (w, 4) array
        Start states of the whole segments.
    residual : (w, N) array
        Over the whole segments [board edges].
    path : (t, 5) array
        Coordinates on the way, the start point first.
    """

    z: Array
    states: Array
    residual: Array
    path: Array


class Search:
    """The recordings of one fit, and what the search has cost so far.

    Attributes
    ----------
    noise : float
        Standard deviation of the tracker [board edges], from the recordings alone.
    whole : Windows
        All segments uncut.
    coordinates : Coordinates
        What z means; which sense the gears have shows in the screening.
    rollouts : int
        Simulated windows so far.
    """

    def __init__(
        self,
        rig: Rig,
        segments: Sequence[Segment],
        time_scale: float | None,
        *,
        engine: Engine,
        threads: int | None,
        progress: Progress | None,
    ) -> None:
        self._rig, self._segments, self._time_scale = rig, segments, time_scale
        self._engine, self._threads, self._progress = engine, threads, progress
        self.noise = robust.tracker_noise(segments)
        self.whole = self._cut(max(len(segment.knobs) for segment in segments))
        if not len(self.whole.knobs):
            raise IrtError(f"{rig.path}: the tracker saw the marble in too few rows to fit anything")
        self.rollouts, self._done = 0, 0
        self._horizons = [stage for stage in HORIZONS if 1.5 * stage[0] <= self.whole.knobs.shape[1]]

    def run(self, starts: int, seed: int) -> list[Candidate]:
        """Refine the best start points of a draw; return where they led, the best first."""
        candidates = self._descend(self._screen(starts, seed))
        best, rng = candidates[0], np.random.default_rng(seed)
        for round_ in range(ROUNDS):
            if self._time_is_free:
                members = self._family(best, max(starts // 2**round_, 1))
                best = self._ranked([best, *members])[0]
            best = self._settled(best, rng)
        return [self._rounded(best) if self._time_is_free else best, *candidates[1:]]

    def errors(self, candidate: Candidate) -> Array:
        """Return the mean absolute error (t,) along a candidate's path, from the start states of its end."""
        states = np.repeat(candidate.states[None], len(candidate.path), axis=0)
        residual = self._residuals(self.whole, candidate.path, states)
        errors: Array = np.abs(residual).sum(axis=(1, 2)) / self.whole.known.sum()
        return errors

    def _screen(self, starts: int, seed: int) -> Array:
        """Draw start points over the ranges; return the best ones, (starts, 5)."""
        windows = self._cut(SCREEN_ROWS)
        draw = space_filling(starts * SCREENED_PER_START, seed)
        ranges = (self._rig.ranges[name] for name in PARAMETERS)
        senses = [[1.0] * bool(high > 0.0) + [-1.0] * bool(low < 0.0) for low, high in ranges]
        found = []
        for sense_x, sense_y in product(senses[GEAR_X], senses[GEAR_Y]):
            sign = np.ones(5)
            sign[[GEAR_X, GEAR_Y]] = sense_x, sense_y
            self.coordinates = Coordinates.of(self._rig.ranges, sign, self._time_scale)
            low, high = self.coordinates.low, self.coordinates.high
            z = self.coordinates.to_z(sign * (low + draw * (high - low)))
            states = np.repeat(windows.guess[None], len(z), axis=0)
            error = np.abs(self._residuals(windows, z, states, COARSENESS)).mean(axis=(1, 2))
            best = np.argsort(error, kind="stable")[:starts]
            found.append((float(error[best[0]]), self.coordinates, z[best]))
        if not found:
            raise IrtError(f"{self._rig.path}: the ranges of gear_x and gear_y leave nothing to search")
        _, self.coordinates, z = min(found, key=lambda one: one[0])
        return z

    def _descend(self, z: Array) -> list[Candidate]:
        """Refine start points (k, 5) in longer and longer windows, and the better half in whole segments."""
        windows, states, paths = self.whole, np.empty((len(z), 0, 4)), [z[None]]
        for rows, iterations in self._horizons:
            shorter, windows = windows, self._cut(rows)
            states = _inherited(windows, shorter, states)
            z, states, _, path = self._minimise(windows, z, states, iterations, COARSENESS)
            paths.append(path)
        states = _inherited(self.whole, windows, states)
        path, residual = np.concatenate(paths), self._residuals(self.whole, z, states)
        candidates = self._ranked(
            [Candidate(z[i], states[i], residual[i], path[:, i]) for i in range(len(z))]
        )
        half = (len(candidates) + 1) // 2
        return self._ranked([*self._refined(candidates[:half], WHOLE_ITERATIONS), *candidates[half:]])

    def _refined(self, candidates: list[Candidate], iterations: int) -> list[Candidate]:
        """Refine candidates over whole segments."""
        z, states = (np.stack([getattr(one, name) for one in candidates]) for name in ("z", "states"))
        z, states, residual, path = self._minimise(self.whole, z, states, iterations)
        return [
            Candidate(z[i], states[i], residual[i], np.concatenate([one.path, path[:, i]]))
            for i, one in enumerate(candidates)
        ]

    def _family(self, candidate: Candidate, count: int) -> list[Candidate]:
        """Refine members of a candidate's family: the same motion in other numbers of physics steps.

        Without walls the members differ by the length of a physics step alone; with them a little more. Those
        within the ranges come first.
        """
        bottom, top = self.coordinates.lower[TIME], self.coordinates.upper[TIME]
        counts = np.arange(np.ceil(bottom), np.floor(top) + 1.0)
        z = along_time(np.repeat(candidate.z[None], len(counts), axis=0), counts)
        z = z[np.all(np.abs(self.coordinates.clip(z) - z) < 1e-9, axis=1)]
        if not len(z):
            return []
        inside = np.all(self.coordinates.excess(z)[0] == 0.0, axis=1)
        z = z[inside] if inside.any() else z
        states = np.repeat(candidate.states[None], len(z), axis=0)
        residual = self._residuals(self.whole, z, states)
        members = [
            Candidate(z[i], candidate.states, residual[i], np.concatenate([candidate.path, z[i, None]]))
            for i in range(len(z))
        ]
        return self._refined(self._ranked(members)[:count], FAMILY_ITERATIONS)

    def _settled(self, candidate: Candidate, rng: np.random.Generator) -> Candidate:
        """Look around a candidate for a better one, and refine that."""
        shooting = self._shooting(self.whole)
        z, states = search_nearby(
            shooting, candidate.z, candidate.states, noise=self.noise, rounds=NEARBY_ROUNDS, rng=rng
        )
        self.rollouts += shooting.rollouts
        path = np.concatenate([candidate.path, z[None]])
        return self._refined([Candidate(z, states, candidate.residual, path)], SETTLE_ITERATIONS)[0]

    def _rounded(self, candidate: Candidate) -> Candidate:
        """Move to a whole number of physics steps, if the recordings have nothing against it.

        There a model does the same whether it rounds the time scale, as in the paper, or not.
        """
        z = along_time(candidate.z, np.maximum(1.0, np.rint(np.exp(candidate.z[TIME]))))
        residual = self._residuals(self.whole, z[None], candidate.states[None])
        before, after = self._losses(np.stack([candidate.residual, residual[0]]))
        if after > before + TIE or np.any(np.abs(self.coordinates.clip(z) - z) > 1e-9):
            return candidate
        return Candidate(z, candidate.states, residual[0], np.concatenate([candidate.path, z[None]]))

    @property
    def _time_is_free(self) -> bool:
        """Whether the first symmetry holds until a wall is met: neither stamps nor damping forbid it."""
        held = self.coordinates.lower[TIME] == self.coordinates.upper[TIME]
        return bool(not held and self._rig.marble.damping_per_s == 0.0)

    def _ranked(self, candidates: list[Candidate]) -> list[Candidate]:
        z = np.stack([candidate.z for candidate in candidates])
        losses = self._losses(np.stack([candidate.residual for candidate in candidates]))
        losses += 0.5 * (self.coordinates.excess(z)[0] ** 2).sum(axis=1)
        return [candidates[index] for index in np.argsort(losses, kind="stable")]

    def _losses(self, residual: Array) -> Array:
        """Loss (k,) of residuals (k, w, N), at the scale of the one that fits best."""
        scale = np.maximum(robust.scale(residual, self.whole.known).min(), self.noise)
        losses: Array = robust.loss(residual, scale).sum(axis=(1, 2))
        return losses

    def _cut(self, rows: int) -> Windows:
        return cut(self._segments, rows, at_rest=self._rig.start == "rest")

    def _shooting(self, windows: Windows, coarseness: int = 1) -> Shooting:
        return Shooting(
            self._rig,
            self.coordinates,
            windows,
            engine=self._engine,
            threads=self._threads,
            coarseness=coarseness,
        )

    def _residuals(self, windows: Windows, z: Array, states: Array, coarseness: int = 1) -> Array:
        self.rollouts += len(z) * len(windows.knobs)
        return self._shooting(windows, coarseness).residuals(z, states)

    def _minimise(
        self, windows: Windows, z: Array, states: Array, iterations: int, coarseness: int = 1
    ) -> tuple[Array, Array, Array, Array]:
        """Refine z (k, 5) and states (k, w, 4); return them, the residuals, and the path (t, k, 5)."""
        shooting = self._shooting(windows, coarseness)
        total = sum(count for _, count in self._horizons) + WHOLE_ITERATIONS
        total += ROUNDS * (FAMILY_ITERATIONS * self._time_is_free + SETTLE_ITERATIONS)

        def report(iteration: int) -> None:
            if self._progress is not None:
                text = f"least squares, {windows.knobs.shape[1]} rows at a time"
                self._progress(self._done + iteration, total, text)

        solution = minimise(shooting, z, states, noise=self.noise, iterations=iterations, on_iteration=report)
        report(iterations)
        self._done += iterations
        self.rollouts += shooting.rollouts
        return solution.z, solution.states, solution.residual, solution.path


def space_filling(count: int, seed: int) -> Array:
    """Return (count, 5) points that fill the unit cube: the recurrence R5 (Roberts 2018), shifted."""
    ratio = 1.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / 6.0)
    steps = np.arange(1, count + 1)[:, None] * ratio ** -np.arange(1.0, 6.0)
    filled: Array = (np.random.default_rng(seed).random(5) + steps) % 1.0
    return filled


def _inherited(windows: Windows, shorter: Windows, states: Array) -> Array:
    """Start states (k, w, 4): those found in shorter windows that begin in the same rows, else the guess."""
    found = {tuple(origin): index for index, origin in enumerate(shorter.origin.tolist())}
    start = np.repeat(windows.guess[None], len(states), axis=0)
    for index, origin in enumerate(windows.origin.tolist()):
        if tuple(origin) in found and states.shape[1]:
            start[:, index] = states[:, found[tuple(origin)]]
    return start
