"""Expected information of a run: between hypotheses, and about their parameters.

A difference between two predictions counts only if neither the tracker's noise nor a refit explains it. To
first order around hypotheses with posterior covariances C, and with the Jacobians J of a new run, that is

    d' (S + J_a C_a J_a' + J_b C_b J_b')^-1 d,

where d is the difference, and S the variance of the tracker and of nonlinear deviations. S is large where a
run becomes chaotic, so such rows contribute nothing. The residuals of d after the best change of all
parameters and of the start are scored by Student's t, the likelihood of the fits, so that few rows with large
differences do not dominate.

The value of a run is the mutual information between its outcome and the true hypothesis. With D_ij the
evidence [nats] between two hypotheses and w their probabilities, its lower bound by Chernoff distances is

    -sum_i w_i log sum_j w_j exp(-a^2 D_ij / 4)

(Kolchinsky and Tracey, "Estimating mixture entropy with pairwise distances", Entropy 19, 2017). It lies
between 0 and the entropy of w, so separating a pair further adds nothing once it is separated. D_ij itself is
uncertain by about its own size: a is standard normal, and the mean of the exponential is (1 + D_ij / 2)^-1/2.
With a = 1, a run that barely suffices would be worth as much as one with ample evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.engine import SUBSTEP_S
from irt.fitting.robust import student_t
from irt.suggestion.excitations import Excitation
from irt.suggestion.hypothesis import Expected, Hypothesis

Array = NDArray[np.float64]

#: Weight of a nat about parameters relative to a nat about the true hypothesis.
_SHARPEN = 0.02
#: Smallest change by a step along an unidentified direction that counts, relative to the tracker's noise.
_FAINT = 0.5
#: Most rollouts that are simulated together, limited by memory.
_TOGETHER = 20_000


@dataclass(frozen=True, eq=False)
class Worth:
    """Expected information of e runs about m hypotheses and their p pairs.

    Attributes
    ----------
    distance : (e, p) array
        RMS difference of two predictions after refits, relative to the expected noise.
    nats : (e, p) array
        Expected evidence between the two hypotheses of a pair [nats].
    gain : (e, m) array
        Information gain on the parameters of each hypothesis [nats].
    remaining : (e, n) array
        Ratio of the standard deviation of each parameter of the first hypothesis after the run to that
        before.
    at_wall : (e,) array
        Share of rows with the marble at a wall.
    walls_matter : bool
        Whether a hypothesis contains an effect of walls.
    """

    distance: Array
    nats: Array
    gain: Array
    remaining: Array
    at_wall: Array
    walls_matter: bool

    def information(self, probabilities: Array, alike: NDArray[np.bool_]) -> Array:
        """Return the mutual information between each run and the true hypothesis [nats], (e,).

        Parameters
        ----------
        probabilities : (m,) array
            Probabilities of the hypotheses.
        alike : (p,) bool array
            Whether a pair makes the same predictions in all runs.
        """
        count = len(probabilities)
        overlap = np.ones((len(self.gain), count, count))
        for index, (a, b) in enumerate(combinations(range(count), 2)):
            shared = 1.0 if alike[index] else (1.0 + 0.5 * self.nats[:, index]) ** -0.5
            overlap[:, a, b] = overlap[:, b, a] = shared
        return np.asarray(-np.log(overlap @ probabilities) @ probabilities)

    def score(self, probabilities: Array, alike: NDArray[np.bool_]) -> Array:
        """Return the score of each run, (e,); arguments as in `information`."""
        worth = self.information(probabilities, alike) + _SHARPEN * self.gain @ probabilities
        return np.asarray(worth if self.walls_matter else worth * (1.0 - self.at_wall))


@dataclass(frozen=True, eq=False)
class Criterion:
    """Evaluates the expected information of runs.

    Attributes
    ----------
    hypotheses : tuple of Hypothesis
        The hypotheses; parameters of the first are reported.
    probabilities : (m,) array
        Probabilities of the m hypotheses, with sum 1.
    noise : float
        The tracker's standard deviation [board edges].
    time_scale : float or None
        The ``time_scale`` given by stamps.
    threads : int or None
        Threads of the engine.
    """

    hypotheses: tuple[Hypothesis, ...]
    probabilities: Array
    noise: float
    time_scale: float | None
    threads: int | None

    @property
    def step_s(self) -> float | None:
        """Duration of a row [s]; None without stamps."""
        return None if self.time_scale is None else self.time_scale * SUBSTEP_S

    def stamps(self, rows: int) -> Array | None:
        """Return the time of each row (n,) [s]; None without stamps."""
        if self.step_s is None:
            return None
        # To the microsecond, as `irt drive` writes them: a file for people has no rounding errors.
        return (np.arange(rows, dtype=np.float64) * self.step_s).round(6)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Index pairs of hypotheses."""
        return list(combinations(range(len(self.hypotheses)), 2))

    def worth(self, runs: Sequence[Excitation]) -> Worth:
        """Return the expected information of runs of equal length."""
        widest = max(2 * len(one.deviations) + 7 for one in self.hypotheses)
        at_once = max(1, _TOGETHER // widest)
        parts = [self._worth(runs[first : first + at_once]) for first in range(0, len(runs), at_once)]
        fields = ("distance", "nats", "gain", "remaining", "at_wall")
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in fields}
        return Worth(**joined, walls_matter=parts[0].walls_matter)

    def _worth(self, runs: Sequence[Excitation]) -> Worth:
        expected = [one.expected(runs, self.step_s, threads=self.threads) for one in self.hypotheses]
        compared = [self._compared(expected[a], expected[b]) for a, b in self.pairs]
        distance, nats = (np.array([one[i] for one in compared]).reshape(-1, len(runs)).T for i in range(2))
        learnt = [
            self._learnt(hypothesis, one) for hypothesis, one in zip(self.hypotheses, expected, strict=True)
        ]
        return Worth(
            distance=distance,
            nats=nats,
            gain=np.stack([gain for gain, _ in learnt], axis=1),
            remaining=learnt[0][1],
            at_wall=np.mean([one.at_wall for one in expected], axis=0),
            walls_matter=any(effect(name).of_rims for one in self.hypotheses for name in one.effects),
        )

    def _compared(self, one: Expected, other: Expected) -> tuple[Array, Array]:
        """Return distance and evidence [nats] between two hypotheses for each run, (e,) each."""
        difference = one.paths - other.paths
        scale = np.sqrt(self.noise**2 + one.variance + other.variance)
        slopes = np.concatenate([one.slopes, other.slopes], axis=1) / scale[:, None]
        whitened = difference / scale
        normal = np.eye(slopes.shape[1]) + slopes @ slopes.swapaxes(1, 2)
        moves = np.asarray(np.linalg.solve(normal, slopes @ whitened[:, :, None]), dtype=np.float64)
        left: Array = whitened - (moves.swapaxes(1, 2) @ slopes)[:, 0]
        nats = student_t(left).sum(axis=1) + student_t(moves[:, :, 0]).sum(axis=1)
        return np.asarray(np.sqrt((left**2).mean(axis=1))), nats

    def _learnt(self, hypothesis: Hypothesis, one: Expected) -> tuple[Array, Array]:
        """Return the information gain [nats] (e,), and the remaining share of each deviation (e, n)."""
        count = len(hypothesis.deviations)
        slopes = one.slopes.copy()
        # Steps along unidentified directions are scaled up, and with them the time discretisation of impacts,
        # which the search would otherwise exploit.
        repeated = np.where(hypothesis.steps < 1.0, 1.0 / hypothesis.steps, 0.0)
        faint = _FAINT * self.noise * repeated[:, None]
        known = slopes[:, :count]
        slopes[:, :count] = np.sign(known) * np.maximum(np.abs(known) - faint, 0.0)
        slopes /= np.sqrt(self.noise**2 + one.variance)[:, None]
        covariance = np.linalg.inv(np.eye(slopes.shape[1]) + slopes @ slopes.swapaxes(1, 2))
        # The start position is a nuisance parameter: its block is dropped after the inversion.
        covariance = covariance[:, :count, :count]
        gain = -0.5 * np.linalg.slogdet(covariance)[1]
        moves = hypothesis.deviations
        after = np.einsum("fn,efg,gn->en", moves, covariance, moves)
        before = np.maximum((moves**2).sum(axis=0), 1e-300)
        return gain, np.sqrt(np.where(before > 1e-299, after / before, 1.0))
