"""CMA-ES (pycma) over this project's rollouts, one batch to a population."""

from __future__ import annotations

import cma
import numpy as np

from peers.fit_task import Trace, from_unit, to_unit
from peers.workload import Array

#: Initial step in shares of the ranges, and maximum number of candidates of one start.
SIGMA, CANDIDATES = 0.3, 4000


def fit(trace: Trace, start: Array, seed: int) -> None:
    """Minimise the root mean square error in shares of the ranges, at pycma's defaults."""
    options = {"bounds": [0, 1], "seed": seed + 1, "maxfevals": CANDIDATES, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy(to_unit(start), SIGMA, options)
    while not strategy.stop():
        candidates = strategy.ask()
        predicted = trace.task.predict(from_unit(np.array(candidates)))
        trace.note(predicted)
        strategy.tell(candidates, trace.task.error(predicted).tolist())
