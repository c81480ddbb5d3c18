"""Stretches of recordings in which pushes alone move the marble: away from the rim, and not at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.screen import EARLIER, Screen, Window
from irt.engine import GRAVITY
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Rows of a stretch, at most and at least.
LONGEST, SHORTEST = 24, 10
#: What a slope pulls [m/s^2].
PULL = 5.0 / 7.0 * GRAVITY
#: Distance from the rim at which the marble is free [board edges].
FREE = 0.012
#: Speed a row below which the marble may be at rest, and misses beyond which a prediction is lost [noise].
SLOW, ASTRAY = 1.0, 50.0
#: Commands that arrive so many rows before a stretch or after it may, by chance, arrive in it.
_EARLY = 3.0
#: Draws of delays that differ, and steps in which their mean is found.
_DRAWS, _HALVINGS = 256, 10
#: Rows to either side through which observed paths are smoothed.
_SMOOTH = 3


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Changes of the commands, c of them.

    Attributes
    ----------
    at : (c,) array
        When they arrive on average [rows of the recording].
    late : float
        How long that is after they were sent [rows].
    push : (c, 2) array
        By how much they change the push on the marble [board edges a row squared].
    """

    at: Array
    late: float
    push: Array

    def between(self, first: float, last: float) -> Arrivals:
        """Return those that may arrive between two rows."""
        own = (self.at > first - _EARLY) & (self.at < last + _EARLY)
        return Arrivals(self.at[own], self.late, self.push[own])

    def jittered(self, time: Array, spread: float) -> Array:
        """Return draws (2m, _DRAWS) of how a marble is moved in m rows where delays differ by so many rows.

        All rows of x, then of y: a command that comes late does so for both axes. One that a later one
        overtakes does nothing, as if it came with that, and none comes before it is sent. On average they
        come as they do without.
        """
        if not len(self.at):
            return np.zeros((2 * len(time), _DRAWS))
        drawn, sent = spread * _random(len(self.at)), self.at[:, None] - self.late

        def late(mean: float) -> Array:
            arrive = sent + np.maximum(mean + drawn, 0.0)
            return np.asarray(np.minimum.accumulate(arrive[::-1])[::-1] - sent)

        # The mean before what is overtaken comes sooner, and nothing before it is sent.
        low, high = 0.0, self.late + 5.0 * spread
        for _ in range(_HALVINGS):
            mean = 0.5 * (low + high)
            low, high = (mean, high) if late(mean).mean() < self.late else (low, mean)
        found = late(low)
        return self.moved(time, found - found.mean())

    def moved(self, time: Array, late: Array) -> Array:
        """Return how commands (c, k) rows late move a marble in m rows, (2m, k): first x, then y."""
        since = time[:, None] - self.at
        moved = np.maximum(since[:, :, None] - late, 0.0) ** 2 - np.maximum(since, 0.0)[:, :, None] ** 2
        return np.asarray(0.5 * np.einsum("mck,ca->amk", moved, self.push).reshape(2 * len(time), -1))


def _random(count: int) -> Array:
    return np.random.default_rng(0).standard_normal((count, _DRAWS))


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of all stretches, n of them.

    Attributes
    ----------
    place : (n, 2) array
        Where the marble is [board edges].
    velocity : (n, 2) array
        How it moves [board edges a row].
    knobs : (n, 2) array
        The command that holds [rad].
    turned : (n, EARLIER, 2) array
        By how much it differs from the one before, that from the one before it, and so on.
    arrivals : tuple of Arrivals
        The commands that arrive in each stretch.
    time : (n,) array
        Row of the recording.
    run : (n,) int array
        Which recording.
    stretch : (n,) int array
        Which stretch.
    """

    place: Array
    velocity: Array
    knobs: Array
    turned: Array
    arrivals: tuple[Arrivals, ...]
    time: Array
    run: NDArray[np.int64]
    stretch: NDArray[np.int64]


def integrator(rows: int) -> Array:
    """Return how a push in row j moves the marble by row i, (rows, rows): half of it in the row itself."""
    late = np.arange(rows)[:, None] - np.arange(rows)
    return np.where(late > 0, late - 0.5, 0.0)


def _spread_out(count: int) -> NDArray[np.int64]:
    """Return indices in an order in which any first few are spread over all of them: the golden section's."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0, kind="stable")


def stretches(
    case: Case, fitted: Fitted, longest: int, *, weak: bool, most: int
) -> tuple[Rows, Array, list[Array]]:
    """Return rows, residuals (n, 2), and for each coordinate a basis (n, f) of what else could move it.

    Of more rows than `most` whole stretches are taken, spread over the recordings.
    """
    reach, late = case.model(fitted).reach, _Lateness.of(case, fitted)
    screen = Screen(case, fitted, longest)
    pieces: list[_Piece] = []
    windows = screen.windows()
    for index in _spread_out(len(windows)):
        if sum(len(piece.place) for piece in pieces) >= most:
            break
        window = windows[index]
        piece = _observed(window, late, case.noise) if weak else _predicted(window, late)
        free = (np.abs(piece.place) < reach - FREE).all(axis=1) & np.isfinite(piece.residual).all(axis=1)
        if weak:
            # A marble at rest feels a push no more than the friction that holds it.
            free &= np.linalg.norm(piece.velocity, axis=1) > SLOW * case.noise
        else:
            free &= (np.abs(piece.residual) < ASTRAY * case.noise).all(axis=1)
        first, stop = _longest(np.asarray(free))
        if stop - first >= SHORTEST:
            pieces.append(piece.cut(first, stop))
    if not pieces:
        empty, none = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
        turned = np.zeros((0, EARLIER, 2))
        return Rows(empty, empty, empty, turned, (), np.zeros(0), none, none), empty, []
    lengths = [len(piece.place) for piece in pieces]
    rows = Rows(
        place=np.concatenate([piece.place for piece in pieces]),
        velocity=np.concatenate([piece.velocity for piece in pieces]),
        knobs=np.concatenate([piece.knobs for piece in pieces]),
        turned=np.concatenate([piece.turned for piece in pieces]),
        arrivals=tuple(piece.arrivals for piece in pieces),
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
    """Rows of a window: as in `Rows`, with residuals (n, 2) and what else could move them, (f, n, 2)."""

    run: int
    place: Array
    velocity: Array
    knobs: Array
    turned: Array
    arrivals: Arrivals
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
            self.arrivals.between(time[0], time[-1]),
            time,
            self.residual[own],
            self.fixed[:, own],
        )


def _predicted(window: Window, late: _Lateness) -> _Piece:
    """Return a window as the hypothesis predicts it: where that is near, the best view."""
    return _Piece(
        run=window.run,
        place=window.place,
        velocity=np.gradient(window.place, axis=0),
        knobs=window.knobs,
        turned=window.turned,
        arrivals=late.arrivals(window),
        time=window.first + np.arange(len(window.place), dtype=np.float64),
        residual=window.residual,
        fixed=window.of_base,
    )


def _observed(window: Window, late: _Lateness, noise: float) -> _Piece:
    """Return a window as it was observed, whatever the base model makes of it.

    The motion itself is the residual: gears and rolling friction are among what else could move the marble.
    """
    seen = window.place + window.residual
    path, velocity = _smoothed(seen)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    friction = -velocity / np.maximum(speed, noise)
    integral = integrator(len(seen))
    return _Piece(
        run=window.run,
        place=path,
        velocity=velocity,
        knobs=window.knobs,
        turned=window.turned,
        arrivals=late.arrivals(window),
        time=window.first + np.arange(len(path), dtype=np.float64),
        residual=seen,
        # A turn about y pushes along x, a turn about x along y.
        fixed=np.array([integral @ window.knobs[:, ::-1], integral @ friction]),
    )


@dataclass(frozen=True, eq=False)
class _Lateness:
    """When the commands of a hypothesis arrive, and what they do.

    Attributes
    ----------
    rows : float
        How late they arrive on average.
    pull : (2,) array
        Push along x of a turn of the y knob, and along y of one of the x knob [board edges a row squared].
    """

    rows: float
    pull: Array

    @classmethod
    def of(cls, case: Case, fitted: Fitted) -> _Lateness:
        row_s, told = case.row_s(fitted), fitted.of_effects()
        seconds = sum(told.get(name, 0.0) for name in ("delay.delay_s", "latency.latency_s"))
        gear_x, gear_y = (fitted.values[PARAMETERS.index(name)] for name in ("gear_x", "gear_y"))
        # A turn about y pushes along x, a turn about x against y.
        pull = PULL * row_s**2 / case.edge_m(fitted) * np.array([gear_y, -gear_x])
        return cls(seconds / row_s, pull)

    def arrivals(self, window: Window) -> Arrivals:
        """Return the changes of the commands of a window, and of those before it."""
        changes = np.concatenate([window.turned[0, :0:-1], window.turned[:, 0]])
        at = np.asarray(window.first + np.arange(len(changes)) - (EARLIER - 1) + self.rows)
        return Arrivals(at, self.rows, self.pull * changes[:, ::-1])


def _smoothed(seen: Array) -> tuple[Array, Array]:
    """Return path and velocity a row, (n, 2) each, by parabolas through seven rows around each."""
    rows = np.arange(len(seen), dtype=np.float64)
    path, velocity = np.full_like(seen, np.nan), np.full_like(seen, np.nan)
    known = np.isfinite(seen).all(axis=1)
    for row in range(len(seen)):
        near = np.flatnonzero(known & (np.abs(rows - row) <= _SMOOTH))
        if len(near) > 3:
            powers = np.vander(rows[near] - row, 3, increasing=True)
            told = np.linalg.lstsq(powers, seen[near])[0]
            path[row], velocity[row] = told[0], told[1]
    return path, velocity


def runs(free: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first row and end of each run of free rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def _longest(free: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the longest run of free rows."""
    return max(runs(free), key=lambda run: run[1] - run[0], default=(0, 0))


def _basis(rows: Rows, columns: list[Array]) -> Array:
    """Return an orthonormal basis of columns, and of the start states of all stretches, (n, f)."""
    for stretch in np.unique(rows.stretch):
        own = (rows.stretch == stretch).astype(np.float64)
        columns = [*columns, own, own * (rows.time - rows.time[own > 0.0].mean())]
    matrix = np.column_stack(columns)
    kept = np.linalg.norm(matrix, axis=0) > 0.0
    matrix = matrix[:, kept] / np.linalg.norm(matrix[:, kept], axis=0)
    left, singular, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(left[:, singular > 1e-8 * singular.max()])
