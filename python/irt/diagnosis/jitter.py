"""Delays that differ from command to command: named and sized, never fitted as if they could be known."""

from __future__ import annotations

import numpy as np

from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.latent import JITTER, Leftover
from irt.model import Parameter

#: By so many nats a differing delay must explain the leftover better than any other variable.
CLEAR = 3.0
#: What repeats must not explain it better by so many nats in stretches of any length.
REPEATS = 10.0
#: Scatter that they leave beside their mean, at least, in units of the tracker's.
MATTERS = 1.2
#: Rows of the stretches looked at: in short ones other causes go less astray, long ones show smaller spreads.
STRETCHES = (24, 60)


def kicks(case: Case, mean: Fitted, price: float, *, is_rounded: bool = False) -> Leftover | None:
    """Return what a mean delay leaves over, if the delays differ from command to command; else None.

    If they do, the marble is moved along each change of the command, by as much as it came late, and never
    twice the same. Other variables explain it less well, and it is worth its price [nats].
    What repeats must not be clearly better in longer or shorter stretches: in some a picture that turns with
    the tilt looks like kicks.

    Beside what rounds commands, as a lag does, kicks look like a push in each row, too: there only what
    repeats has to explain less.
    """
    told: Leftover | None = None
    for longest in STRETCHES:
        leftover = Leftover(case, mean, longest=longest)
        sources = leftover.sources(case.seed, nulls=0)
        gain = max((one.gain for one in sources if one.variable == JITTER), default=0.0)
        if any(one.gain > gain + REPEATS for one in sources if one.repeats):
            return None
        rivals = [one.gain for one in sources if one.variable != JITTER and (one.repeats or not is_rounded)]
        others = max(rivals, default=np.inf)
        if told is None and gain > max(price, others + CLEAR):
            told = leftover
    return told


def matters(case: Case, mean: Fitted) -> bool:
    """Whether a mean delay leaves more than the tracker's own memory may make, which looks like kicks."""
    return mean.noise > MATTERS * case.noise


def spread(case: Case, mean: Fitted, leftover: Leftover) -> Parameter:
    """Return the standard deviation of delays that differ [s], with its 95 % interval."""
    row_s = case.row_s(mean)
    size, low, high = (row_s * one for one in leftover.size_of_jitter())
    return Parameter(size, low, high)


def with_clock(told: Parameter, clock: Parameter) -> Parameter:
    """Widen the interval of a time that was told in rows by how well is known how long these last.

    A marble that rolls from rest takes gears and a clock that are both off for the right ones.
    """
    if told.low is None or told.high is None or clock.low is None or clock.high is None:
        return Parameter(told.value)
    return Parameter(told.value, told.low * clock.low / clock.value, told.high * clock.high / clock.value)
