"""IRT+: steps of a network trained on millions of pairs, followed by Gauss-Newton."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from irt.tuning.coordinates import Coordinates
from irt.tuning.drive import CENTRED, Drive
from irt.tuning.library import Library
from irt.tuning.search import Search, Seen
from irt.tuning.stepnet import Belief, StepFile, middle

Array = NDArray[np.float64]

#: Number of the network's steps before Gauss-Newton.
NETWORK_STEPS = 5
#: Forward difference in a coordinate for a column of the Jacobian.
_DIFFERENCE = 2e-3
#: Levenberg-Marquardt dampings that are tried together, as shares of the Jacobian's squared columns.
_DAMPING = (1e-4, 1e-2, 1.0)
#: Relative gain of the error below which Gauss-Newton has converged.
_WORTH = 0.02
#: Error that counts as zero [board edges]: a thousandth of a marble.
_EXACT = 2e-5
#: Error below which the search ends [board edges]: a hundredth of a marble, less than a camera's noise.
_SOLVED = 1e-4
#: Distance from the nearest path of the library [board edges], which 99 of 100 simulated targets of the
#: paper's drive do not exceed.
_FOREIGN = 0.017
#: Share of the distance to the rim below which a marble has certainly not met it.
_OFF_RIM = 0.97
#: Number of draws from the network's posterior that are simulated together after Gauss-Newton has converged.
_DRAWS = 4


@dataclass(frozen=True, eq=False)
class Plus:
    """The search of IRT+ for one drive.

    Attributes
    ----------
    drive : Drive
        The simulated drive.
    file : StepFile
        A network for this drive if ``joint``, else for each of its runs.
    joint : bool
        Whether the network sees all runs at once.
    first : Seen
        The model in the middle of the ranges compared with the target: the first input of the network. Its
        simulation is the same for all targets of a drive.
    library : Library
        The library of this drive.
    """

    drive: Drive
    file: StepFile
    joint: bool
    first: Seen
    library: Library

    def search(self, random: np.random.Generator) -> Search:
        """Propose the network's steps, then Gauss-Newton's, then both again from other points.

        Each step starts at the best proposal so far. The search ends at a negligible error. If no path of the
        library is near, the target has other physics; then the nearest path is the first proposal.
        """
        nearest, distance = self.library.nearest(self._target)
        if distance > _FOREIGN:
            best, belief = (yield self._settled(nearest)), None
        else:
            best, belief = yield from self._led(self.first, 1)
        best, belief = yield from self._led(best, NETWORK_STEPS - 1, belief)
        best = yield from self._descended(best, belief)
        while best.mae[0] > _SOLVED:
            best, belief = yield from self._drawn(best, belief, random)

    def _led(
        self, best: Seen, steps: int, belief: Belief | None = None
    ) -> Generator[Array, Seen, tuple[Seen, Belief]]:
        """Follow the network's estimates; return the best proposal and the posterior there."""
        belief = self._asked(best) if belief is None else belief
        begin = best is self.first
        for _ in range(steps):
            found = yield self._coordinates.parameters(belief.mean)
            if begin or found.mae[0] < best.mae[0]:
                best, begin = found, False
                belief = self._asked(best)
            else:
                # The residual of this proposal is more informative than the first input again.
                belief = _joined(belief, self._asked(found))
        return best, belief

    def _descended(self, best: Seen, belief: Belief) -> Generator[Array, Seen, Seen]:
        """Run Gauss-Newton from a proposal until it converges; the posterior regularises it."""
        while best.mae[0] > _EXACT:
            jacobian = yield from self._jacobian(best)
            found = yield self._candidates(best, jacobian, belief)
            leader = int(found.mae.argmin())
            before = best.mae[0]
            if found.mae[leader] < before:
                best = found[leader : leader + 1]
            if found.mae[leader] > (1.0 - _WORTH) * before:
                break
        return best

    def _jacobian(self, best: Seen) -> Generator[Array, Seen, Array]:
        """Return the Jacobian of the residual by each identifiable coordinate (m, c), one rollout each."""
        at, steps = self._coordinates.of(best.parameters), self._coordinates.time_scale(best.parameters)
        shown = self._coordinates.shown
        # Towards the middle of the range, so that no rollout is outside.
        sense = np.where(at[0, shown] > _middle_of(self._coordinates, shown), -1.0, 1.0) * _DIFFERENCE
        moved = np.repeat(at, len(shown), axis=0)
        moved[np.arange(len(shown)), shown] += sense
        found = yield self._coordinates.at_time_scale(moved, np.repeat(steps, len(shown)))
        slopes: Array = ((found.residual - best.residual) / sense[:, None]).T
        return slopes

    def _candidates(self, best: Seen, jacobian: Array, belief: Belief) -> Array:
        """Return the parameters (k, 5) after steps with different dampings."""
        at, shown = self._coordinates.of(best.parameters), self._coordinates.shown
        square = jacobian.T @ jacobian
        scale = np.maximum(np.diag(square), 1e-9 * max(float(np.diag(square).max()), 1e-12))
        # The posterior is one more observation, in the scale of the residuals.
        known = np.square(best.residual).mean() / np.square(belief.deviation[0, shown])
        towards = known * (belief.mean - at)[0, shown]
        moved = np.repeat(at, len(_DAMPING), axis=0)
        for row, damping in enumerate(_DAMPING):
            hessian = square + np.diag(known + damping * scale)
            moved[row, shown] -= np.linalg.solve(hessian, jacobian.T @ best.residual[0] - towards)
        return self._coordinates.parameters(moved)

    def _drawn(
        self, best: Seen, belief: Belief, random: np.random.Generator
    ) -> Generator[Array, Seen, tuple[Seen, Belief]]:
        """Restart from draws of the posterior, or from random points; return the best proposal."""
        spread = np.maximum(belief.deviation, 0.05) * random.choice([1.0, 3.0, 10.0])
        drawn = belief.mean + spread * random.standard_normal((_DRAWS, belief.mean.shape[1]))
        found = yield self._coordinates.parameters(drawn)
        leader = int(found.mae.argmin())
        start = found[leader : leader + 1]
        other, belief = yield from self._led(start, 2)
        other = yield from self._descended(other, belief)
        return (other if other.mae[0] < best.mae[0] else best), belief

    def _asked(self, seen: Seen) -> Belief:
        """Return the network's posterior, with medians for unidentifiable coordinates."""
        belief = self.file.ask(self.drive, seen, joint=self.joint)
        if self._off_rim:
            return replace(belief, mean=self._coordinates.central(belief.mean))
        return belief

    def _settled(self, parameters: Array) -> Array:
        """Return parameters (1, 5), with medians for unidentifiable coordinates."""
        if not self._off_rim:
            return parameters
        return self._coordinates.parameters(self._coordinates.central(self._coordinates.of(parameters)))

    @property
    def _target(self) -> list[Array]:
        """The target's observations (1, n, 2) of each run."""
        return [p + m for p, m in zip(self.first.proposed, self.first.missing, strict=True)]

    @cached_property
    def _off_rim(self) -> bool:
        """Whether the target starts in the centre and stays off the rim at any observation scale."""
        if self.drive.start != "rest" or any(np.abs(run.start).max() > CENTRED for run in self.drive.runs):
            return False
        room = _OFF_RIM * self.drive.ranges["observation_scale"][0] * self.drive.room
        return all(bool((np.abs(each) < room).all()) for each in self._target)

    @cached_property
    def _coordinates(self) -> Coordinates:
        return Coordinates(self.drive)


def _middle_of(coordinates: Coordinates, shown: NDArray[np.int64]) -> Array:
    at_middle: Array = coordinates.of(middle(coordinates.drive))[0, shown]
    return at_middle


def _joined(one: Belief, other: Belief) -> Belief:
    """Return the product of two normal distributions."""
    weights = one.deviation**-2.0, other.deviation**-2.0
    total = weights[0] + weights[1]
    return Belief((weights[0] * one.mean + weights[1] * other.mean) / total, total**-0.5)
