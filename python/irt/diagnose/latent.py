"""What drives the leftover: a push that is not in the model, seen through the marble's motion.

In stretches away from the rim the marble is a double integrator: a push in one row moves all later ones. The
residuals of a hypothesis are what an unknown push leaves after start states and the five parameters have had
their say. Which variable the push depends on is asked of Gaussian processes over each of them, compared by
restricted likelihood (Rasmussen and Williams 2006, section 2.7 and chapter 5; latent force models: Alvarez et
al. 2009). Neither noisy positions nor their differences are ever differentiated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from irt.diagnose.case import Case, Fitted
from irt.diagnose.screen import EARLIER, Screen, Window
from irt.rig import PARAMETERS
from irt.rollouts import SUBSTEP_S

Array = NDArray[np.float64]

#: Rows of a stretch, at most and at least.
LONGEST, SHORTEST = 24, 10
#: Distance from the rim at which the marble is free [board edges].
FREE = 0.012
#: Speed a row below which the marble may be at rest, and misses beyond which a prediction is lost [noise].
SLOW, ASTRAY = 1.0, 50.0
#: Rows to either side through which observed paths are smoothed.
_SMOOTH = 3
#: How far apart commands arrive that differ in delay [rows].
_SPREAD = 1.0
#: Variances of the push tried, by the displacement that they make over that of the tracker's noise.
_SIZES = np.array([0.3, 5.0, 80.0, 1300.0])
#: The 95 % point of a chi-squared variable of one degree of freedom.
_CHI_SQUARED = 3.84
#: Simulated nulls.
NULLS = 99
#: Name of delays that differ from command to command.
JITTER = "jitter"
#: Rows that count, at most: whole stretches, spread over the recordings.
MOST_ROWS = 400


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of all stretches, n of them.

    Attributes
    ----------
    place : (n, 2) array
        Where the marble is [board edges].
    velocity : (n, 2) array
        How it moves [board edges a row].
    knobs, turn : (n, 2) arrays
        The command that holds [rad], and by how much it differs from the one before.
    arriving : (n, 2) array
        Mean square of the changes of the commands that may arrive in a row [rad squared].
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
    turn: Array
    arriving: Array
    time: Array
    run: NDArray[np.int64]
    stretch: NDArray[np.int64]


@dataclass(frozen=True)
class Source:
    """A variable that the leftover may depend on.

    Attributes
    ----------
    variable : str
        "position", "velocity", "command", "time", or what does not repeat: "jitter", "each row anew".
    stage : str
        "force", "command" or "camera".
    gain : float
        Log restricted likelihood over noise alone [nats].
    p_value : float
        Of such a gain or more were there only noise, over all variables tried.
    push : float
        Root mean square of the push [board edges a row squared], or of the picture's shift [board edges].
    """

    variable: str
    stage: str
    gain: float
    p_value: float
    push: float


class Leftover:
    """What a hypothesis leaves over, in stretches away from the rim.

    Parameters
    ----------
    case : Case
        The recordings.
    fitted : Fitted
        The hypothesis. What the base model leaves over is seen in the motion as it was observed, however far
        off that model is; what others leave over, in their predictions' misses.
    """

    def __init__(self, case: Case, fitted: Fitted) -> None:
        screen = Screen(case, fitted, min(LONGEST, *(len(one.knobs) for one in case.segments)))
        self.rows, self._residual, self._fixed = _stretches(
            case, screen, weak=not fitted.effects, late=_lateness(case, fitted)
        )
        self._noise = case.noise

    @property
    def count(self) -> int:
        """Rows that there are."""
        return len(self.rows.time)

    def moved(self, push: Array) -> Array:
        """Return how (n, k) pushes in each row move the marble in all rows, (n, k)."""
        found = np.zeros_like(push)
        for stretch in np.unique(self.rows.stretch):
            own = self.rows.stretch == stretch
            found[own] = _integrator(int(own.sum())) @ push[own]
        return found

    def freed(self, axis: int, changes: Array) -> Array:
        """Take from (n, k) changes of a coordinate what start states and the five parameters could do."""
        basis = self._fixed[axis]
        return np.asarray(changes - basis @ (basis.T @ changes))

    def explain(self, axis: int, changes: Array) -> None:
        """Count (n, k) changes of a coordinate among what else could move the marble."""
        self._fixed[axis] = np.linalg.qr(np.column_stack([self._fixed[axis], changes]))[0]

    def residual(self, axis: int) -> Array:
        """Return observed minus predicted for a coordinate, (n,) [board edges]."""
        return np.asarray(self._residual[:, axis])

    def sources(self, seed: int) -> list[Source]:
        """Compare the variables that the leftover may depend on, the likeliest first."""
        if self.count < 4 * SHORTEST:
            return []
        random = np.random.default_rng(seed)
        nulls = self._noise * random.standard_normal((self.count, NULLS))
        self._plain = [
            _restricted(
                self._noise**2 * np.eye(self.count),
                self._fixed[axis],
                np.column_stack([self.residual(axis), nulls]),
            )
            for axis in (0, 1)
        ]
        told = [(name, stage, *self._of(kernel, stage, nulls)) for name, stage, kernel in self._kernels()]
        highest = np.max([null for *_, null, _ in told], axis=0)
        best: dict[str, Source] = {}
        for name, stage, gain, _, push in told:
            p_value = float((1 + (highest >= gain).sum()) / (1 + NULLS))
            source = Source(name, stage, gain, p_value, push)
            if name not in best or gain > best[name].gain:
                best[name] = source
        return sorted(best.values(), key=lambda one: -one.gain)

    @property
    def turned(self) -> float:
        """Root mean square of the changes of the commands [rad]."""
        return max(float(np.sqrt((self.rows.turn**2).mean())), 1e-9)

    def size_of_jitter(self) -> tuple[float, float, float]:
        """Return the push that differing delays make, root mean square [board edges a row squared].

        And the ends of its 95 % interval, where the likelihood has fallen by what chi-squared allows.
        """
        moved = [
            self.moved(self.moved(np.diag(self.rows.arriving[:, 1 - axis] / self.turned**2)).T)
            for axis in (0, 1)
        ]

        def likelihood(push: float) -> float:
            gain = 0.0
            for axis in (0, 1):
                covariance = push**2 * moved[axis] + self._noise**2 * np.eye(self.count)
                gain += float(_restricted(covariance, self._fixed[axis], self.residual(axis)[:, None])[0])
            return gain

        coarse = np.logspace(-6.0, -1.0, 26)
        likeliest = coarse[np.argmax([likelihood(push) for push in coarse])]
        pushes = likeliest * np.logspace(-0.3, 0.3, 41)
        gains = np.array([likelihood(push) for push in pushes])
        inside = pushes[gains > gains.max() - 0.5 * _CHI_SQUARED]
        return float(pushes[gains.argmax()]), float(inside.min()), float(inside.max())

    def _kernels(self) -> list[tuple[str, str, Callable[[int], Array]]]:
        """Return variable, stage, and covariance (n, n) of unit size for each coordinate."""
        rows = self.rows
        speed = max(float(np.sqrt((rows.velocity**2).mean())), 1e-9)
        angle = max(float(np.sqrt((rows.knobs**2).mean())), 1e-9)
        turned = self.turned
        same = rows.run[:, None] == rows.run

        def alike(values: Array, length: float) -> Callable[[int], Array]:
            kernel = _squared_exponential(values, length)
            return lambda _: kernel

        found: list[tuple[str, str, Callable[[int], Array]]] = [
            *(("position", "force", alike(rows.place, length)) for length in (0.03, 0.07, 0.2)),
            *(("velocity", "force", alike(rows.velocity / speed, length)) for length in (0.5, 1.5)),
            *(("command", "command", alike(rows.knobs / angle, length)) for length in (0.5, 1.5)),
            ("command rate", "command", alike(rows.turn / turned, 0.7)),
            *(("time", "force", alike(rows.time[:, None], length)) for length in (4.0, 15.0, 60.0)),
        ]
        # Commands of x turn the board about x: they push along y.
        found.append((JITTER, "command", lambda axis: np.diag(rows.arriving[:, 1 - axis] / turned**2)))
        found.append(("each row anew", "force", lambda _: np.eye(self.count)))
        found.append(
            ("each run anew", "force", lambda _: _squared_exponential(rows.time[:, None], 5.0) * same)
        )
        found.append(("position", "camera", alike(rows.place, 0.2)))
        found.append(("command", "camera", alike(rows.knobs / angle, 1.0)))
        return found

    def _of(self, kernel: Callable[[int], Array], stage: str, nulls: Array) -> tuple[float, Array, float]:
        """Return gain over noise alone, the same of nulls, and the size of the push."""
        gains, of_nulls = np.zeros(len(_SIZES) + 1), np.zeros((len(_SIZES) + 1, nulls.shape[1]))
        units = []
        for axis in (0, 1):
            unit = kernel(axis)
            moved = unit if stage == "camera" else self.moved(self.moved(unit).T)
            scale = self._noise**2 / max(float(np.mean(np.diag(moved))), 1e-300)
            units.append(scale * float(np.mean(np.diag(unit))))
            data = np.column_stack([self.residual(axis), nulls])
            plain = self._plain[axis]
            for index, size in enumerate(_SIZES, start=1):
                covariance = size * scale * moved + self._noise**2 * np.eye(self.count)
                told = _restricted(covariance, self._fixed[axis], data) - plain
                gains[index] += told[0]
                of_nulls[index] += told[1:]
        best = int(gains.argmax())
        push = float(np.sqrt(np.mean(units) * _SIZES[best - 1])) if best else 0.0
        return float(gains[best]), of_nulls.max(axis=0), push


def _restricted(covariance: Array, fixed: Array, data: Array) -> Array:
    """Return the log restricted likelihood of (n, k) data, up to a constant, (k,)."""
    lower = cholesky(covariance, lower=True, check_finite=False, overwrite_a=True)
    both = solve_triangular(lower, np.column_stack([fixed, data]), lower=True, check_finite=False)
    of_fixed, of_data = both[:, : fixed.shape[1]], both[:, fixed.shape[1] :]
    basis, triangle = np.linalg.qr(of_fixed)
    left = of_data - basis @ (basis.T @ of_data)
    determinant = 2.0 * np.log(np.diag(lower)).sum() + 2.0 * np.log(np.abs(np.diag(triangle))).sum()
    return np.asarray(-0.5 * (determinant + (left**2).sum(axis=0)))


def _squared_exponential(values: Array, length: float) -> Array:
    squares = ((values[:, None, :] - values[None, :, :]) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * squares / length**2))


def _integrator(rows: int) -> Array:
    """Return how a push in row j moves the marble by row i, (rows, rows): half of it in the row itself."""
    late = np.arange(rows)[:, None] - np.arange(rows)
    return np.where(late > 0, late - 0.5, 0.0)


def _spread_out(count: int) -> NDArray[np.int64]:
    """Return indices in an order in which any first few are spread over all of them: the golden section's."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0, kind="stable")


def _stretches(case: Case, screen: Screen, *, weak: bool, late: float) -> tuple[Rows, Array, list[Array]]:
    """Return rows, residuals (n, 2), and for each coordinate a basis (n, f) of what else could move it."""
    board, radius = case.rig.board, case.rig.marble.radius_m
    reach = (np.array([board.edge_x_m, board.edge_y_m]) / 2.0 - radius) / board.edge_x_m
    pieces: list[_Piece] = []
    windows = screen.windows()
    for index in _spread_out(len(windows)):
        if sum(len(piece.place) for piece in pieces) >= MOST_ROWS:
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
        return Rows(empty, empty, empty, empty, empty, np.zeros(0), none, none), empty, []
    lengths = [len(piece.place) for piece in pieces]
    rows = Rows(
        place=np.concatenate([piece.place for piece in pieces]),
        velocity=np.concatenate([piece.velocity for piece in pieces]),
        knobs=np.concatenate([piece.knobs for piece in pieces]),
        turn=np.concatenate([piece.turn for piece in pieces]),
        arriving=np.concatenate([piece.arriving for piece in pieces]),
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
    turn: Array
    arriving: Array
    time: Array
    residual: Array
    fixed: Array

    def cut(self, first: int, stop: int) -> _Piece:
        own = slice(first, stop)
        return _Piece(
            self.run,
            self.place[own],
            self.velocity[own],
            self.knobs[own],
            self.turn[own],
            self.arriving[own],
            self.time[own],
            self.residual[own],
            self.fixed[:, own],
        )


def _predicted(window: Window, late: float) -> _Piece:
    """Return a window as the hypothesis predicts it: where that is near, the best view."""
    return _Piece(
        run=window.run,
        place=window.place,
        velocity=np.gradient(window.place, axis=0),
        knobs=window.knobs,
        turn=window.turn,
        arriving=_arriving(window, late),
        time=window.first + np.arange(len(window.place), dtype=np.float64),
        residual=window.residual,
        fixed=window.of_base,
    )


def _observed(window: Window, late: float, noise: float) -> _Piece:
    """Return a window as it was observed, whatever the base model makes of it.

    The motion itself is the residual: gears and rolling friction are among what else could move the marble.
    """
    seen = window.place + window.residual
    path, velocity = _smoothed(seen)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    friction = -velocity / np.maximum(speed, noise)
    integral = _integrator(len(seen))
    return _Piece(
        run=window.run,
        place=path,
        velocity=velocity,
        knobs=window.knobs,
        turn=window.turn,
        arriving=_arriving(window, late),
        time=window.first + np.arange(len(path), dtype=np.float64),
        residual=seen,
        # A turn about y pushes along x, a turn about x along y.
        fixed=np.array([integral @ window.knobs[:, ::-1], integral @ friction]),
    )


def _lateness(case: Case, fitted: Fitted) -> float:
    """Return how late the commands of a hypothesis arrive on average [rows]."""
    found = fitted.of_effects()
    seconds = sum(found.get(name, 0.0) for name in ("delay.delay_s", "latency.latency_s"))
    time_scale = case.time_scale or float(fitted.values[PARAMETERS.index("time_scale")])
    return seconds / (time_scale * SUBSTEP_S)


def _arriving(window: Window, late: float) -> Array:
    """Return the mean square of the changes of the commands that may arrive in each row, (n, 2)."""
    weights = np.exp(-0.5 * ((np.arange(EARLIER) - late) / _SPREAD) ** 2)
    return np.asarray(np.einsum("k,nka->na", weights / weights.sum(), window.turned**2))


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


def _longest(free: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the longest stretch of free rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    if not len(edges):
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    best = int(lengths.argmax())
    return int(edges[2 * best]), int(edges[2 * best + 1])


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
