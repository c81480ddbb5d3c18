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
from irt.diagnose.stretches import LONGEST, SHORTEST, integrator, stretches

Array = NDArray[np.float64]

#: Variances of the push tried, by the displacement that they make over that of the tracker's noise.
_SIZES = np.array([0.3, 5.0, 80.0, 1300.0])
#: The 95 % point of a chi-squared variable of one degree of freedom.
_CHI_SQUARED = 3.84
#: Simulated nulls.
NULLS = 99
#: Rows that a Gaussian process is asked about, at most.
MOST_ROWS = 400
#: Name of delays that differ from command to command.
JITTER = "jitter"


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

    @property
    def repeats(self) -> bool:
        """Whether the same run brings the same push again."""
        return self.variable != JITTER and "anew" not in self.variable


class Leftover:
    """What a hypothesis leaves over, in stretches away from the rim.

    Parameters
    ----------
    case : Case
        The recordings.
    fitted : Fitted
        The hypothesis.
    weak : bool
        Whether to take the motion as it was observed, and gears and friction for unknown, however far off the
        predictions are: right for the base model alone. Else what the predictions miss is looked at.
    longest : int
        Rows of a stretch, at most: long ones show small pushes, if the predictions do not go astray.
    most : int
        Rows in all, at most: whole stretches, spread over the recordings.
    """

    def __init__(
        self,
        case: Case,
        fitted: Fitted,
        *,
        weak: bool = False,
        longest: int = LONGEST,
        most: int = MOST_ROWS,
    ) -> None:
        self.rows, self._residual, self._fixed = stretches(case, fitted, longest, weak=weak, most=most)
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
            found[own] = integrator(int(own.sum())) @ push[own]
        return found

    def freed(self, axis: int, changes: Array) -> Array:
        """Take from (n, k) changes of a coordinate what start states and the five parameters could do."""
        basis = self._fixed[axis]
        return np.asarray(changes - basis @ (basis.T @ changes))

    def freedom(self, axis: int) -> int:
        """Return how many rows are left of a coordinate once it is freed."""
        return self.count - int(self._fixed[axis].shape[1])

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
        plain = [
            _restricted(
                self._noise**2 * np.eye(self.count),
                self._fixed[axis],
                np.column_stack([self.residual(axis), nulls]),
            )
            for axis in (0, 1)
        ]
        told = [
            (name, stage, *self._of(kernel, stage, nulls, plain)) for name, stage, kernel in self._kernels()
        ]
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
        # A picture that turns or stretches with the tilt.
        both = np.concatenate([rows.knobs / angle, rows.place / 0.2], axis=1)
        found.append(("command", "camera", alike(both, 1.0)))
        return found

    def _of(
        self, kernel: Callable[[int], Array], stage: str, nulls: Array, plain: list[Array]
    ) -> tuple[float, Array, float]:
        """Return gain over noise alone, the same of nulls, and the size of the push.

        Of noise alone `plain` is the likelihood, for each axis.
        """
        gains, of_nulls = np.zeros(len(_SIZES) + 1), np.zeros((len(_SIZES) + 1, nulls.shape[1]))
        units = []
        for axis in (0, 1):
            unit = kernel(axis)
            moved = unit if stage == "camera" else self.moved(self.moved(unit).T)
            scale = self._noise**2 / max(float(np.mean(np.diag(moved))), 1e-300)
            units.append(scale * float(np.mean(np.diag(unit))))
            data = np.column_stack([self.residual(axis), nulls])
            for index, size in enumerate(_SIZES, start=1):
                covariance = size * scale * moved + self._noise**2 * np.eye(self.count)
                told = _restricted(covariance, self._fixed[axis], data) - plain[axis]
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
