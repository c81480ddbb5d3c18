"""A model and how well a rig's recordings know it: what it predicts of a run, and how surely."""

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

#: Standard deviation of a uniform draw from a range: what is known where recordings tell nothing.
_UNKNOWN = 1.0 / np.sqrt(12.0)
#: Moves up to this share of a parameter's value multiply it, larger ones are added.
_PROPORTIONAL = 0.5
#: Parameters are moved by their standard deviation, between these shares of their ranges.
_LEAST, _MOST = 1e-6, 0.05
#: How far a marble that is laid down by hand lies from where it should [board edges].
PLACED = 0.01
#: Further draws of whatever an effect draws at random.
_SEEDS = 2
#: Share of the way to the wall at which a marble may start.
_INSIDE = 0.99
#: A marble this close to a wall is at it [m].
_AT_WALL_M = 0.001


@dataclass(frozen=True, eq=False)
class Expected:
    """What a hypothesis expects of e runs of n rows.

    Attributes
    ----------
    paths : (e, 2n) array
        Positions [board edges].
    slopes : (e, f + 2, 2n) array
        Their change for one standard deviation along each of f directions of the parameters, and for the
        start's place along x and y.
    variance : (e, 2n) array
        What lies beyond slopes: curvature, chaos, and what effects draw at random [board edges squared].
    at_wall : (e,) array
        Share of rows with the marble at a wall.
    """

    paths: Array
    slopes: Array
    variance: Array
    at_wall: Array


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A model, and how surely recordings know its n parameters.

    Attributes
    ----------
    model : Model
        The simulator.
    names : tuple of str
        Of the parameters: the five, then ``effect.parameter``.
    values : (n,) array
        The parameters.
    deviations : (f, n) array
        Independent moves of the parameters, each of one standard deviation, in their own units.
    steps : (f,) array
        Share of each move by which slopes are taken.
    allowed : (n, 2) array
        The values that physics allows.
    held : dict
        Values of parameters that no recording is asked about, by effect and name.
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
        """Return a model with what segments of a rig's recordings tell about it."""
        held = _held(model)
        # The model's own board: a diagnosis may have found that the marble grips it otherwise than assumed.
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
        told = problem.inform(values, noise)
        widths = np.ptp(problem.ranges, axis=1)[told.free]
        deviation = np.clip(np.nan_to_num(told.deviation, nan=np.inf), _LEAST, _UNKNOWN)
        deviations = np.zeros((len(deviation), len(values)))
        deviations[:, told.free] = told.directions * deviation[:, None] * widths
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
        """Return what is expected of runs of one length.

        Parameters
        ----------
        runs : sequence of Excitation
            Of n rows each.
        step_s : float or None
            Time of a row [s] where stamps tell it.
        threads : int or None
            Of the engine.
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
        # Where friction or a delay cannot fall below zero, a slope is taken from one side.
        both = ((ahead == 1.0) & (back == 1.0))[:, 0]
        slopes = (up - down) / np.maximum((ahead + back) * self.steps[:, None], 1e-9)
        # A jump beside what is left open would pass for a slope, and count as often as its step is repeated.
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
        """Return the paths of runs, (e, 2n), with updates so many times finer than the engine's."""
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
        """Return the parameters after each of (f, n) moves, their logarithms in proportion.

        The symmetries of the motion multiply: along them logarithms stay exact, however far a move goes.
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
        """How far from the centre the marble is seen at most, (2,) [board edges]."""
        board, radius = self.model.board, self.model.marble.radius_m
        room = np.array([board.edge_x_m, board.edge_y_m]) / 2.0 - radius
        scale = self.values[PARAMETERS.index("observation_scale")]
        return np.asarray(room / board.edge_x_m * scale)

    def _at_wall(self, paths: Array) -> Array:
        margin = _AT_WALL_M / self.model.board.edge_x_m
        return np.asarray((np.abs(paths) > self._reach() - margin).any(axis=2).mean(axis=1))


def _held(model: Model) -> dict[str, dict[str, float]]:
    """Return the parameters of effects that are no unknowns.

    What a model leaves out is neutral; and what was learned of physics without a name has more parameters
    than recordings could tell apart.
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
