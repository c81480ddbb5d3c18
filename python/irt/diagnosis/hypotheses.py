"""The hypotheses of a diagnosis: which effects of the catalogue are searched, and their special cases."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from irt.catalogue import hypothetical
from irt.fitting.effect_size import strong_values, try_path

#: Effects that no recording of an unchanged rig can distinguish.
ALIKE = frozenset({"delay", "latency"})


#: Delay jitter: delays that vary from command to command cannot be predicted, so they are not fitted. The
#: filter treats their spread as a noise size, in addition to their mean effect.
JITTER = "delay_jitter"
#: The mean effect of delay jitter over many commands: a delay, and a lag whose time constant is the standard
#: deviation of the delays.
MEAN, SMOOTHING = "delay", "lag"
ON_AVERAGE = (MEAN, SMOOTHING)
#: Names of the sizes of delay and lag.
SHIFT_S, SMOOTHED_S = f"{MEAN}.delay_s", f"{SMOOTHING}.time_constant_s"
#: Sizes of the effects that act by a time.
SIZES_OF_TIMES = {MEAN: SHIFT_S, "latency": "latency.latency_s", SMOOTHING: SMOOTHED_S}
#: Effects that delay jitter includes, and that are not combined with it.
SMOOTHED = ALIKE | {SMOOTHING}


#: Friction against spins about the vertical. Every set includes it in addition to the five parameters, and it
#: is never named: marbles spin after contact with the rim, and engines differ in this more than in anything
#: else.
SPINNING = "spinning_friction"
#: Name of its size.
SPIN = f"{SPINNING}.increase"

#: Inertial forces in the frame of the turning board. They are searched like an effect, and never named: they
#: act on every rig, but show only under commands that change much and often, as those of a controller.
INERTIA = "inertial_forces"

#: Slopes of the board as a smooth map: a small push that depends on the position only.
MAP = "slope_map"


def hypotheses(start: str = "rest", *, tilt: bool = False) -> list[str]:
    """Return the names of the effects that are searched, one of `ALIKE` unless the tilt is measured.

    Effects that depend on the marble's orientation need its initial orientation. A marble at rest can be
    placed in the same orientation for each recording. A marble that starts in motion has another orientation
    in each recording, so these effects are excluded.

    Parameters
    ----------
    start : str
        Start of the recordings, as in a rig: "rest" or "moving".
    tilt : bool
        Whether the tilt is measured: it is late with the command, but not with the picture of the marble.
    """
    return [
        info.name
        for info in hypothetical()
        if (tilt or info.name != max(ALIKE))
        and (info.name == JITTER or _repeats(info.name))
        and (start == "rest" or not info.turns)
    ] + [INERTIA, MAP]


def group_of(name: str) -> list[str]:
    """Return the effects that include an effect: its equivalents in `ALIKE`, and delay jitter."""
    if name == SMOOTHING:
        return [name, JITTER]
    return [*sorted(ALIKE), JITTER] if name in ALIKE else [name]


def simulated(effects: Sequence[str]) -> list[str]:
    """Return the effects that the engine simulates for a set, with delay jitter as its mean effect."""
    return [SPINNING, *(one for name in effects for one in (ON_AVERAGE if name == JITTER else (name,)))]


@functools.cache
def _repeats(name: str) -> bool:
    paths = try_path([{"name": name, **strong_values(name)}], seeds=[1, 2])
    return bool(np.array_equal(paths[0], paths[1]))
