"""The evolution strategies of the paper's comparison, in parameters scaled to [0, 1]."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from irt.tuning.drive import Drive
from irt.tuning.search import Search, Seen

Array = NDArray[np.float64]

#: Candidates of a generation of CMA-ES (paper, section 6.1).
POPULATION = 10
#: First step of CMA-ES in widths of the ranges.
STEP = 0.3
#: Parents and children of the evolution strategy of the earlier work (paper, section 6.1).
PARENTS, CHILDREN = 5, 100
#: Its first steps, and the rate at which they adapt, of five parameters (Beyer and Schwefel, 2002).
FIRST_STEP, RATE = 0.15, 1.0 / np.sqrt(2.0 * 5.0)


def cma_es(drive: Drive, start: Array, seed: int) -> Search:
    """Search by covariance matrix adaptation (pycma) from a (5,) start, until it converges.

    The fitness is the negative mean absolute state error, as in the paper.
    """
    with warnings.catch_warnings():
        # On import pycma warns about plots that it cannot draw.
        warnings.simplefilter("ignore")
        import cma  # noqa: PLC0415  # takes a while, and only this search needs it
    options = {"bounds": [0, 1], "popsize": POPULATION, "seed": seed + 1, "verbose": -9, "verb_log": 0}
    strategy = cma.CMAEvolutionStrategy(np.clip(start, 0.0, 1.0), STEP, options)
    while not strategy.stop():
        candidates = strategy.ask()
        found: Seen = yield drive.parameters(np.array(candidates))
        strategy.tell(candidates, found.mae.tolist())


def evolution_strategy(drive: Drive, start: Array, seed: int) -> Search:
    """Search by a self-adaptive (5 + 100) evolution strategy, without an end.

    One of the first parents is the (5,) start, the others are drawn uniformly.
    """
    random = np.random.default_rng(seed)
    parents = np.vstack([start, random.random((PARENTS - 1, len(start)))])
    steps = np.full(PARENTS, FIRST_STEP)
    found: Seen = yield drive.parameters(parents)
    errors = found.mae
    while True:
        of = random.integers(PARENTS, size=CHILDREN)
        own = steps[of] * np.exp(RATE * random.standard_normal(CHILDREN))
        children = reflected(parents[of] + own[:, None] * random.standard_normal((CHILDREN, len(start))))
        found = yield drive.parameters(children)
        together = np.concatenate([errors, found.mae])
        chosen = np.argsort(together, kind="stable")[:PARENTS]
        errors = together[chosen]
        parents = np.concatenate([parents, children])[chosen]
        steps = np.concatenate([steps, own])[chosen]


def reflected(scaled: Array) -> Array:
    """Return points reflected into [0, 1] at its ends."""
    folded = np.mod(scaled, 2.0)
    return np.where(folded > 1.0, 2.0 - folded, folded)


#: By the name of the method: from a drive, a start and a seed to a search.
STRATEGIES: dict[str, Callable[[Drive, Array, int], Search]] = {
    "cma-es": cma_es,
    "es": evolution_strategy,
}
