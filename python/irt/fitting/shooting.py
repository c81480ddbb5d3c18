"""Multiple shooting: many short windows, each with a start state of its own, predicted in one batch.

Long free runs hide the way to the solution (stops and walls make the error jump); short windows show it. The
price is a start state for every window, which only that window's residuals know about.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from irt.fitting.coordinates import SCALE, TIME, Coordinates
from irt.rollouts import SUBSTEP_S, Engine, rollouts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from irt.model import Model
    from irt.residual import Segment
    from irt.rig import Rig

Array = NDArray[np.float64]


#: Steps of the finite differences: in coordinates (relative changes) and in start states (board edges, and
#: board edges per row). Large against the jumps of a stop that moves by one physics step, small against
#: the curvature of the motion.
STEP, STATE_STEP = 1e-3, 1e-4
#: The share of these steps with which a careful look is taken.
FINE = 0.03
#: Two slopes agree within this share of their sizes, or this much [edges per unit].
AGREEMENT, AGREEMENT_FLOOR = 0.1, 0.01
#: Rows from which the first guess of a window's start state is made.
GUESS_ROWS = 6


@dataclass(frozen=True, eq=False)
class Windows:
    """Stretches of recordings, padded at their ends to one length.

    Attributes
    ----------
    knobs : (w, n, 2) array
        Commands [rad]; the last one is repeated over the padding.
    durations : (w, n) array or None
        Seconds that each command holds, where the recordings are stamped.
    observed : (w, n, 2) array
        Positions [board edges], zero where `known` is false.
    known : (w, n, 2) bool array
        False where the tracker lost the marble and over the padding.
    at_rest : (w,) bool array
        True where the start velocity is known to be zero.
    guess : (w, 4) array
        First guess of the start states: x, y [board edges] and their rates [board edges per row].
    origin : (w, 2) int array
        Index of the segment and of its row where the window begins.
    """

    knobs: Array
    durations: Array | None
    observed: Array
    known: NDArray[np.bool_]
    at_rest: NDArray[np.bool_]
    guess: Array
    origin: NDArray[np.int64]

    @property
    def unknowns(self) -> int:
        """How many components of start states the windows have together."""
        return int(4 * len(self.at_rest) - 2 * self.at_rest.sum())

    @property
    def state_columns(self) -> int:
        """How many components of a start state are open: 2 where every window starts at rest, else 4."""
        return 2 if self.at_rest.all() else 4


def cut(segments: Sequence[Segment], rows: int, *, at_rest: bool) -> Windows:
    """Cut segments into windows of at most `rows` rows.

    Parameters
    ----------
    segments : sequence of Segment
        All stamped or none.
    rows : int
        Length of a window; a segment's last one may be shorter. Windows with fewer than three rows that the
        tracker saw are left out: they say less than their start state takes.
    at_rest : bool
        Whether the marble rests before row 0 of a recording.
    """
    origin = [
        (index, first)
        for index, segment in enumerate(segments)
        for first in range(0, len(segment.knobs), rows)
        if np.isfinite(segment.observed[first : first + rows]).all(axis=1).sum() >= 3
    ]
    n = min(rows, max(len(segment.knobs) for segment in segments))
    shape = (len(origin), n)
    knobs, observed = np.zeros((*shape, 2)), np.full((*shape, 2), np.nan)
    durations = None if segments[0].durations is None else np.zeros(shape)
    resting, guess = np.zeros(len(origin), dtype=bool), np.zeros((len(origin), 4))
    for w, (index, first) in enumerate(origin):
        segment = segments[index]
        m = min(rows, len(segment.knobs) - first)
        knobs[w, :m], knobs[w, m:] = segment.knobs[first : first + m], segment.knobs[first + m - 1]
        observed[w, :m] = segment.observed[first : first + m]
        if durations is not None and segment.durations is not None:
            durations[w, :m] = segment.durations[first : first + m]
            durations[w, m:] = segment.durations[first + m - 1]
        resting[w] = at_rest and first == 0 and segment.first_row == 0
        guess[w] = _guess(segment.observed, first, resting=bool(resting[w]))
    known = np.isfinite(observed)
    return Windows(knobs, durations, np.where(known, observed, 0.0), known, resting, guess, np.array(origin))


def _guess(observed: Array, first: int, *, resting: bool) -> Array:
    """Position and rate at row `first`, from medians over the nearest rows seen: one outlier is harmless."""
    seen = np.flatnonzero(np.isfinite(observed).all(axis=1))
    near = seen[np.argsort(np.abs(seen - first), kind="stable")[: 3 if resting else GUESS_ROWS]]
    time, place = (near - first).astype(float), observed[near]
    rate = np.zeros(2)
    if not resting and len(near) > 1:
        i, j = np.triu_indices(len(near), 1)
        rate = np.median((place[j] - place[i]) / (time[j] - time[i])[:, None], axis=0)
    return np.concatenate([np.median(place - time[:, None] * rate, axis=0), rate])


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals and their derivatives at k candidates, each over w windows of N = 2n residuals.

    Attributes
    ----------
    residual : (k, w, N) array
        Predicted minus observed [board edges]; zero where nothing was seen.
    by_z : (k, w, N, 5) array
        Derivative with respect to the coordinates.
    by_state : (k, w, N, s) array
        Derivative of a window's residuals with respect to its own start state; other windows' do not enter.
    """

    residual: Array
    by_z: Array
    by_state: Array


class Shooting:
    """Residuals of k candidates at once over w windows; each call is one batch of rollouts.

    Parameters
    ----------
    rig : Rig or Model
        For its board and marble.
    coordinates : Coordinates
        What z means.
    windows : Windows
        What is predicted.
    engine : {"rolling", "rapier"}
        What simulates.
    threads : int, optional
        The result does not depend on it.
    coarseness : int
        Physics steps this many times longer than the engine's own: for the way to a solution, not for the
        solution. Stamped recordings are simulated with the engine's own steps anyway.
    """

    def __init__(
        self,
        rig: Rig | Model,
        coordinates: Coordinates,
        windows: Windows,
        *,
        engine: Engine = "rolling",
        threads: int | None = None,
        coarseness: int = 1,
    ) -> None:
        self.coordinates, self.windows, self.rollouts = coordinates, windows, 0
        self._rig, self._engine, self._threads = rig, engine, threads
        self._coarseness = coarseness
        edges, radius = (rig.board.edge_x_m, rig.board.edge_y_m), rig.marble.radius_m
        self._room = (np.array(edges) / 2.0 - radius) / rig.board.edge_x_m
        self._row_s = None if windows.durations is None else np.median(windows.durations, axis=1)

    def residuals(self, z: Array, states: Array, more_steps: int = 0) -> Array:
        """Return (k, w, N) residuals at z (k, 5) and start states (k, w, 4).

        `more_steps` shorter physics steps a row, or with a minus sign fewer longer ones, show what the
        residuals owe to the steps alone.
        """
        substeps = np.maximum(self._substeps(z) + more_steps, 1)
        return self._residuals(z[:, None], states[:, None], substeps[:, None])[:, 0]

    def linearise(self, z: Array, states: Array, *, careful: bool = False) -> Linearisation:
        """Return residuals and Jacobians at z (k, 5) and start states (k, w, 4), by finite differences.

        `careful` looks twice, with steps of two sizes, and believes the gentler slope: where an impact
        shortly before or after decides where the marble goes, a step of one size sees a cliff.
        """
        residual, slope = self._slopes(z, states, 1.0)
        if careful:
            slope = _gentler(slope, self._slopes(z, states, FINE)[1])
        slope = np.moveaxis(slope, 1, -1)
        to_z = np.linalg.inv(self.coordinates.axes).T
        return Linearisation(residual, slope[..., :5] @ to_z, slope[..., 5:])

    def _slopes(self, z: Array, states: Array, fineness: float) -> tuple[Array, Array]:
        """Residuals (k, w, N), and slopes (k, 5 + s, w, N) along the axes and components of start states.

        The number of physics steps is the centre's for every column: one that rounded to another number would
        jump. But then a change of the time scale also changes how long a step is, and what impacts do depends
        on that a little; so this column is taken a second time, with one step more or less of equal length.
        """
        k, components, axes = len(z), self.windows.state_columns, self.coordinates.axes
        columns = 6 + components
        z, states = self.coordinates.clip(z), self._within(z[:, None], states[:, None])[:, 0]
        centre = self._substeps(z)
        steps, substeps = np.empty((k, 2, columns)), np.repeat(centre[:, None], 1 + 2 * columns, axis=1)
        zs = np.repeat(z[:, None], 1 + 2 * columns, axis=1)
        ss = np.repeat(states[:, None], 1 + 2 * columns, axis=1)
        for side, sign in enumerate((1, -1)):
            at = 1 + side * columns
            other = np.maximum(centre + sign, 1)
            substeps[:, at + 5] = other
            steps[:, side, :5], steps[:, side, 5] = sign * fineness * STEP, np.log(other / centre)
            steps[:, side, 6:] = sign * fineness * STATE_STEP
            zs[:, at : at + 6] += steps[:, side, :6, None] * np.vstack([axes, axes[TIME]])
            for component in range(components):
                ss[:, at + 6 + component, :, component] += sign * fineness * STATE_STEP
        r = self._residuals(zs, ss, substeps)
        # Outside the bounds, beyond the walls and where a marble at rest would move there is no slope.
        inside = np.all(np.abs(self.coordinates.clip(zs) - zs) < 1e-12, axis=2)[..., None]
        inside = (inside & np.all(self._within(zs, ss) == ss, axis=3))[:, 1:].reshape(k, 2, columns, -1)
        inside &= (steps != 0.0)[..., None]
        change = (r[:, 1:] - r[:, :1]).reshape(k, 2, columns, *r.shape[2:])
        slopes = np.full(change.shape, np.nan)
        np.divide(change, steps[..., None, None], out=slopes, where=inside[..., None])
        slope = _agreed(slopes[:, 0], slopes[:, 1])
        slope[:, TIME] = _gentler(slope[:, TIME], slope[:, 5])
        return r[:, 0], np.delete(slope, 5, axis=1)

    def _substeps(self, z: Array) -> NDArray[np.int64]:
        """Physics steps (k,) of a row at z (k, 5)."""
        time_scale = self.coordinates.to_p(z)[:, TIME]
        return np.maximum(1, np.rint(time_scale / self._coarseness)).astype(np.int64)

    def _within(self, z: Array, states: Array) -> Array:
        """Start states (k, c, w, 4) between the walls, and at rest where the recording says so."""
        scale = np.abs(self.coordinates.to_p(z)[..., SCALE])
        reach = scale[:, :, None, None] * self._room
        inside = states.copy()
        inside[..., :2] = np.clip(states[..., :2], -reach, reach)
        inside[..., 2:] *= ~self.windows.at_rest[:, None]
        return inside

    def _residuals(self, z: Array, states: Array, substeps: NDArray[np.int64]) -> Array:
        """Residuals (k, c, w, N) at z (k, c, 5), start states (k, c, w, 4) and physics steps a row (k, c)."""
        k, c, w = z.shape[0], z.shape[1], len(self.windows.knobs)
        n, p, states = k * c * w, self.coordinates.to_p(z), self._within(z, states)
        row_s = p[:, :, None, TIME] * SUBSTEP_S if self._row_s is None else self._row_s[None, None]

        def each(of_windows: Array) -> Array:
            return np.broadcast_to(of_windows, (k, c, *of_windows.shape)).reshape(n, *of_windows.shape[1:])

        durations = self.windows.durations
        predicted = rollouts(
            np.repeat(p.reshape(-1, 5), w, axis=0),
            each(self.windows.knobs),
            rig=self._rig,
            engine=self._engine,
            start=states[..., :2].reshape(n, 2),
            start_velocity=(states[..., 2:] / row_s[..., None]).reshape(n, 2),
            durations=None if durations is None else each(durations),
            time_step="continuous",
            substeps=np.repeat(substeps.ravel(), w) if durations is None else None,
            threads=self._threads,
        )
        self.rollouts += n
        predicted = predicted.reshape(k, c, *self.windows.observed.shape)
        return np.where(self.windows.known, predicted - self.windows.observed, 0.0).reshape(k, c, w, -1)


def _agreed(ahead: Array, behind: Array) -> Array:
    """Return the mean of two one-sided slopes, or the gentler one where they disagree; NaN means none.

    They disagree where a stop or an impact lies on one side: such an event moves by whole physics steps, a
    jump that a finite difference takes for a cliff.
    """
    ahead, behind = np.where(np.isnan(ahead), behind, ahead), np.where(np.isnan(behind), ahead, behind)
    agree = np.abs(ahead - behind) <= AGREEMENT * (np.abs(ahead) + np.abs(behind)) + AGREEMENT_FLOOR
    return np.nan_to_num(np.where(agree, 0.5 * (ahead + behind), _gentler(ahead, behind)))


def _gentler(one: Array, other: Array) -> Array:
    return np.where(np.abs(one) < np.abs(other), one, other)
