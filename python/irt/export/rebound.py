"""How MuJoCo has to be asked for a coefficient of restitution.

MuJoCo's contacts are springs with dampers that never pull: ``solref`` is a time constant T and a damping
ratio z, and a body that penetrates by x is accelerated by -(2/T) v - x/(T z)^2. What it leaves with depends
on z, and a little on the time step and on when in a step they meet; so z is found by stepping such a contact.
"""

from __future__ import annotations

import functools

import numpy as np

#: A contact without rebound: its time constant [steps] and damping ratio. With a ratio of 1 a seventh of the
#: speed comes back.
DEAD_STEPS, DEAD_RATIO = 4.0, 3.0
#: Half a period of the spring of a rim that throws marbles back [steps].
HALF_PERIOD_STEPS = 16.0
#: The least and the largest restitution that are asked for; below, a rim is dead.
LEAST, MOST = 0.05, 0.95
#: Phases of a step at which contacts begin, and rounds of bisection.
_PHASES, _ROUNDS = 16, 40


def solref(restitution: float, step_s: float) -> tuple[float, float]:
    """Return time constant [s] and damping ratio of a rim that returns this part of a marble's speed.

    Parameters
    ----------
    restitution : float
        From 0 to 1; no more than 0.95 is asked for.
    step_s : float
        The time step of the simulation [s].
    """
    if restitution < LEAST:
        return DEAD_STEPS * step_s, DEAD_RATIO
    ratio = damping_ratio(min(restitution, MOST))
    return HALF_PERIOD_STEPS * step_s / np.pi / ratio, ratio


@functools.cache
def damping_ratio(restitution: float) -> float:
    """Return the damping ratio at which a contact returns this part of the speed, on average over phases."""
    low, high = 1e-3, DEAD_RATIO
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rebound(middle) > restitution else (low, middle)
    return 0.5 * (low + high)


def rebound(ratio: float) -> float:
    """Return the part of its speed with which a body leaves a contact of this damping ratio."""
    omega = np.pi / HALF_PERIOD_STEPS
    speed = np.full(_PHASES, -1.0)
    place = (np.arange(_PHASES) + 0.5) / _PHASES
    for _ in range(int(8 * HALF_PERIOD_STEPS)):
        push = -2.0 * ratio * omega * speed - omega**2 * place
        speed = speed + np.where(place < 0.0, np.maximum(push, 0.0), 0.0)
        place = place + speed
    return float(np.mean(np.maximum(speed, 0.0)))
