"""Test for positions in metres instead of board edges, by the positions of walls.

In free motion a scale of the positions is equivalent to a scale of the gears, so motion alone does not
identify the unit. Walls have known positions: positions in metres show walls where the board has none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.checking.responses import first_values, responses
from irt.checking.runs import rim_masks, row_step
from irt.checking.signals import clean
from irt.engine import SUBSTEP_S
from irt.fitting.problem import Problem
from irt.rig import PARAMETERS, Rig
from irt.segments import SEGMENT_S, segments

Array = NDArray[np.float64]

#: Minimum number of tracked rows in a window; fewer hardly determine more than their start state.
_LEAST_SEEN = 8
#: Number of iterations of a fit that starts at the gears of a regression.
_ITERATIONS = 6
#: Parameters that are proportional to the scale of accelerations.
_SCALED = [PARAMETERS.index(name) for name in ("gear_x", "gear_y", "rolling_friction")]


def nats_for_metres(rig: Rig, corner: Array, noise: float, threads: int | None = None) -> float:
    """Return the log likelihood ratio of positions in metres against board edges [nats].

    Both units are fitted in windows of 2.5 s, each from its own regression and from the other's fit; without
    wall contacts both have the same residuals. Residuals within a window are correlated, so that a window
    counts as one normal number per axis with a free scale: its log likelihood falls by the logarithm of its
    mean square plus that of the noise. A few windows that no fit explains have little influence.

    Parameters
    ----------
    rig : Rig
        The recordings, with positions read as board edges.
    corner : (2,) array
        Position of the board's centre in the recordings [m].
    noise : float
        Noise of a position, in the recorded unit.
    threads : int, optional
        Threads of the engine; by default one for each core.
    """
    edge = rig.board.edge_x_m
    other = replace(
        rig, recordings=tuple(replace(one, marble=(one.marble - corner) / edge) for one in rig.recordings)
    )
    declared, metres = _Reading.of(rig, noise, threads), _Reading.of(other, noise / edge, threads)
    to_other = np.ones(len(PARAMETERS))
    to_other[_SCALED] = 1.0 / edge
    pairs = zip(
        declared.better(metres.values / to_other), metres.better(declared.values * to_other), strict=True
    )
    known = [
        np.log((one + noise**2) / (edge**2 * two + noise**2)) for one, two in pairs if one > 0.0 and two > 0.0
    ]
    return float(np.sum(known))


@dataclass(frozen=True, eq=False)
class _Reading:
    """A fit of recordings under one unit of their positions.

    Attributes
    ----------
    problem : Problem
        The problem, in windows.
    values : (5,) array
        The fit.
    squares : (w,) array
        Mean square residual of each window [board edges^2]; 0 with too few tracked rows.
    """

    problem: Problem
    values: Array
    squares: Array

    @classmethod
    def of(cls, rig: Rig, noise: float, threads: int | None) -> _Reading:
        """Fit the recordings, starting at the gears of a regression."""
        cleaned = [clean(one) for one in rig.recordings]
        answers = responses(rig, cleaned, rim_masks(rig, [marble for marble, _ in cleaned], noise))
        step = row_step(rig)
        time_scale = None if step is None else step / SUBSTEP_S
        windows = [one for one in segments(rig, SEGMENT_S) if one.run.has_marble]
        problem = Problem.of(rig, windows, time_scale=time_scale, threads=threads)
        begin = first_values(rig, time_scale, answers.get("marble"))
        return cls(problem, *_fitted(problem, begin))

    def better(self, begin: Array) -> Array:
        """Return the squares of this fit, or of one from other values if these are smaller."""
        _, squares = _fitted(self.problem, begin)
        known = (squares > 0.0) & (self.squares > 0.0)
        gained = np.log(squares[known] / self.squares[known]).sum()
        return squares if gained < 0.0 else self.squares


def _fitted(problem: Problem, begin: Array) -> tuple[Array, Array]:
    """Return the fitted values from (5,) start values, and the mean square of each window."""
    (found,) = problem.refine(begin[None], iterations=_ITERATIONS)
    return found.values, np.array([_mean_square(one) for one in found.residuals])


def _mean_square(residuals: Array) -> float:
    """Return the mean square of the tracked rows, 0 if they are too few."""
    known = residuals[np.isfinite(residuals).all(axis=1)]
    return float(np.mean(known**2)) if len(known) >= _LEAST_SEEN else 0.0
