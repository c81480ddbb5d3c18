"""A model with its uncertainty from a rig's recordings, and its linearised predictions of new runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.engine import rollouts
from irt.errors import IrtError
from irt.fitting.problem import Problem
from irt.model import Model
from irt.rig import PARAMETERS, Rig
from irt.segments import Segment
from irt.suggestion.excitations import Excitation

Array = NDArray[np.float64]

#: Standard deviation of a uniform distribution over a range, the prior of unidentified parameters.
_UNKNOWN = 1.0 / np.sqrt(12.0)
#: Steps up to this share of a parameter's value are multiplicative, larger steps additive.
_PROPORTIONAL = 0.5
#: Parameters are moved by their standard deviation, limited to these shares of their ranges.
_LEAST, _MOST = 1e-6, 0.05
#: Standard deviation of the position of a marble placed by hand [board edges].
PLACED = 0.01
#: Additional random draws of stochastic effects.
_SEEDS = 2
#: Largest distance of a start from the centre, as a share of the distance to the wall.
_INSIDE = 0.99
#: Largest distance to a wall at which a marble counts as at the wall [m].
_AT_WALL_M = 0.001


@dataclass(frozen=True, eq=False)
class Expected:
    """Predictions of a hypothesis for e runs of n rows.

    Attributes
    ----------
    paths : (e, 2n) array
        Positions [board edges].
    slopes : (e, f + 2, 2n) array
        Change of the positions for one standard deviation along each of f directions of the parameters, and
        of the start position along x and y [board edges].
    variance : (e, 2n) array
        Variance beyond the linearisation: curvature, chaos and random draws of effects [board edges squared].
    at_wall : (e,) array
        Share of rows with the marble at a wall.
    """

    paths: Array
    slopes: Array
    variance: Array
    at_wall: Array


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A model, and the uncertainty of its n parameters.

    Attributes
    ----------
    model : Model
        The model.
    names : tuple of str
        Names of the parameters: the five, then ``effect.parameter``.
    values : (n,) array
        The parameters.
    deviations : (f, n) array
        Independent moves of the parameters of one standard deviation each, in their own units.
    steps : (f,) array
        Share of each move used as finite-difference step.
    allowed : (n, 2) array
        The values that physics allows.
    held : dict
        Values of parameters that are held fixed, by effect and name.
    """

    model: Model
    names: tuple[str, ...]
    values: Array
    deviations: Array
    steps: Array
    allowed: Array
    held: dict[str, dict[str, float]]

    @classmethod
    def of(
        cls,
        rig: Rig,
        model: Model,
        segments: Sequence[Segment],
        noise: float,
        *,
        time_scale: float | None,
        threads: int | None,
    ) -> Hypothesis:
        """Return a model with the uncertainty given by segments of a rig's recordings."""
        held = _held(model)
        # The model's own board: a diagnosis may have found another friction than assumed.
        problem = Problem.of(
            replace(model, start=rig.start),
            segments,
            effects=model.effects,
            time_scale=time_scale,
            noise=noise,
            held=held,
            threads=threads,
        )
        of_effects = [
            one.parameters.get(parameter.name, parameter.neutral)
            for one in model.effects
            for parameter in effect(one.name).used(one.parameters)
        ]
        values = np.concatenate([model.values, of_effects])
        if time_scale is not None:
            values[PARAMETERS.index("time_scale")] = time_scale
        if not np.isfinite(values).all():
            missing = problem.names[int(np.flatnonzero(~np.isfinite(values))[0])]
            raise IrtError(f"{missing} has no value, and no neutral one; give one")
        curvature = problem.inform(values, noise)
        widths = np.ptp(problem.ranges, axis=1)[curvature.free]
        deviation = np.clip(np.nan_to_num(curvature.deviation, nan=np.inf), _LEAST, _UNKNOWN)
        deviations = np.zeros((len(deviation), len(values)))
        deviations[:, curvature.free] = curvature.directions * deviation[:, None] * widths
        return cls(
            model=model,
            names=problem.names,
            values=values,
            deviations=deviations,
            steps=np.minimum(1.0, _MOST / deviation),
            allowed=problem.allowed,
            held=held,
        )

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(one.name for one in self.model.effects)

    def expected(self, runs: Sequence[Excitation], step_s: float | None, *, threads: int | None) -> Expected:
        """Return the predictions for runs of equal length.

        Parameters
        ----------
        runs : sequence of Excitation
            Runs of n rows each.
        step_s : float or None
            Duration of a row [s]; None without stamps.
        threads : int or None
            Threads of the engine.
        """
        moves = self.deviations * self.steps[:, None]
        ahead, back = self._room(moves), self._room(-moves)
        above, below = self._moved(ahead * moves), self._moved(-back * moves)
        varied = np.concatenate([[self.values], above, below, np.tile(self.values, (4 + _SEEDS, 1))])
        places = np.zeros((len(varied), 2))
        count = len(moves)
        places[2 * count + 1 : 2 * count + 5] = PLACED * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
        seeds = np.zeros(len(varied), dtype=np.int64)
        seeds[2 * count + 5 :] = 1 + np.arange(_SEEDS)
        paths = self._simulated(runs, varied, places=places, seeds=seeds, step_s=step_s, threads=threads)
        centre = paths[:, 0]
        up, down = paths[:, 1 : count + 1], paths[:, count + 1 : 2 * count + 1]
        of_start = paths[:, 2 * count + 1 : 2 * count + 5]
        of_seeds = paths[:, 2 * count + 5 :] - centre[:, None]
        # One-sided differences where a parameter such as friction or a delay is at its bound.
        both = ((ahead == 1.0) & (back == 1.0))[:, 0]
        slopes = (up - down) / np.maximum((ahead + back) * self.steps[:, None], 1e-9)
        # Scaled like the slopes, so that a jump along an unidentified direction does not pass for a slope.
        bent = ((0.5 * (up + down) - centre[:, None]) / self.steps[:, None])[:, both]
        bent_by_start = 0.5 * (of_start[:, :2] + of_start[:, 2:]) - centre[:, None]
        variance = (bent**2).sum(axis=1) + (bent_by_start**2).sum(axis=1) + (of_seeds**2).mean(axis=1)
        slopes_of_start = 0.5 * (of_start[:, :2] - of_start[:, 2:])
        return Expected(
            paths=centre,
            slopes=np.concatenate([slopes, slopes_of_start], axis=1),
            variance=variance,
            at_wall=self._at_wall(centre.reshape(len(runs), -1, 2)),
        )

    def paths(self, runs: Sequence[Excitation], *, finer: int = 1, threads: int | None) -> Array:
        """Return the paths of runs, (e, 2n), with a time step `finer` times smaller than the engine's."""
        alone = self._simulated(
            runs,
            self.values[None],
            places=np.zeros((1, 2)),
            seeds=np.zeros(1, dtype=np.int64),
            step_s=None,
            finer=finer,
            threads=threads,
        )
        return alone[:, 0]

    def _moved(self, moves: Array) -> Array:
        """Return the parameters after each of (f, n) moves, which are linear in the logarithms.

        The symmetries of the motion are multiplicative, so linear moves of logarithms follow them exactly.
        """
        share = np.divide(moves, self.values, out=np.full_like(moves, np.inf), where=self.values != 0.0)
        small = np.abs(share) < _PROPORTIONAL
        moved = np.where(small, self.values * np.exp(np.where(small, share, 0.0)), self.values + moves)
        return np.clip(moved, *self.allowed.T)

    def _room(self, moves: Array) -> Array:
        """Return the share of each move (f, n) that stays within what physics allows, (f, 1)."""
        ends = np.where(moves < 0.0, self.allowed[:, 0], self.allowed[:, 1]) - self.values
        shares = np.divide(ends, moves, out=np.full_like(moves, np.inf), where=moves != 0.0)
        return np.asarray(np.clip(shares.min(axis=1, keepdims=True), 0.0, 1.0))

    def _simulated(
        self,
        runs: Sequence[Excitation],
        varied: Array,
        *,
        places: Array,
        seeds: NDArray[np.int64],
        step_s: float | None,
        threads: int | None,
        finer: int = 1,
    ) -> Array:
        """Return the paths of each run under each of q variants, (e, q, 2n)."""
        count, rows = len(runs) * len(varied), len(runs[0].commands)
        parameters = np.tile(varied, (len(runs), 1))
        added, column = [], len(PARAMETERS)
        for chosen in self.model.effects:
            keys = [one.name for one in effect(chosen.name).used(chosen.parameters)]
            columns = parameters[:, column : column + len(keys)].T
            added.append({"name": chosen.name, **dict(zip(keys, columns, strict=True))})
            column += len(keys)
        starts = np.array([run.start for run in runs])[:, None] + places
        reach = _INSIDE * self._reach()
        updates = finer * max(1, round(float(self.values[PARAMETERS.index("time_scale")])))
        paths = rollouts(
            parameters[:, : len(PARAMETERS)],
            np.repeat(np.array([run.commands for run in runs]), len(varied), axis=0),
            rig=self.model,
            effects=added,
            start=np.clip(starts, -reach, reach).reshape(-1, 2),
            seed=np.tile(seeds, len(runs)),
            threads=threads,
            time_step="continuous",
            durations=None if step_s is None else np.full(rows, step_s),
            substeps=None if step_s is not None else np.full(count, updates),
        )
        return paths.reshape(len(runs), len(varied), -1)

    def _reach(self) -> Array:
        """Return the largest observed |x| and |y| of the marble, (2,) [board edges]."""
        board, radius = self.model.board, self.model.marble.radius_m
        room = np.array([board.edge_x_m, board.edge_y_m]) / 2.0 - radius
        scale = self.values[PARAMETERS.index("observation_scale")]
        return np.asarray(room / board.edge_x_m * scale)

    def _at_wall(self, paths: Array) -> Array:
        margin = _AT_WALL_M / self.model.board.edge_x_m
        return np.asarray((np.abs(paths) > self._reach() - margin).any(axis=2).mean(axis=1))


def _held(model: Model) -> dict[str, dict[str, float]]:
    """Return the parameters of effects that are held fixed.

    Parameters without a value are held at their neutral values. All parameters of a learned correction are
    held, because recordings cannot identify so many.
    """
    found: dict[str, dict[str, float]] = {}
    for one in model.effects:
        info = effect(one.name)
        found[one.name] = {
            parameter.name: one.parameters.get(parameter.name, parameter.neutral)
            for parameter in info.used(one.parameters)
            if not info.listed or parameter.name not in one.parameters
        }
    return found
