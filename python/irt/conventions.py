"""Identify which input moves which output, with which sign and gain, from recordings.

Three responses are fitted by robust regression: commands to marble, tilt to marble, commands to tilt. The
response of a marble is its acceleration. Second differences of noisy positions are dominated by noise, so the
equation of motion is used in weak form: both sides are averaged with a smooth window (a test function), and
the second differences are moved to the window (summation by parts; Messenger and Bortz, "Weak SINDy", 2021).
Each output has its own delay, found by a scan.

All functions take arrays, so they also work on incomplete recordings and other formats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import deviation

Array = NDArray[np.float64]

#: Half-widths of the test functions [rows]. Short ones keep fast commands, long ones suppress noise.
HALF_WIDTHS = (3, 6, 12, 24)
#: Longest gap of outputs that is interpolated linearly [rows].
_BRIDGED = 2
#: Huber's threshold in robust standard deviations, for 95 % efficiency.
_HUBER = 1.345
#: Rounds of reweighted least squares, after which weights hardly change.
_ROUNDS = 3
#: Approximate number of regression rows of an output; more rows hardly improve the result.
_MOST_ROWS = 1500
#: Length of a block in window widths, at which residuals of different blocks are nearly independent.
_BLOCK_WIDTHS = 2
#: Number of fitted coefficients per output: two gains and three further columns.
FITTED = 5
#: Fewest blocks for a standard error.
LEAST_BLOCKS = 6


@dataclass(frozen=True)
class Convention:
    """One of the eight ways to name and orient two axes.

    Attributes
    ----------
    swapped : bool
        Whether output x follows input x rather than input y.
    signs : (int, int)
        Whether outputs x and y have the declared sign (1) or the opposite one (-1), after the swap.
    """

    swapped: bool
    signs: tuple[int, int]

    @property
    def is_declared(self) -> bool:
        """Whether it is the convention of the project's formats."""
        return not self.swapped and self.signs == (1, 1)


#: The declared one comes first.
CONVENTIONS = tuple(Convention(swapped, (x, y)) for swapped, x, y in product((False, True), (1, -1), (1, -1)))


@dataclass(frozen=True, eq=False)
class Signals:
    """The signals of a run at equal time steps.

    Attributes
    ----------
    inputs : (n, 2) array
        Commands or tilt about x and y; NaN where unknown.
    outputs : (n, 2) array
        Marble along x and y, or tilt about x and y; NaN where unknown.
    used : (n, 2) bool array or None
        Whether outputs respond to the inputs only: False at a wall.
    """

    inputs: Array
    outputs: Array
    used: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class Response:
    """The response of two outputs to two inputs.

    Rows are outputs x and y, columns inputs x and y. Gains are outputs (for accelerations: outputs per step
    squared) per unit of the input.

    Attributes
    ----------
    gain, error : (2, 2) arrays
        Gains, and their standard errors by blocks of rows; NaN where unknown.
    delay : (2,) array
        Delay of each output [steps].
    explained : (2,) array
        Share of the variance of each output explained by both inputs, 0 to 1.
    shares : (8,) array
        Share of the variance of both outputs explained by each of `CONVENTIONS`.
    z : (8,) array
        Vuong's z statistic over blocks of each of `CONVENTIONS` against the declared one; positive if it
        predicts better.
    blocks : int
        Number of nearly independent blocks of data.
    """

    gain: Array
    error: Array
    delay: Array
    explained: Array
    shares: Array
    z: Array
    blocks: int

    @cached_property
    def best(self) -> Convention:
        """The convention that explains most."""
        return CONVENTIONS[int(np.argmax(self.shares))]

    def contradicts(self, *, z: float, share: float) -> bool:
        """Whether another convention is significantly better than the declared one.

        Parameters
        ----------
        z : float
            Smallest z statistic.
        share : float
            Smallest increase of the explained share of the variance.
        """
        best = int(np.argmax(self.shares))
        return bool(
            best > 0
            and self.blocks >= LEAST_BLOCKS
            and self.z[best] >= z
            and self.shares[best] - self.shares[0] >= share
        )


def resampled(times: Array | None, *signals: Array | None, held: Sequence[bool]) -> tuple[Array, ...]:
    """Resample signals at equal steps, the median step of the stamps.

    Parameters
    ----------
    times : (n,) array or None
        Increasing stamps; None if the steps are equal already.
    *signals : (n, 2) arrays
        Signals, NaN where unknown.
    held : sequence of bool
        Whether each signal is held until the next row (a command), or is interpolated.

    Returns
    -------
    tuple of (m, 2) arrays
        Resampled signals, NaN next to unknown rows.
    """
    whole = [signal for signal in signals if signal is not None]
    if times is None or len(times) < 3:
        return tuple(whole)
    step = float(np.median(np.diff(times)))
    grid = times[0] + step * np.arange(int((times[-1] - times[0]) / step + 1e-6) + 1)
    found = []
    for signal, keeps in zip(whole, held, strict=True):
        if keeps:
            # Stamps jitter about the grid: a command issued slightly late belongs to this row.
            rows = np.clip(np.searchsorted(times, grid + 0.25 * step, side="right") - 1, 0, len(times) - 1)
            found.append(signal[rows])
        else:
            found.append(np.stack([np.interp(grid, times, signal[:, axis]) for axis in (0, 1)], axis=1))
    return tuple(found)


def fit_acceleration(
    runs: Sequence[Signals], delays: Sequence[float] | Array, *, inputs: Literal["held", "sampled"] = "held"
) -> Response | None:
    """Fit accelerations of the outputs to the inputs; declared: x by +input y, y by -input x.

    A constant push, Coulomb friction and viscous friction are fitted along with the gains.

    Parameters
    ----------
    runs : sequence of Signals
        Runs with a common time step.
    delays : sequence of float
        Delays to try [steps]; negative ones let the output lead.
    inputs : {"held", "sampled"}
        Whether an input is held until the next row, or is a sample of a smooth signal.

    Returns
    -------
    Response or None
        None if no window of any width is free of gaps and walls.
    """
    found = [_of_width(runs, delays, half, inputs == "held") for half in HALF_WIDTHS]
    possible = [one for one in found if one is not None]
    if not possible:
        return None
    # Results of widths with few blocks are unreliable.
    enough = [one for one in possible if one.blocks >= LEAST_BLOCKS] or possible
    return max(enough, key=_adjusted)


def fit_level(runs: Sequence[Signals], delays: Sequence[float] | Array) -> Response | None:
    """Fit the outputs themselves to the inputs, with a zero for each run; declared: x by +input x.

    Parameters and result as in `fit_acceleration`; inputs are held.
    """
    designs = []
    for axis in (0, 1):
        rows = []
        for number, run in enumerate(runs):
            zero = np.zeros((len(run.outputs), len(runs)))
            zero[:, number] = 1.0
            rows.append(_Rows(run.inputs, run.outputs[:, axis], zero, number))
        # A tilt follows within about a second: blocks of that length are nearly independent.
        designs.append(_Design.of(rows, delays, block=8 * max(HALF_WIDTHS[:2])))
    return _response(designs, natural=((0, 1), (1, 1)))


def _adjusted(found: Response) -> float:
    """Return the explained share, adjusted for the number of fitted coefficients."""
    spare = max(found.blocks - FITTED, 1)
    return 1.0 - (1.0 - float(np.mean(found.explained))) * found.blocks / spare


@dataclass(frozen=True, eq=False)
class _Rows:
    """Regression rows of a run and an output: inputs without delay, target, further columns."""

    inputs: Array
    target: Array
    further: Array
    run: int


def _of_width(
    runs: Sequence[Signals], delays: Sequence[float] | Array, half: int, held: bool
) -> Response | None:
    window = _window(half)
    designs = []
    for axis in (0, 1):
        rows = [_weak(run, axis, window, number, held) for number, run in enumerate(runs)]
        kept = [one for one in rows if one is not None]
        if not kept:
            return None
        designs.append(
            _Design.of(kept, delays, block=_BLOCK_WIDTHS * (2 * half + 1), stride=max(1, half // 3))
        )
    return _response(designs, natural=((1, 1), (0, -1)))


def _window(half: int) -> Array:
    """Return a smooth bump over 2 half + 1 rows whose weights add up to 1."""
    place = np.arange(-half, half + 1) / (half + 1.0)
    bump = (1.0 - place**2) ** 3
    return np.asarray(bump / bump.sum())


def _weak(run: Signals, axis: int, window: Array, number: int, held: bool) -> _Rows | None:
    """Return averaged second differences and their regressors; NaN near a gap or a wall."""
    marble = np.stack([_bridged(run.outputs[:, one]) for one in (0, 1)], axis=1)
    if len(marble) < len(window) + 2:
        return None
    if run.used is not None:
        marble[~run.used[:, axis], axis] = np.nan
    target = np.full(len(marble), np.nan)
    target[1:-1] = marble[2:, axis] - 2.0 * marble[1:-1, axis] + marble[:-2, axis]
    inputs = run.inputs.copy()
    if held:
        # A held push moves the second difference of its own row and of the next by one half each.
        inputs[1:] = 0.5 * (run.inputs[1:] + run.inputs[:-1])
    velocity = np.full(marble.shape, np.nan)
    smooth = np.stack([_averaged(marble[:, one], window) for one in (0, 1)], axis=1)
    velocity[1:-1] = 0.5 * (smooth[2:] - smooth[:-2])
    speed = np.linalg.norm(np.nan_to_num(velocity), axis=1)
    direction = np.divide(velocity[:, axis], speed, out=np.zeros(len(speed)), where=speed > 0.0)
    further = np.stack([np.ones(len(speed)), velocity[:, axis], direction], axis=1)
    return _Rows(
        np.stack([_averaged(inputs[:, one], window) for one in (0, 1)], axis=1),
        _averaged(target, window),
        further,
        number,
    )


def _averaged(values: Array, window: Array) -> Array:
    """Return the weighted average around each row; NaN if the window does not fit or contains a NaN."""
    found = np.full(len(values), np.nan)
    half = len(window) // 2
    if len(values) >= len(window):
        found[half : len(values) - half] = np.convolve(values, window, "valid")
    return found


def _bridged(values: Array) -> Array:
    """Return values with short gaps interpolated linearly."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) in (0, len(values)):
        return values.copy()
    rows = np.arange(len(values))
    filled = np.interp(rows, known, values[known], left=np.nan, right=np.nan)
    before = known[np.clip(np.searchsorted(known, rows, side="right") - 1, 0, len(known) - 1)]
    after = known[np.clip(np.searchsorted(known, rows), 0, len(known) - 1)]
    return np.asarray(np.where(after - before <= _BRIDGED + 1, filled, np.nan))


@dataclass(frozen=True, eq=False)
class _Design:
    """The regression of one output at every delay, with robust weights.

    Attributes
    ----------
    delays : (d,) array
        Delays [steps].
    block : (m,) int array
        Index of the block of each row.
    fit : _Projected
        The fit of both inputs together.
    """

    delays: Array
    block: NDArray[np.int64]
    fit: _Projected

    @classmethod
    def of(
        cls, rows: Sequence[_Rows], delays: Sequence[float] | Array, *, block: int, stride: int = 1
    ) -> _Design | None:
        """Return the regression of every `stride`-th row; None if too few are known."""
        stride = max(stride, sum(len(one.target) for one in rows) // _MOST_ROWS)
        inputs, target, further, blocks = [], [], [], []
        for one in rows:
            taken = np.arange(0, len(one.target), stride)
            inputs.append(_delayed(one.inputs, taken, np.asarray(delays, dtype=float)))
            target.append(one.target[taken])
            further.append(one.further[taken])
            # Runs have fewer than a million rows.
            blocks.append(1_000_000 * one.run + taken // block)
        u, y = np.concatenate(inputs, axis=1), np.concatenate(target)
        z, b = np.concatenate(further), np.concatenate(blocks)
        known = np.isfinite(u).all(axis=(0, 2)) & np.isfinite(y) & np.isfinite(z).all(axis=1)
        u, y, z, b = u[:, known], y[known], z[known], b[known]
        if len(y) < 2 * (2 + z.shape[1]) or not np.ptp(y) > 0.0:
            return None
        found = _projected(u, y, z, np.ones(len(y)))
        for _ in range(_ROUNDS):
            scale = deviation(found.left)
            if scale == 0.0:
                break
            # The residuals of weighted rows are weighted, so the weights are divided out.
            left = found.left / np.sqrt(found.weights)
            found = _projected(u, y, z, 1.0 / np.maximum(1.0, np.abs(left) / (_HUBER * scale)))
        return cls(np.asarray(delays, dtype=float), np.unique(b, return_inverse=True)[1], found)

    @property
    def blocks(self) -> int:
        return int(self.block.max()) + 1

    def single(self, column: int, sign: int) -> Array:
        """Return the residuals (m,) with one input, at its best delay and with a gain of the given sign."""
        one = self.fit.inputs[:, :, column]
        length = (one**2).sum(axis=1)
        gain = np.divide(one @ self.fit.target, length, out=np.zeros(len(length)), where=length > 0.0)
        gain = np.maximum(gain * sign, 0.0) * sign
        best = int(np.argmax(gain**2 * length))
        return np.asarray(self.fit.target - gain[best] * one[best])

    def both(self) -> tuple[Array, Array, float, float]:
        """Return gains and errors (2,), the delay and the explained share of both inputs together."""
        u = self.fit.inputs[self.fit.best]
        scores = np.zeros((self.blocks, 2))
        np.add.at(scores, self.block, u * self.fit.left[:, None])
        bread = np.linalg.pinv(u.T @ u)
        few = self.blocks / max(self.blocks - 2, 1)
        error = np.sqrt(np.maximum(few * np.diag(bread @ (scores.T @ scores) @ bread), 0.0))
        moves = np.linalg.norm(u, axis=0) > 0.0
        share = 1.0 - float(self.fit.left @ self.fit.left) / float(self.fit.target @ self.fit.target)
        return (
            np.where(moves, self.fit.gain, np.nan),
            np.where(moves, error, np.nan),
            float(self.delays[self.fit.best]),
            share,
        )

    def by_block(self, left: Array) -> Array:
        """Return the sum of squares of each block relative to that of the target, (blocks,)."""
        sums = np.bincount(self.block, weights=left**2, minlength=self.blocks)
        return np.asarray(sums / float(self.fit.target @ self.fit.target))


@dataclass(frozen=True, eq=False)
class _Projected:
    """A fit of inputs to a target, with the further columns projected out of both.

    Attributes
    ----------
    inputs, target, weights : (d, m, 2), (m,) and (m,) arrays
        Inputs at every delay and target, times the square roots of the weights.
    best : int
        Index of the delay at which both inputs together explain most.
    gain, left : (2,) and (m,) arrays
        Gains of both inputs at that delay, and the residuals.
    """

    inputs: Array
    target: Array
    weights: Array
    best: int
    gain: Array
    left: Array


def _projected(u: Array, y: Array, z: Array, weights: Array) -> _Projected:
    """Return the regression with the further columns z projected out, at the best delay of both inputs."""
    root = np.sqrt(weights)
    left_vectors, lengths, _ = np.linalg.svd(root[:, None] * z, full_matrices=False)
    basis = left_vectors[:, lengths > 1e-9 * max(float(lengths.max(initial=0.0)), 1e-300)]
    inputs = u * root[:, None]
    whole = np.linalg.norm(inputs, axis=1)
    inputs = inputs - basis @ (basis.T @ inputs)
    # An axis that never moves is explained completely by the further columns.
    moves = np.linalg.norm(inputs, axis=1) > 1e-6 * whole
    inputs = np.where(moves[:, None, :], inputs, 0.0)
    target = root * y
    target = target - basis @ (basis.T @ target)
    products = inputs.swapaxes(1, 2) @ inputs
    along = inputs.swapaxes(1, 2) @ target
    gains = np.einsum("dij,dj->di", np.linalg.pinv(products, rcond=1e-9, hermitian=True), along)
    best = int(np.argmax(np.einsum("di,di->d", gains, along)))
    left = np.asarray(target - inputs[best] @ gains[best])
    return _Projected(inputs, target, weights, best, np.asarray(gains[best]), left)


def _delayed(values: Array, wanted: NDArray[np.int64], delays: Array) -> Array:
    """Return rows of (n, 2) values at each delay [steps], (d, m, 2), interpolated linearly; NaN outside."""
    rows = wanted - delays[:, None]
    low = np.floor(rows).astype(int)
    part = (rows - low)[:, :, None]
    last = len(values) - 1
    found = values[np.clip(low, 0, last)]
    if part.any():
        between = (1.0 - part) * found + part * values[np.clip(low + 1, 0, last)]
        # A row that is met counts alone: the next one may be unknown.
        found = np.where(part > 0.0, between, found)
    return np.where(((low < 0) | (rows > last))[:, :, None], np.nan, found)


def _response(
    designs: Sequence[_Design | None], natural: tuple[tuple[int, int], tuple[int, int]]
) -> Response | None:
    """Return the response of both outputs; `natural` gives the declared input and sign of each."""
    known = [one for one in designs if one is not None]
    if not known:
        return None
    gain, error = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    delay, explained = np.full(2, np.nan), np.zeros(2)
    for axis, design in enumerate(designs):
        if design is not None:
            gain[axis], error[axis], delay[axis], explained[axis] = design.both()
    squares = []
    for one in CONVENTIONS:
        of_axes = []
        for axis, design in enumerate(designs):
            if design is not None:
                column, sign = natural[axis]
                left = design.single(1 - column if one.swapped else column, sign * one.signs[axis])
                of_axes.append(design.by_block(left))
        squares.append(of_axes)
    shares = np.array([1.0 - np.mean([blocks.sum() for blocks in one]) for one in squares])
    return Response(
        gain=gain,
        error=error,
        delay=delay,
        explained=explained,
        shares=shares,
        z=np.array([_vuong(squares[0], one) for one in squares]),
        blocks=min(one.blocks for one in known),
    )


def _vuong(declared: Sequence[Array], other: Sequence[Array]) -> float:
    """Return Vuong's z statistic of `other` against `declared`, from squares by block of both outputs."""
    total, variance = 0.0, 0.0
    for first, second in zip(declared, other, strict=True):
        gained = first - second
        total += float(gained.sum())
        variance += len(gained) * float(gained.var(ddof=1)) if len(gained) > 1 else 0.0
    return total / np.sqrt(variance) if variance > 0.0 else 0.0
