from __future__ import annotations

import numpy as np

from irt.fitting.fit import Estimate, Iteration


def test_a_method_may_end_worse_than_it_was():
    history = tuple(Iteration(np.full(5, index), mae) for index, mae in enumerate([0.3, 0.1, 0.2]))
    estimate = Estimate(history)
    assert estimate.best is history[1]
    assert estimate.final is history[2]
