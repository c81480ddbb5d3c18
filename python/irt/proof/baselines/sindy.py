"""Baseline: PySINDy on smoothed data, a sparse regression of the acceleration on a library of terms.

The library holds the base model's terms and one term for each effect that has one in a state equation. Terms
are standardised, so that the threshold is a share of the acceleration. The strongest term outside the base
model is named.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.extras import is_installed
from irt.proof.baselines.entry import Entry, Task, by_name
from irt.proof.baselines.smooth import DEGREE, WINDOW

Array = NDArray[np.float64]

TITLE = "PySINDy on smoothed data"
#: Terms with a smaller share of the acceleration's deviation are dropped.
THRESHOLD = 0.1
#: Terms for one axis; those of the own knob and of friction belong to the base model and name nothing.
TERMS = (
    "",
    "",
    "cross_coupling",
    "tilt_bias",
    "board_warp",
    "board_warp",
    "viscous_drag",
    "side_force",
    "quadratic_drag",
    "gear_nonlinearity",
)
_PARTS = 4


def enter(task: Task) -> Entry:
    """Regress both axes, name the strongest term outside the base model, and predict."""
    if not is_installed("pysindy"):
        return Entry(missing="pysindy is not installed")
    import pysindy  # noqa: PLC0415

    differ = pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": WINDOW, "polyorder": DEGREE})
    states, knobs, accelerations = [], [], []
    for run in task.rig.recordings:
        if len(run.knobs) < WINDOW or not run.seen.all():
            continue
        times = np.arange(len(run.knobs)) * task.row_s(run)
        velocity = np.asarray(differ(run.marble, times))
        accelerations.append(np.asarray(differ(velocity, times)))
        states.append(np.concatenate([run.marble, velocity], axis=1))
        knobs.append(run.knobs)
    if not states:
        return Entry(missing="no recording is long enough and without a gap")
    laws, shares = zip(
        *(
            _law(
                library(np.concatenate(states), np.concatenate(knobs), axis),
                np.concatenate(accelerations)[:, axis],
            )
            for axis in range(2)
        ),
        strict=True,
    )
    named = strongest(np.max(shares, axis=0))
    paths = _rolled(task, laws)
    return Entry(detected=bool(named), named=named, predictions=dict(by_name(task.tests, paths)))


def library(states: Array, knobs: Array, axis: int) -> Array:
    """Return the terms of one axis, (w, 10), for (w, 4) states and (w, 2) commands."""
    speed = np.hypot(states[:, 2], states[:, 3])
    place, other = states[:, axis], states[:, 1 - axis]
    rate, across = states[:, 2 + axis], states[:, 3 - axis]
    # A knob tilts the board about its own axis, which accelerates the marble along the other one.
    own, foreign = knobs[:, 1 - axis], knobs[:, axis]
    one = np.ones(len(states))
    return np.stack(
        [own, np.sign(rate), foreign, one, place, other, rate, across, rate * speed, own**3], axis=1
    )


def strongest(shares: Array) -> tuple[str, ...]:
    """Return the effect whose term has the largest share (10,); none if all such terms were dropped."""
    extra = [index for index, name in enumerate(TERMS) if name and shares[index] > 0.0]
    return (TERMS[max(extra, key=lambda index: shares[index])],) if extra else ()


def _law(terms: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return the coefficients of terms (w, 10) -> (10,), and their shares of the acceleration's deviation."""
    import pysindy  # noqa: PLC0415

    sizes = np.sqrt((terms**2).mean(axis=0))
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    scale = max(float(acceleration.std()), 1e-300)
    found = pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-3)
    try:
        found.fit(terms / sizes, acceleration[:, None] / scale)
    except ValueError:
        return np.zeros(len(sizes)), np.zeros(len(sizes))
    shares = np.asarray(found.coef_, dtype=np.float64).ravel()
    return shares * scale / sizes, np.abs(shares)


def _rolled(task: Task, laws: Sequence[Array]) -> list[Array]:
    """Return the path (n, 2) in each test: Runge and Kutta's method, stopped at the rim."""
    paths = []
    for test in task.tests:
        state, step = task.start(test)[None], task.row_s(test) / _PARTS
        path = [state[0, :2].copy()]
        for knobs in test.knobs[:-1]:
            for _ in range(_PARTS):
                state = _stepped(state, knobs[None], laws, step)
                outside = np.abs(state[:, :2]) >= task.base.reach
                state[:, 2:][outside] = 0.0
                state[:, :2] = np.clip(state[:, :2], -task.base.reach, task.base.reach)
            path.append(state[0, :2].copy())
        paths.append(np.array(path))
    return paths


def _stepped(state: Array, knobs: Array, laws: Sequence[Array], step: float) -> Array:
    def rate(at: Array) -> Array:
        # A polynomial diverges far outside; the rim has stopped the marble by then.
        at = np.clip(at, -1e3, 1e3)
        pushes = [library(at, knobs, axis) @ law for axis, law in enumerate(laws)]
        return np.concatenate([at[:, 2:], np.stack(pushes, axis=1)], axis=1)

    first = rate(state)
    second = rate(state + step / 2 * first)
    third = rate(state + step / 2 * second)
    return np.asarray(state + step / 6 * (first + 2 * second + 2 * third + rate(state + step * third)))
