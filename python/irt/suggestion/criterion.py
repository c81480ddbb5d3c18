"""How much a run would tell: between hypotheses, and about their parameters.

A difference between two predictions counts only where neither the tracker's noise nor a refit explains it. To
first order around hypotheses that recordings know with covariance C, and with slopes J of a new run, that is

    d' (S + J_a C_a J_a' + J_b C_b J_b')^-1 d,

d the difference, S the tracker's variance and what linear slopes do not foresee. A run that ends in chaos has
a large S where it does, and gains nothing there. What stays of d row by row, after the best move of all
parameters and of the start, is judged by the likelihood that fits are judged by, Student's t: a few rows that
differ wildly count no more than they do there.

A run is worth the mutual information between what it will show and which hypothesis is true. From the nats
D_ij between two hypotheses, whose probabilities are w, its lower bound by Chernoff's distances is

    -sum_i w_i log sum_j w_j exp(-a^2 D_ij / 4)

(Kolchinsky and Tracey, "Estimating mixture entropy with pairwise distances", Entropy 19, 2017), between none
and the entropy of w: a pair that one run separates anyway is worth no more for being separated twice. How far
two hypotheses lie apart is known to about its own size: a is standard normal, and the mean of the exponential
(1 + D_ij / 2)^-1/2. With a = 1 a run that just suffices would be as good as one with evidence to spare.
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

#: The worth of a nat about parameters beside one about which hypothesis is true.
_SHARPEN = 0.02
#: What a single step along an open direction must change to count, over the tracker's noise.
_FAINT = 0.5
#: Rollouts that are simulated together, at most: more would fill the memory.
_TOGETHER = 20_000


@dataclass(frozen=True, eq=False)
class Worth:
    """What each of e runs would tell of m hypotheses, p pairs of them.

    Attributes
    ----------
    distance : (e, p) array
        Root mean square of what refits leave of the difference of two predictions, over the noise expected.
    nats : (e, p) array
        Evidence expected between the two hypotheses of a pair.
    gain : (e, m) array
        What a run tells about the parameters of each hypothesis [nats].
    remaining : (e, f) array
        Standard deviation of each of n parameters of the first hypothesis over that known so far.
    at_wall : (e,) array
        Share of rows with the marble at a wall.
    walls_matter : bool
        Whether a hypothesis is about walls.
    """

    distance: Array
    nats: Array
    gain: Array
    remaining: Array
    at_wall: Array
    walls_matter: bool

    def information(self, probabilities: Array, alike: NDArray[np.bool_]) -> Array:
        """Return the mutual information between each run and which hypothesis is true [nats], (e,).

        Parameters
        ----------
        probabilities : (m,) array
            Of the hypotheses.
        alike : (p,) bool array
            Pairs that predict the same in all runs.
        """
        count = len(probabilities)
        overlap = np.ones((len(self.gain), count, count))
        for index, (a, b) in enumerate(combinations(range(count), 2)):
            shared = 1.0 if alike[index] else (1.0 + 0.5 * self.nats[:, index]) ** -0.5
            overlap[:, a, b] = overlap[:, b, a] = shared
        return np.asarray(-np.log(overlap @ probabilities) @ probabilities)

    def score(self, probabilities: Array, alike: NDArray[np.bool_]) -> Array:
        """Return what makes one run better than another, (e,); what is given is as of `information`."""
        worth = self.information(probabilities, alike) + _SHARPEN * self.gain @ probabilities
        return np.asarray(worth if self.walls_matter else worth * (1.0 - self.at_wall))


@dataclass(frozen=True, eq=False)
class Criterion:
    """Judges runs.

    Attributes
    ----------
    hypotheses : tuple of Hypothesis
        The first is the one whose parameters are told about.
    probabilities : (m,) array
        Of the m hypotheses, one in sum.
    noise : float
        The tracker's standard deviation [board edges].
    time_scale : float or None
        What stamps say, as a model's ``time_scale``.
    threads : int or None
        Of the engine.
    """

    hypotheses: tuple[Hypothesis, ...]
    probabilities: Array
    noise: float
    time_scale: float | None
    threads: int | None

    @property
    def step_s(self) -> float | None:
        """Time of a row [s] where stamps tell it."""
        return None if self.time_scale is None else self.time_scale * SUBSTEP_S

    def stamps(self, rows: int) -> Array | None:
        """Return the time of each row (n,) [s] where the rig's recordings have stamps."""
        return None if self.step_s is None else np.arange(rows, dtype=np.float64) * self.step_s

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of hypotheses."""
        return list(combinations(range(len(self.hypotheses)), 2))

    def worth(self, runs: Sequence[Excitation]) -> Worth:
        """Return what runs of one length would tell."""
        widest = max(2 * len(one.deviations) + 7 for one in self.hypotheses)
        at_once = max(1, _TOGETHER // widest)
        parts = [self._worth(runs[first : first + at_once]) for first in range(0, len(runs), at_once)]
        fields = ("distance", "nats", "gain", "remaining", "at_wall")
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in fields}
        return Worth(**joined, walls_matter=parts[0].walls_matter)

    def _worth(self, runs: Sequence[Excitation]) -> Worth:
        told = [one.expected(runs, self.step_s, threads=self.threads) for one in self.hypotheses]
        compared = [self._compared(told[a], told[b]) for a, b in self.pairs]
        distance, nats = (np.array([one[i] for one in compared]).reshape(-1, len(runs)).T for i in range(2))
        learnt = [
            self._learnt(hypothesis, one) for hypothesis, one in zip(self.hypotheses, told, strict=True)
        ]
        return Worth(
            distance=distance,
            nats=nats,
            gain=np.stack([gain for gain, _ in learnt], axis=1),
            remaining=learnt[0][1],
            at_wall=np.mean([one.at_wall for one in told], axis=0),
            walls_matter=any(effect(name).of_rims for one in self.hypotheses for name in one.effects),
        )

    def _compared(self, one: Expected, other: Expected) -> tuple[Array, Array]:
        """Return distance and nats between two hypotheses for each run, (e,) each."""
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
        """Return nats about the parameters (e,), and how much of each deviation remains (e, n)."""
        count = len(hypothesis.deviations)
        slopes = one.slopes.copy()
        # Along what recordings leave open a step is repeated many times over, and with it what whole updates
        # make of an impact: a search would hunt for that.
        repeated = np.where(hypothesis.steps < 1.0, 1.0 / hypothesis.steps, 0.0)
        faint = _FAINT * self.noise * repeated[:, None]
        known = slopes[:, :count]
        slopes[:, :count] = np.sign(known) * np.maximum(np.abs(known) - faint, 0.0)
        slopes /= np.sqrt(self.noise**2 + one.variance)[:, None]
        covariance = np.linalg.inv(np.eye(slopes.shape[1]) + slopes @ slopes.swapaxes(1, 2))
        # The start's place is no knowledge about the rig: its block is left out after the inverse.
        covariance = covariance[:, :count, :count]
        gain = -0.5 * np.linalg.slogdet(covariance)[1]
        moves = hypothesis.deviations
        after = np.einsum("fn,efg,gn->en", moves, covariance, moves)
        before = np.maximum((moves**2).sum(axis=0), 1e-300)
        return gain, np.sqrt(np.where(before > 1e-299, after / before, 1.0))
