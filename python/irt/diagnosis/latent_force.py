"""Latent force model of the residuals: find the variable that a missing push depends on.

Away from the rim the marble is a double integrator: a push in one row moves all later rows. The residuals of
a hypothesis are the response to an unknown push, projected onto the complement of start states and the five
parameters. The variable of the push is found by comparing Gaussian processes over each variable by restricted
likelihood (Rasmussen and Williams 2006, section 2.7 and chapter 5; latent force models: Alvarez et al. 2009).
Noisy positions are never differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from irt.diagnosis.dataset import Fitted
from irt.diagnosis.free_motion import LONGEST, SHORTEST, free_motion, integrator
from irt.diagnosis.windows import EARLIER

Array = NDArray[np.float64]
#: Arrays for x and y.
Pair = tuple[Array, Array]

#: Variances of the push to try, as ratios of the displacement's variance to that of the tracker.
_SIZES = np.array([0.3, 5.0, 80.0, 1300.0])
#: Row-to-row autocorrelations of the tracker's noise to try.
_CARRIED = (0.0, 0.3, 0.6)
#: Order of the differences that measure the tracker's noise (`irt.fitting.problem.tracker_noise`).
_ORDER = 4
#: Number of simulated nulls.
NULLS = 99
#: Most rows of a Gaussian process.
MOST_ROWS = 400
#: Time constants of the command history [rows]; steps before the last `EARLIER` rows are ignored.
_FORGOTTEN = (2.0, 4.0, 8.0)


@dataclass(frozen=True)
class Source:
    """A variable that the residuals may depend on.

    Attributes
    ----------
    variable : str
        "position", "velocity", "command", "command history", "time", or, for pushes that do not repeat, "each
        row anew" or "each run anew".
    stage : str
        "force", "command" or "camera".
    gain : float
        Log restricted likelihood relative to noise alone [nats].
    p_value : float
        Probability of such a gain or more under noise alone, over all variables tried.
    push : float
        RMS of the push [board edges per row squared], or of the picture's shift [board edges].
    """

    variable: str
    stage: str
    gain: float
    p_value: float
    push: float

    @property
    def repeats(self) -> bool:
        """Whether the push is the same if a run is repeated."""
        return "anew" not in self.variable


class LatentForce:
    """The residuals of a hypothesis in segments of free motion.

    Parameters
    ----------
    fitted : Fitted
        The hypothesis.
    """

    def __init__(self, fitted: Fitted) -> None:
        self.rows, self._residual, self._fixed = free_motion(fitted, LONGEST, weak=False, most=MOST_ROWS)
        self._noise = fitted.dataset.noise

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.rows.time)

    def moved(self, push: Array) -> Array:
        """Return the displacements in all rows, (n, k), by (n, k) pushes."""
        found = np.zeros_like(push)
        for stretch in np.unique(self.rows.stretch):
            own = self.rows.stretch == stretch
            found[own] = integrator(int(own.sum())) @ push[own]
        return found

    def residual(self, axis: int) -> Array:
        """Return observed minus predicted for a coordinate, (n,) [board edges]."""
        return np.asarray(self._residual[:, axis])

    def sources(self, seed: int, *, nulls: int = NULLS) -> list[Source]:
        """Compare the variables that the residuals may depend on; return them by likelihood.

        Each is combined with the autocorrelation of the tracker's noise that fits best: correlated noise
        drifts like a pushed marble, and its size is underestimated from differences.
        """
        if self.count < 4 * SHORTEST:
            return []
        random = np.random.default_rng(seed)
        drawn = self._noise * random.standard_normal((2, self.count, nulls))
        data = [np.column_stack([self.residual(axis), drawn[axis]]) for axis in (0, 1)]
        noises = [self._noise_covariance(share) for share in _CARRIED]
        plain = np.max([self._likelihood((noise, noise), data) for noise in noises], axis=0)
        results = [
            (name, stage, *self._of(kernels, stage, data, noises)) for name, stage, kernels in self._kernels()
        ]
        gains = [np.maximum(likelihood - plain, 0.0) for _, _, likelihood, _ in results]
        highest = np.max([gain[1:] for gain in gains], axis=0)
        best: dict[str, Source] = {}
        for (name, stage, _, push), gain in zip(results, gains, strict=True):
            p_value = float((1 + (highest >= gain[0]).sum()) / (1 + nulls))
            source = Source(name, stage, float(gain[0]), p_value, push if gain[0] > 0.0 else 0.0)
            if name not in best or source.gain > best[name].gain:
                best[name] = source
        return sorted(best.values(), key=lambda one: -one.gain)

    def _noise_covariance(self, share: float) -> Array:
        """Return the covariance (n, n) of a coordinate's noise with a row-to-row autocorrelation."""
        apart = np.abs(self.rows.time[:, None] - self.rows.time)
        same = self.rows.stretch[:, None] == self.rows.stretch
        return np.asarray(np.where(same, share**apart, 0.0) * (_noise_correction(share) * self._noise) ** 2)

    def _likelihood(self, covariances: Pair, data: Sequence[Array]) -> Array:
        """Return the log restricted likelihood (k,) of (n, k) data of both axes under these covariances."""
        x, y = covariances
        lower = cholesky(x, lower=True, check_finite=False)
        lowers = (lower, lower if y is x else cholesky(y, lower=True, check_finite=False))
        return np.asarray(sum(_restricted(*one) for one in zip(lowers, self._fixed, data, strict=True)))

    def _kernels(self) -> list[tuple[str, str, Pair]]:
        """Return variable, stage and unit covariances (n, n) of both coordinates."""
        rows = self.rows
        speed = max(float(np.sqrt((rows.velocity**2).mean())), 1e-9)
        angle = max(float(np.sqrt((rows.knobs**2).mean())), 1e-9)
        turn = rows.turned[:, 0]
        turned = max(float(np.sqrt((turn**2).mean())), 1e-9)
        same = rows.run[:, None] == rows.run
        alike = _squared_exponential
        found: list[tuple[str, str, Array]] = [
            *(("position", "force", alike(rows.place, length)) for length in (0.03, 0.07, 0.2)),
            *(("velocity", "force", alike(rows.velocity / speed, length)) for length in (0.5, 1.5)),
            *(("command", "command", alike(rows.knobs / angle, length)) for length in (0.5, 1.5)),
            ("command rate", "command", alike(turn / turned, 0.7)),
            *(("time", "force", alike(rows.time[:, None], length)) for length in (4.0, 15.0, 60.0)),
        ]
        found.append(("each row anew", "force", np.eye(self.count)))
        found.append(("each run anew", "force", alike(rows.time[:, None], 5.0) * same))
        found.append(("position", "camera", alike(rows.place, 0.2)))
        found.append(("command", "camera", alike(rows.knobs / angle, 1.0)))
        # A picture that turns or stretches with the tilt.
        both = np.concatenate([rows.knobs / angle, rows.place / 0.2], axis=1)
        found.append(("command", "camera", alike(both, 1.0)))
        alike_in_both = [(name, stage, (one, one)) for name, stage, one in found]
        return [
            *alike_in_both,
            *(("command history", "command", self._history_kernels(late)) for late in _FORGOTTEN),
        ]

    def _history_kernels(self, rows: float) -> Pair:
        """Return the covariances of pushes that depend on a command and on its history.

        The variables are a command filtered with a time constant of `rows`, and its distance from the
        command. They describe responses of joints, cords and motors to steps.
        """
        fading = np.exp(-(np.arange(EARLIER) + 0.5) / rows)
        left = np.einsum("nka,k->na", self.rows.turned, fading)
        scaled = [one / max(float(np.sqrt((one**2).mean())), 1e-9) for one in (self.rows.knobs - left, left)]
        # A turn about y pushes along x.
        x, y = (_squared_exponential(np.stack(scaled, axis=-1)[:, axis], 1.0) for axis in (1, 0))
        return x, y

    def _of(
        self, kernels: Pair, stage: str, data: Sequence[Array], noises: Sequence[Array]
    ) -> tuple[Array, float]:
        """Return the largest likelihoods (k,) of data (n, k) of both axes, and the push of the first column.

        The maximum is over sizes of the kernels and over covariances (n, n) of the noise.
        """
        x, y = kernels
        moved_x = self._position_covariance(x, stage)
        moved_y = moved_x if y is x else self._position_covariance(y, stage)
        scale = 2.0 * self._noise**2 / max(float(np.mean(np.diag(moved_x + moved_y))), 1e-300)
        tried = list(product(scale * _SIZES, noises))
        found = []
        for size, noise in tried:
            of_x = size * moved_x + noise
            of_y = of_x if moved_y is moved_x else size * moved_y + noise
            found.append(self._likelihood((of_x, of_y), data))
        likelihoods = np.array(found)
        size, _ = tried[int(likelihoods[:, 0].argmax())]
        return likelihoods.max(axis=0), float(np.sqrt(size * float(np.mean(np.diag(x)))))

    def _position_covariance(self, kernel: Array, stage: str) -> Array:
        """Return the covariance of positions under pushes, or picture shifts, of this covariance."""
        return kernel if stage == "camera" else self.moved(self.moved(kernel).T)


def _noise_correction(share: float) -> float:
    """Return the ratio of the true size of noise to its estimate from differences.

    The noise has autocorrelation `share` from row to row; the ratio is 1 for white noise.
    """
    signs = np.array([(-1.0) ** k * comb(_ORDER, k) for k in range(_ORDER + 1)])
    apart = np.abs(np.subtract.outer(np.arange(_ORDER + 1), np.arange(_ORDER + 1)))
    return float(np.linalg.norm(signs) / np.sqrt(signs @ share**apart @ signs))


def _restricted(lower: Array, fixed: Array, data: Array) -> Array:
    """Return the log restricted likelihood of (n, k) data, up to a constant, (k,).

    `lower` is the Cholesky factor (n, n) of their covariance.
    """
    both = solve_triangular(lower, np.column_stack([fixed, data]), lower=True, check_finite=False)
    of_fixed, of_data = both[:, : fixed.shape[1]], both[:, fixed.shape[1] :]
    basis, triangle = np.linalg.qr(of_fixed)
    left = of_data - basis @ (basis.T @ of_data)
    determinant = 2.0 * np.log(np.diag(lower)).sum() + 2.0 * np.log(np.abs(np.diag(triangle))).sum()
    return np.asarray(-0.5 * (determinant + (left**2).sum(axis=0)))


def _squared_exponential(values: Array, length: float) -> Array:
    squares = ((values[:, None, :] - values[None, :, :]) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * squares / length**2))
