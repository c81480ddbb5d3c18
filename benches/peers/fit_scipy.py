"""`scipy.optimize.least_squares` over this project's rollouts, one batch to a Jacobian."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from peers.fit_task import LOW, NOISE, Trace, from_unit, to_unit
from peers.workload import Array

#: Difference step, as a share of a parameter's range, and maximum number of evaluations of one start.
STEP, EVALUATIONS = 1e-4, 200
TIME_SCALE = 3


def fit(trace: Trace, start: Array, seed: int) -> None:
    """Fit in shares of the ranges, so that no parameter needs scaling, under the soft-L1 loss."""
    del seed
    observed = trace.task.observed

    def residual(unit: Array) -> Array:
        predicted = trace.task.predict(from_unit(unit)[None])
        trace.note(predicted)
        return np.asarray((predicted[0] - observed).ravel())

    def jacobian(unit: Array) -> Array:
        # Inwards, and with the same number of physics steps, because another number would look like a jump.
        step = np.where(unit < 0.5, STEP, -STEP)
        points = from_unit(np.vstack([unit, unit + np.diag(step)]))
        count = max(1, round(float(points[0, TIME_SCALE])))
        predicted = trace.task.predict(points, np.full(len(points), count))
        trace.note(predicted)
        change = (predicted[1:] - predicted[0]).reshape(len(LOW), -1)
        return np.asarray((change / step[:, None]).T)

    least_squares(
        residual,
        to_unit(start),
        jac=jacobian,
        bounds=(0.0, 1.0),
        loss="soft_l1",
        f_scale=3 * NOISE,
        max_nfev=EVALUATIONS,
    )
