"""A controller that leads the marble from target to target: the commands of a lab that runs a policy.

Such commands change in every row, jump from limit to limit, and depend on the marble and on the tracker's
noise, as no drive that was drawn beforehand does.
"""

from __future__ import annotations

import numpy as np

from .drives import MOST_RAD
from .physics import EDGE_X_M, EDGE_Y_M, GRAVITY, RADIUS_M, Array

#: Bandwidth of a controller [rad/s], its damping ratio, how long a target stays [s], and how far from the
#: middle it is at most, as a part of the way to the rim.
BANDWIDTH, DAMPING, STAYS_S, REACH = (0.7, 3.0), 0.7, (0.8, 3.0), 0.9


class Controller:
    """Answers noisy positions with commands, row by row.

    Parameters
    ----------
    gears : tuple
        Of the rig, which it knows.
    row_s : float
        Seconds from one row to the next.
    sigma : float
        Standard deviation of the noise of the positions that it sees [board edges].
    random : Generator
        Draws bandwidth, targets and noise.
    """

    def __init__(
        self, gears: tuple[float, float], row_s: float, sigma: float, random: np.random.Generator
    ) -> None:
        self._row_s, self._sigma, self._random = row_s, sigma, random
        self._wanted = float(random.uniform(*BANDWIDTH))
        # Of a command about x the marble falls towards -y, of one about y towards +x.
        self._per_edge = EDGE_X_M / (5.0 / 7.0 * GRAVITY * np.array(gears[::-1])) * self._wanted**2
        self._target, self._left_s = np.zeros(2), 0.0
        self._before: Array | None = None
        self._velocity = np.zeros(2)

    def __call__(self, seen: Array) -> Array:
        """Return the command (2,) [rad] that answers a perfect position (2,) [board edges]."""
        if self._left_s <= 0.0:
            self._left_s += float(self._random.uniform(*STAYS_S))
            limit = REACH * (np.array([EDGE_X_M, EDGE_Y_M]) / 2.0 - RADIUS_M) / EDGE_X_M
            self._target = self._random.uniform(-limit, limit)
        self._left_s -= self._row_s
        place = seen + self._sigma * self._random.normal(size=2)
        before = place if self._before is None else self._before
        self._velocity = 0.5 * (self._velocity + (place - before) / self._row_s)
        self._before = place
        push = self._per_edge * (self._target - place - 2.0 * DAMPING / self._wanted * self._velocity)
        # Adding zero removes the sign of negative zeros.
        return np.asarray(np.clip([-push[1], push[0]], -MOST_RAD, MOST_RAD).round(6) + 0.0)
