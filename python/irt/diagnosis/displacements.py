"""Displacements by pushes in segments of free motion, weighted by the noise of a set of effects.

Away from the rim the marble is a double integrator. The covariance of its displacements is that of the
filter: noise of the tracker, and a random push that accumulates. Displacements are multiplied by the inverse
of its Cholesky factor (generalised least squares, Aitken 1936), so that the likelihood of a push is the sum
of squares that it explains, and a random push that is needed anyway is not mistaken for a law.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from irt.diagnosis.free_motion import Free, integrator
from irt.diagnosis.score import LASTING, LASTING_S, PULL, PULL_S, PUSH, SCALE_OF_NORMAL, WHITE

Array = NDArray[np.float64]

#: Degrees of freedom of the white noise, as in the filter.
FREEDOM = 4.0
#: Smallest part of a nuisance direction of unit length that counts beside start states.
_LEAST = 1e-6
#: Pushes that are displaced at once: their rows fit into a processor's cache.
_COLUMNS = 64
#: Iterations of the variances of the white noise.
ROUNDS = 4


class Displacements:
    """Residuals in free motion, and displacements by pushes, in standard deviations of the noise.

    Both are without the directions of start states and of the five parameters.

    Parameters
    ----------
    free : tuple
        The n rows, residuals (n, 2) and nuisance directions, by `free_motion`.
    noise : (14,) array
        Noise sizes of the filter.
    variances : (n, 2) array
        Variances of the white noise in each row [board edges^2].
    row_s, edge_m : float
        Duration of a row [s] and long edge of the board [m].
    """

    def __init__(self, free: Free, noise: Array, variances: Array, row_s: float, edge_m: float) -> None:
        rows_of_all, residuals, fixed = free
        lengths = np.unique(rows_of_all.stretch, return_counts=True)[1].tolist()
        parts = [slice(begin, end) for begin, end in itertools.pairwise([0, *itertools.accumulate(lengths)])]
        moved = row_s**2 / edge_m * integrator(max(lengths))
        covariance = _covariance(noise, moved, row_s)
        self._axes = []
        for axis in (0, 1):
            segments = []
            for rows, size in zip(parts, lengths, strict=True):
                own = covariance[:size, :size] + np.diag(variances[rows, axis])
                segments.append(_Segment(rows, own, moved[:size, :size]))
            self._axes.append(_Axis(segments, residuals[:, axis], fixed[axis]))

    @property
    def log_likelihood(self) -> float:
        """Log restricted likelihood of the residuals, up to a constant [nats]."""
        return -sum(one.log_determinant for one in self._axes) - 0.5 * self.total

    @property
    def total(self) -> float:
        """Sum of squared residuals, in variances."""
        return float(sum(one.data @ one.data for one in self._axes))

    def products(self, axis: int, parts: Sequence[Array]) -> Array:
        """Return the products of residuals and displacements by parts of pushes, (k, p) [(m/s^2)^-1].

        With the information on the strengths of the parts they are its normal equations.

        Parameters
        ----------
        axis : int
            The coordinate.
        parts : sequence of (n, k) arrays
            The p parts of k pushes [m/s^2].
        """
        return np.stack([self._axes[axis].pulled @ part for part in parts], axis=-1)

    def information(self, axis: int, parts: Sequence[Array]) -> Array:
        """Return the information on the strengths of parts of pushes, (k, p, p) [(m/s^2)^-2].

        It is zero for parts that the nuisance directions contain. A smaller random push makes it larger.

        Parameters
        ----------
        axis : int
            The coordinate.
        parts : sequence of (n, k) arrays
            The p parts of k pushes [m/s^2].
        """
        return self._axes[axis].information(parts)

    def explain(self, pushes: Array) -> None:
        """Remove (n, k, 2) pushes of any strength from the residuals."""
        for axis, one in enumerate(self._axes):
            one.explain(pushes[:, :, axis])

    def white(self) -> Array:
        """Return the most probable white noise in each row, (n, 2), over its variance [1/board edge]."""
        return np.column_stack([one.white() for one in self._axes])


def row_variances(free: Free, noise: Array, row_s: float, edge_m: float) -> Array:
    """Return the variances (n, 2) of the white noise in each row [board edges^2].

    The noise has Student's t distribution, as in the filter: rows far from a path that the random push
    allows are noisier than others (expectation-maximisation of Lange, Little and Taylor 1989).
    """
    scale = float(noise[WHITE])
    variances = np.full((len(free[0].time), 2), (scale / SCALE_OF_NORMAL) ** 2)
    for _ in range(ROUNDS):
        missed = variances * Displacements(free, noise, variances, row_s, edge_m).white()
        variances = (FREEDOM * scale**2 + missed**2) / (FREEDOM + 1.0)
    return variances


class _Axis:
    """A coordinate.

    Attributes
    ----------
    data : (n,) array
        Residuals without the nuisance directions, in standard deviations.
    pulled : (n,) array
        Their products with displacements by a push in each row [(m/s^2)^-1].
    log_determinant : float
        Half of the logarithm of the determinants of their covariance and of the information on the nuisance
        directions.
    """

    def __init__(self, segments: Sequence[_Segment], residuals: Array, fixed: Array) -> None:
        self._segments = segments
        basis, triangle = np.linalg.qr(self._each(_Segment.whitened, fixed))
        data = self._each(_Segment.whitened, residuals[:, None])
        data -= basis @ (basis.T @ data)
        # Start states are removed segment by segment, so that few directions remain for all rows.
        left, singular, _ = np.linalg.svd(self._each(_Segment.without_start, basis), full_matrices=False)
        self._fixed = left[:, singular > _LEAST]
        self._keep(data[:, 0])
        logs = [np.log(np.abs(np.diag(one))).sum() for one in (*(one.factor for one in segments), triangle)]
        self.log_determinant = float(np.sum(logs))

    def information(self, parts: Sequence[Array]) -> Array:
        """Return the information on the strengths of p parts of pushes, (n, k) each, as (k, p, p)."""
        count = parts[0].shape[1]
        found = np.empty((count, len(parts), len(parts)))
        for first in range(0, count, _COLUMNS):
            columns = slice(first, first + _COLUMNS)
            moved = [self._moved(part[:, columns]) for part in parts]
            inside = [self._fixed.T @ one for one in moved]
            for i, j in itertools.product(range(len(parts)), repeat=2):
                whole = np.einsum("nk,nk->k", moved[i], moved[j])
                outside = whole - np.einsum("nk,nk->k", inside[i], inside[j])
                # A difference this small is rounding.
                found[columns, i, j] = np.where((i == j) & (outside < _LEAST * whole), 0.0, outside)
        return found

    def explain(self, pushes: Array) -> None:
        """Add displacements by (n, k) pushes [m/s^2] to the nuisance directions."""
        changes = self._moved(pushes)
        changes -= self._fixed @ (self._fixed.T @ changes)
        # A gear whose knob never turns does nothing along its axis.
        seen = changes[:, np.linalg.norm(changes, axis=0) > 0.0]
        self._fixed = np.linalg.qr(np.column_stack([self._fixed, seen]))[0]
        self._keep(self.data - self._fixed @ (self._fixed.T @ self.data))

    def _keep(self, data: Array) -> None:
        self.data, self.pulled = data, self._each(_Segment.pulled, data)

    def _moved(self, pushes: Array) -> Array:
        """Return displacements by (n, k) pushes without the directions of start states, in deviations."""
        found = np.empty(pushes.shape)
        for one in self._segments:
            np.matmul(one.moved, pushes[one.rows], out=found[one.rows])
        return found

    def white(self) -> Array:
        """Return the most probable white noise in each row, (n,), over its variance [1/board edge]."""
        return self._each(_Segment.white, self.data)

    def _each(self, of: Callable[[_Segment, Array], Array], changes: Array) -> Array:
        """Return a function of the rows (n, ...) of each segment."""
        found = np.empty_like(changes)
        for one in self._segments:
            found[one.rows] = of(one, changes[one.rows])
        return found


class _Segment:
    """A segment of m rows.

    Parameters
    ----------
    rows : slice
        Its rows.
    covariance : (m, m) array
        Covariance of a coordinate [board edges^2].
    moved : (m, m) array
        Displacements by pushes in m/s^2 [board edges].

    Attributes
    ----------
    factor : (m, m) array
        Cholesky factor of the covariance.
    moved : (m, m) array
        Displacements by pushes in m/s^2 without the directions of start states, in standard deviations.
    """

    def __init__(self, rows: slice, covariance: Array, moved: Array) -> None:
        self.rows, self.factor = rows, cholesky(covariance, lower=True, check_finite=False)
        time = np.linspace(-1.0, 1.0, len(covariance))
        self._start = np.linalg.qr(self.whitened(np.column_stack([np.ones_like(time), time])))[0]
        self.moved = self.without_start(self.whitened(moved))

    def whitened(self, changes: Array) -> Array:
        """Return changes (m, k) [board edges] in standard deviations."""
        return np.asarray(solve_triangular(self.factor, changes, lower=True, check_finite=False))

    def pulled(self, changes: Array) -> Array:
        """Return the products of changes (m,) in standard deviations with displacements by each push."""
        return np.asarray(changes @ self.moved)

    def white(self, changes: Array) -> Array:
        """Return the white noise in changes (m,) in standard deviations, over its variance [1/board edge]."""
        return np.asarray(solve_triangular(self.factor, changes, lower=True, trans="T"))

    def without_start(self, changes: Array) -> Array:
        """Return changes (m, k) in standard deviations without the directions of start states."""
        return np.asarray(changes - self._start @ (self._start.T @ changes))


def _covariance(noise: Array, moved: Array, row_s: float) -> Array:
    """Return the covariance (m, m) of displacements without the white noise [board edges^2].

    Parameters
    ----------
    noise : (14,) array
        Noise sizes of the filter.
    moved : (m, m) array
        Displacements by pushes in m/s^2 [board edges].
    row_s : float
        Duration of a row [s].
    """
    rows = len(moved)
    apart = row_s * np.abs(np.subtract.outer(np.arange(rows), np.arange(rows)))
    lasting = (noise[LASTING] / SCALE_OF_NORMAL) ** 2 * np.exp(-apart / noise[LASTING_S])
    pushes = noise[PUSH] / row_s * np.eye(rows) + noise[PULL] ** 2 * np.exp(-apart / noise[PULL_S])
    return np.asarray(lasting + moved @ pushes @ moved.T)
