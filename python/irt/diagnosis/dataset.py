"""The dataset of a diagnosis: recordings cut into segments, and fits of hypotheses to them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis import config
from irt.diagnosis.hypotheses import SPIN, SPINNING
from irt.diagnosis.parts import in_parts
from irt.engine import SUBSTEP_S
from irt.errors import located
from irt.fitting.least_squares import stamped_time_scale
from irt.fitting.problem import Problem, tracker_noise
from irt.fitting.robust import deviation
from irt.fitting.solution import Refined, Solution
from irt.model import Effect, Model
from irt.recording import Recording
from irt.rig import PARAMETERS, Rig
from irt.segments import Segment, segments
from irt.tilt_errors import compared_tilt

Array = NDArray[np.float64]


#: Fold of recordings that are not held out: without a marble there is no path to predict.
NEVER = -1
#: Rows of a stretch: more than outliers last, and less than the path of a marble goes wrong for.
_STRETCH = 10


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit of the base model with added effects.

    Attributes
    ----------
    dataset : Dataset
        The dataset.
    effects : tuple of str
        The added effects, in the order of addition.
    names : tuple of str
        Names of the n parameters: the five, then ``effect.parameter``.
    values : (n,) array
        The parameters.
    residuals : tuple of (rows, 2) arrays
        Predicted minus observed for each segment [board edges], NaN in rows without a marble.
    noise : float
        Root mean square of the robust standard deviations of stretches of rows [board edges]. Outliers do not
        count, but what follows an impact does, although most rows of the recordings may be as predicted.
    """

    dataset: Dataset
    effects: tuple[str, ...]
    names: tuple[str, ...]
    values: Array
    residuals: tuple[Array, ...]
    noise: float

    @classmethod
    def of(
        cls, dataset: Dataset, effects: Sequence[str], problem: Problem, found: Solution | Refined
    ) -> Fitted:
        """Return the fit from the engine's solution of a problem."""
        residuals = tuple(found.residuals)
        return cls(dataset, tuple(effects), problem.names, found.values, residuals, _of_stretches(residuals))

    @property
    def by_name(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def model(self) -> Model:
        """The simulator."""
        return self.dataset.model(self.effects, self.by_name)

    def of_effects(self) -> dict[str, float]:
        """Return the values of the effects' parameters by ``effect.parameter``."""
        return dict(zip(self.names[len(PARAMETERS) :], self.values[len(PARAMETERS) :].tolist(), strict=True))

    def value_of(self, name: str) -> dict[str, float]:
        """Return the values of one effect's parameters by their names."""
        own = f"{name}."
        found = self.of_effects().items()
        return {key.removeprefix(own): value for key, value in found if key.startswith(own)}


@dataclass(frozen=True, eq=False)
class Dataset:
    """The dataset of a diagnosis: recordings of a rig, and settings of their simulation.

    Attributes
    ----------
    rig : Rig
        Board, marble, ranges and the recordings with a marble, without their measured tilt.
    digest : str
        Checksum of these recordings, with the tilt.
    segments : tuple of Segment
        Segments predicted by free runs: complete recordings from rest, or windows of recordings in motion.
    folds : (s,) int array
        Index of the recording of each segment.
    runs : tuple of Segment
        Complete recordings, for the filter: it corrects the state in every row, so it needs no restarts, and
        the states of board, marble and push carry over. They have the measured tilt, which free runs lack.
        Recordings of a measured tilt without a marble follow.
    run_folds : (r,) int array
        Index of the recording of each of `runs`; `NEVER` for those without a marble, which are not held out.
    noise : float
        Standard deviation of the tracker [board edges], from the recordings alone.
    time_scale : float or None
        The time scale of the stamps.
    seed : int
        Random seed.
    threads : int or None
        Threads of the engine.
    held : mapping
        Values at which parameters of effects are held, by effect and name; all others are fitted.
    in_parts : bool
        Whether the recordings are parts of fewer that were recorded.
    """

    rig: Rig
    digest: str
    segments: tuple[Segment, ...]
    folds: NDArray[np.int64]
    runs: tuple[Segment, ...]
    run_folds: NDArray[np.int64]
    noise: float
    time_scale: float | None
    seed: int
    threads: int | None
    held: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    in_parts: bool = False

    @classmethod
    def of(cls, rig: Rig, *, seed: int = 0, threads: int | None = None) -> Dataset:
        """Return the dataset of a rig.

        Raises
        ------
        IrtError
            If only some recordings are stamped.
        """
        # Without a marble the tilt is all that a recording shows.
        sweeps = [one for one in rig.recordings if not one.has_marble and compared_tilt(one) is not None]
        of_marbles = rig.of_marbles(with_tilt=True)
        digest = replace(rig, recordings=(*of_marbles.recordings, *sweeps)).digest
        with_tilt = in_parts(of_marbles)
        tilts = {one.name: compared_tilt(one) for one in (*with_tilt.recordings, *sweeps)}
        rig = with_tilt.of_marbles()
        cut = tuple(segments(rig))
        whole = [*segments(rig, whole=True), *segments(replace(rig, recordings=tuple(sweeps)), whole=True)]
        runs = tuple(replace(one, run=replace(one.run, tilt=tilts[one.recording])) for one in whole)
        number = {one.name: fold for fold, one in enumerate(rig.recordings)}
        folds, run_folds = (
            np.array([number.get(one.recording, NEVER) for one in parts]) for parts in (cut, runs)
        )
        return cls(
            rig=rig,
            digest=digest,
            segments=cut,
            folds=folds,
            runs=runs,
            run_folds=run_folds,
            noise=tracker_noise(cut),
            time_scale=stamped_time_scale(rig),
            seed=seed,
            threads=threads,
            in_parts=with_tilt is not of_marbles,
        )

    @property
    def has_tilt(self) -> bool:
        """Whether the filter sees a measured tilt."""
        return any(one.run.has_tilt for one in self.runs)

    @property
    def sweeps(self) -> list[Recording]:
        """Recordings of a measured tilt without a marble."""
        return [one.run for one in self.runs if not one.run.has_marble]

    def only(self, folds: Sequence[int]) -> Dataset:
        """Return the dataset restricted to the given folds."""
        keep, stay = np.isin(self.folds, folds), np.isin(self.run_folds, [*folds, NEVER])
        return replace(
            self,
            segments=tuple(itertools.compress(self.segments, keep)),
            folds=self.folds[keep],
            runs=tuple(itertools.compress(self.runs, stay)),
            run_folds=self.run_folds[stay],
        )

    def holding(self, name: str, values: Mapping[str, float]) -> Dataset:
        """Return the dataset with parameters of an effect held at these values."""
        return replace(self, held={**self.held, name: values})

    def problem(self, effects: Sequence[str]) -> Problem:
        """Return the problem of fitting the five parameters and those of effects to free runs."""
        return self._problem(self.segments, effects)

    def grey_box(
        self, effects: Sequence[str], *, within: Mapping[str, tuple[float, float]] | None = None
    ) -> Problem:
        """Return the same problem for the filter over complete recordings; `within` replaces some ranges."""
        return self._problem(self.runs, effects, within)

    def _problem(
        self,
        parts: Sequence[Segment],
        effects: Sequence[str],
        within: Mapping[str, tuple[float, float]] | None = None,
    ) -> Problem:
        return Problem.of(
            self.rig,
            parts,
            effects=[Effect(name, {}) for name in effects],
            time_scale=self.time_scale,
            noise=self.noise,
            held=self.held,
            within=within,
            threads=self.threads,
        )

    def fit(
        self,
        effects: Sequence[str] = (),
        *,
        points: Array | None = None,
        starts: int = 8,
        rounds: int = 3,
    ) -> Fitted:
        """Fit a hypothesis, from given points or from a random draw.

        Parameters
        ----------
        effects : sequence of str
            The added effects.
        points : (k, n) array, optional
            Start points; by default they are drawn.
        starts, rounds : int
            As in `Problem.fit`.
        """
        problem = self.problem(effects)
        with located(f"{self.rig.path}"):
            solution = problem.fit(points=points, starts=starts, seed=self.seed, rounds=rounds)
        return Fitted.of(self, effects, problem, solution)

    def judge(self, effects: Sequence[str], points: Array) -> list[Fitted]:
        """Evaluate each of (k, n) points; only start states are estimated."""
        problem = self.problem(effects)
        return [Fitted.of(self, effects, problem, one) for one in problem.judge(points)]

    def model(self, effects: Sequence[str], values: Mapping[str, float]) -> Model:
        """Return the model with these effects and values, named as in `Fitted`."""
        named = [name for name in effects if name != SPINNING]
        own = {name: [key for key in values if key.startswith(f"{name}.")] for name in named}
        board = self.rig.board
        spinning = max(0.0, board.spinning_friction + values.get(SPIN, 0.0))
        return Model.from_rig(
            replace(self.rig, board=replace(board, spinning_friction=spinning)),
            [values[name] for name in PARAMETERS],
            effects=[
                Effect(name, {key.removeprefix(f"{name}."): values[key] for key in keys})
                for name, keys in own.items()
            ],
            time_step="continuous",
        )

    def row_s(self, fitted: Fitted) -> float:
        """Return the duration of a row [s], from stamps or else from a fit."""
        own = fitted.values[PARAMETERS.index("time_scale")]
        return float(own if self.time_scale is None else self.time_scale) * SUBSTEP_S

    def edge_m(self, fitted: Fitted) -> float:
        """Return the distance on the board that is observed as one board edge [m]."""
        return float(self.rig.board.edge_x_m / fitted.values[PARAMETERS.index("observation_scale")])

    def horizon_s(self, model: Model) -> float:
        """Return `config.HORIZON_S` in a model's time [s]: without stamps, as many rows for every model."""
        row_s = horizon_row_s(self.rig)
        if row_s is None:
            return config.HORIZON_S
        return config.HORIZON_S * model.parameters["time_scale"].value * SUBSTEP_S / row_s


def horizon_row_s(rig: Rig) -> float | None:
    """Return the duration of a row [s] by which `config.HORIZON_S` is counted in rows; None with stamps.

    Without stamps each fit has a time scale of its own. The middle of its range is the same for all of them.
    """
    if stamped_time_scale(rig) is not None:
        return None
    return float(np.mean(rig.ranges["time_scale"])) * SUBSTEP_S


def _of_stretches(residuals: Sequence[Array]) -> float:
    """Return the root mean square of the robust standard deviations of stretches of rows (rows, 2)."""
    stretches = [one[first : first + _STRETCH] for one in residuals for first in range(0, len(one), _STRETCH)]
    found = [deviation(one) for one in stretches if np.isfinite(one).any()]
    return math.sqrt(float(np.mean(np.square(found)))) if found else math.nan
