"""Segments of free motion: the marble is away from the rim and not at rest, so only pushes move it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.dataset import Fitted
from irt.diagnosis.windows import EARLIER, Window, Windows
from irt.engine import GRAVITY

Array = NDArray[np.float64]

#: Most and least rows of a segment.
LONGEST, SHORTEST = 24, 10
#: Acceleration per slope of a rolling marble [m/s^2].
PULL_OF_SLOPE = 5.0 / 7.0 * GRAVITY
#: Smallest distance from the rim in free motion [board edges].
FREE = 0.012
#: Smallest speed in motion, per row, over the tracker's noise: three standard deviations of the speed by a
#: parabola through seven rows, 1/sqrt(28) of the noise.
SLOW = 0.57
#: Largest error of a usable prediction over the tracker's noise.
ASTRAY = 50.0
#: Half-width of the smoothing of observed paths [rows].
_SMOOTH = 3


@dataclass(frozen=True, eq=False)
class Rows:
    """The n rows of all segments of free motion.

    Attributes
    ----------
    place : (n, 2) array
        Position of the marble [board edges].
    velocity : (n, 2) array
        Its velocity [board edges per row].
    knobs : (n, 2) array
        The command [rad].
    turned : (n, EARLIER, 2) array
        Differences of successive commands, the latest first [rad].
    time : (n,) array
        Row of the recording.
    run : (n,) int array
        Index of the recording.
    stretch : (n,) int array
        Index of the segment.
    """

    place: Array
    velocity: Array
    knobs: Array
    turned: Array
    time: Array
    run: NDArray[np.int64]
    stretch: NDArray[np.int64]


#: Rows, residuals (n, 2), and for each coordinate a basis (n, f) of nuisance directions.
Free = tuple[Rows, Array, list[Array]]


def integrator(rows: int) -> Array:
    """Return the displacement in row i by a unit push in row j, (rows, rows)."""
    late = np.arange(rows)[:, None] - np.arange(rows)
    return np.where(late > 0, late - 0.5, 0.0)


def _spread_out(count: int) -> NDArray[np.int64]:
    """Return indices in a golden-section order, in which any first few are spread evenly."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0, kind="stable")


def free_motion(fitted: Fitted, longest: int, *, weak: bool, most: int) -> Free:
    """Return rows, residuals (n, 2), and for each coordinate a basis (n, f) of nuisance directions.

    At most about `most` rows are used, as complete segments that are spread over the recordings.
    """
    dataset, reach = fitted.dataset, fitted.model.reach
    screen = Windows(fitted, longest)
    pieces: list[_Piece] = []
    windows = screen.windows()
    for index in _spread_out(len(windows)):
        if sum(len(piece.place) for piece in pieces) >= most:
            break
        window = windows[index]
        piece = _observed(window, dataset.noise) if weak else _predicted(window)
        free = (np.abs(piece.place) < reach - FREE).all(axis=1) & np.isfinite(piece.residual).all(axis=1)
        if weak:
            # A marble at rest is held by friction and does not respond to pushes.
            free &= np.linalg.norm(piece.velocity, axis=1) > SLOW * dataset.noise
        else:
            free &= (np.abs(piece.residual) < ASTRAY * dataset.noise).all(axis=1)
        pieces += [
            piece.cut(first, stop) for first, stop in runs(np.asarray(free)) if stop - first >= SHORTEST
        ]
    if not pieces:
        empty, none = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
        turned = np.zeros((0, EARLIER, 2))
        return Rows(empty, empty, empty, turned, np.zeros(0), none, none), empty, []
    lengths = [len(piece.place) for piece in pieces]
    rows = Rows(
        place=np.concatenate([piece.place for piece in pieces]),
        velocity=np.concatenate([piece.velocity for piece in pieces]),
        knobs=np.concatenate([piece.knobs for piece in pieces]),
        turned=np.concatenate([piece.turned for piece in pieces]),
        time=np.concatenate([piece.time for piece in pieces]),
        run=np.repeat([piece.run for piece in pieces], lengths),
        stretch=np.repeat(np.arange(len(pieces)), lengths),
    )
    shared = np.concatenate([piece.fixed for piece in pieces], axis=1)
    fixed = [_basis(rows, [one[:, axis] for one in shared]) for axis in (0, 1)]
    residuals = np.concatenate([piece.residual for piece in pieces])
    return rows, residuals, fixed


@dataclass(frozen=True, eq=False)
class _Piece:
    """Rows of a window as in `Rows`, with residuals (n, 2) and nuisance directions (f, n, 2)."""

    run: int
    place: Array
    velocity: Array
    knobs: Array
    turned: Array
    time: Array
    residual: Array
    fixed: Array

    def cut(self, first: int, stop: int) -> _Piece:
        own = slice(first, stop)
        time = self.time[own]
        return _Piece(
            self.run,
            self.place[own],
            self.velocity[own],
            self.knobs[own],
            self.turned[own],
            time,
            self.residual[own],
            self.fixed[:, own],
        )


def _predicted(window: Window) -> _Piece:
    """Return a window with the residuals of the hypothesis, most accurate if these are small."""
    return _Piece(
        run=window.run,
        place=window.place,
        velocity=np.gradient(window.place, axis=0),
        knobs=window.knobs,
        turned=window.turned,
        time=window.first + np.arange(len(window.place), dtype=np.float64),
        residual=window.residual,
        fixed=window.of_base,
    )


def _observed(window: Window, noise: float) -> _Piece:
    """Return a window with the observed motion as residual, independent of the base model.

    Gears and rolling friction become nuisance directions.
    """
    seen = window.place + window.residual
    path, velocity = path_and_velocity(seen)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    friction = -velocity / np.maximum(speed, noise)
    integral = integrator(len(seen))
    return _Piece(
        run=window.run,
        place=path,
        velocity=velocity,
        knobs=window.knobs,
        turned=window.turned,
        time=window.first + np.arange(len(path), dtype=np.float64),
        residual=seen,
        # A turn about y pushes along x, a turn about x along y.
        fixed=np.array([integral @ window.knobs[:, ::-1], integral @ friction]),
    )


def path_and_velocity(seen: Array) -> tuple[Array, Array]:
    """Return path and velocity per row, (n, 2) each, from parabolas fitted to seven rows around each."""
    rows = np.arange(len(seen), dtype=np.float64)
    path, velocity = np.full_like(seen, np.nan), np.full_like(seen, np.nan)
    known = np.isfinite(seen).all(axis=1)
    for row in range(len(seen)):
        near = np.flatnonzero(known & (np.abs(rows - row) <= _SMOOTH))
        if len(near) > 3:
            powers = np.vander(rows[near] - row, 3, increasing=True)
            coefficients = np.linalg.lstsq(powers, seen[near])[0]
            path[row], velocity[row] = coefficients[0], coefficients[1]
    return path, velocity


def runs(free: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first row and end of each sequence of free rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def _basis(rows: Rows, columns: list[Array]) -> Array:
    """Return an orthonormal basis of columns and of the start states of all segments, (n, f)."""
    for stretch in np.unique(rows.stretch):
        own = (rows.stretch == stretch).astype(np.float64)
        columns = [*columns, own, own * (rows.time - rows.time[own > 0.0].mean())]
    matrix = np.column_stack(columns)
    kept = np.linalg.norm(matrix, axis=0) > 0.0
    matrix = matrix[:, kept] / np.linalg.norm(matrix[:, kept], axis=0)
    left, singular, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(left[:, singular > 1e-8 * singular.max()])
