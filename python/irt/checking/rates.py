"""Check for commands that set the rate of the tilt: a motor's speed or current, which no angle follows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.checking.responses import CERTAIN, SURE, delays_to_try
from irt.checking.result import Finding
from irt.checking.runs import row_step
from irt.conventions import FITTED, Signals, fit_level, resampled
from irt.rig import Rig

Array = NDArray[np.float64]

#: Duration over which the tilt changes [s], and without stamps [rows]: a few time constants of a motor, and
#: far less than a drift takes.
_WINDOW_S, _WINDOW_ROWS = 0.4, 12


def rate_findings(rig: Rig, cleaned: Sequence[tuple[Array, Array | None]]) -> list[Finding]:
    """Return a finding if the commands' integral certainly explains the tilt's changes, and they do not.

    Both are fitted to the same changes. The integral has to explain more than half of them, and to be a
    million times likelier than commands that the tilt follows after any delay.

    Parameters
    ----------
    rig : Rig
        The recordings.
    cleaned : sequence of (array, array or None)
        Positions and tilt of each, without what is no measurement.
    """
    step = row_step(rig)
    rows = _WINDOW_ROWS if step is None else max(1, round(_WINDOW_S / step))
    integrals, commands = [], []
    for run, (_, tilt) in zip(rig.recordings, cleaned, strict=True):
        if tilt is None or not run.has_tilt:
            continue
        times = None if step is None else run.stamps
        knobs, angles = resampled(times, run.knobs, tilt, held=(True, False))
        if len(knobs) <= rows:
            continue
        integral, change = np.cumsum(knobs, axis=0), angles[rows:] - angles[:-rows]
        integrals.append(Signals(integral[rows:] - integral[:-rows], change))
        commands.append(Signals(knobs[rows:] - knobs[:-rows], change))
    if not integrals:
        return []
    delays = delays_to_try(step)
    by_rate, by_angle = fit_level(integrals, delays), fit_level(commands, delays)
    if by_rate is None or by_angle is None:
        return []
    explained = [float(one.shares.max()) for one in (by_rate, by_angle)]
    # A share of exactly 1 is rounding.
    left = np.maximum(1.0 - np.array(explained), 1e-12)
    nats = max(by_rate.blocks - FITTED, 0) * np.log(left[1] / left[0])
    if explained[0] < SURE or nats < CERTAIN:
        return []
    names = " and ".join(rig.recordings[0].columns)
    return [
        Finding(
            "warning",
            f"the integrals of {names} explain {100 * explained[0]:.0f} % of the measured tilt's changes, "
            f"they themselves {100 * explained[1]:.0f} %: they set its rate, as a motor's speed or current "
            "does, and no angle follows them",
            "tilt",
            "`irt import` the log: it writes the measured tilt as the command",
        )
    ]
