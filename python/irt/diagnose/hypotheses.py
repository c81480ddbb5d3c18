"""Which effects of the catalogue are hypotheses: those that repeat, and so can be fitted."""

from __future__ import annotations

import functools

import numpy as np

from irt.catalogue import effect, effects
from irt.rollouts import rollouts


def hypotheses() -> list[str]:
    """Return the names of the effects that the same commands always bring about alike.

    What is drawn anew for each command cannot be predicted: fitted, it would be one draw among all, and not
    that of the recordings (`irt.diagnose.jitter` looks for it in another way).
    """
    return [info.name for info in effects() if _repeats(info.name)]


@functools.cache
def _repeats(name: str) -> bool:
    knobs = 0.05 * np.sin(np.linspace(0.0, 6.0, 30))[:, None] * [1.0, -0.7]
    strong = {one.name: one.low + 0.4 * (one.high - one.low) for one in effect(name).parameters}
    base = np.tile([0.05, 0.05, 0.0005, 20.0, 1.0], (2, 1))
    paths = rollouts(base, knobs, effects=[{"name": name, **strong}], seed=[1, 2])
    return bool(np.array_equal(paths[0], paths[1]))
