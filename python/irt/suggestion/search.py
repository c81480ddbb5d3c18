"""Search for the best excitation: random draws from all families, then local search around the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irt.fitting.fit import Progress
from irt.rig import Rig
from irt.suggestion.alike import alike
from irt.suggestion.criterion import Criterion
from irt.suggestion.excitations import FAMILIES, GENES, Excitation, Limits, draw

Array = NDArray[np.float64]

#: Excitations drawn from each family.
_DRAWN = 60
#: Excitations improved in each round, number of rounds, and trials per excitation and round.
_PARENTS, _ROUNDS, _TRIALS = 6, 8, 12
#: Standard deviation of a trial's genes from its parent in the first round, and its factor per round.
_SPREAD, _NARROWER = 0.15, 0.7
#: Pairs with less evidence than this in all draws [nats] are tested for being alike, on this number of runs.
_SUSPECT, _RUNS = 30.0, 6


@dataclass(frozen=True, eq=False)
class Found:
    """The best excitation of a search.

    Attributes
    ----------
    best : Excitation
        The excitation to play.
    tried : int
        Number of excitations compared.
    most_nats : (p,) array
        Largest expected evidence between the hypotheses of each pair [nats].
    alike : (p,) bool array
        Whether a pair makes the same predictions for any commands.
    """

    best: Excitation
    tried: int
    most_nats: Array
    alike: NDArray[np.bool_]


@dataclass(eq=False)
class Search:
    """A search over the excitations that a rig can play.

    Attributes
    ----------
    criterion : Criterion
        The score of excitations.
    rig : Rig
        The rig.
    limits : Limits
        Limits of the commands.
    seed : int
        Random seed.
    progress : callable or None
        Called with (done, total, text).
    """

    criterion: Criterion
    rig: Rig
    limits: Limits
    seed: int
    progress: Progress | None = None
    _tried: int = 0
    _most: Array = field(default_factory=lambda: np.zeros(0))
    _alike: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def run(self, recorded: Sequence[Excitation]) -> Found:
        """Search all families and runs like those recorded."""
        rng = np.random.default_rng(self.seed)
        pairs = len(self.criterion.pairs)
        self._most, self._alike, self._tried = np.zeros(pairs), np.zeros(pairs, dtype=bool), 0
        runs = [
            draw(family, genes, self.limits) for family in FAMILIES for genes in rng.random((_DRAWN, GENES))
        ]
        scores = self._scores([*runs, *recorded], 0)
        known, scores = scores[len(runs) :], scores[: len(runs)]
        for number in range(_ROUNDS):
            ahead = np.argsort(-scores, kind="stable")[:_PARENTS]
            parents = [runs[index] for index in ahead]
            spread = _SPREAD * _NARROWER**number
            trials = [
                draw(one.family, _varied(one.genes, spread, rng), self.limits)
                for one in parents
                for _ in range(_TRIALS)
            ]
            runs, scores = parents + trials, np.append(scores[ahead], self._scores(trials, number + 1))
        runs, scores = [*runs, *recorded], np.append(scores, known)
        best = runs[int(np.argmax(scores))]
        return Found(best, self._tried, self._most, self._alike)

    def _scores(self, runs: Sequence[Excitation], done: int) -> Array:
        if self.progress is not None:
            self.progress(done, _ROUNDS + 1, "excitations")
        worth = self.criterion.worth(runs)
        if done == 0:
            for index, pair in enumerate(self.criterion.pairs):
                best = np.argsort(-worth.nats[:, index], kind="stable")[:_RUNS]
                if worth.nats[best[0], index] < _SUSPECT:
                    chosen = [runs[one] for one in best]
                    self._alike[index] = alike(self.criterion, self.rig, pair, chosen)
        self._tried += len(runs)
        self._most = np.maximum(self._most, np.where(self._alike, 0.0, worth.nats.max(axis=0)))
        return worth.score(self.criterion.probabilities, self._alike)


def _varied(genes: Array, spread: float, rng: np.random.Generator) -> Array:
    """Return genes with a random third of them moved, reflected at 0 and 1."""
    moved = genes + np.where(rng.random(GENES) < 1 / 3, spread * rng.normal(size=GENES), 0.0)
    return np.asarray(np.clip(1.0 - np.abs(1.0 - np.abs(moved)), 0.0, 1.0))
