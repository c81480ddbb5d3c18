"""Which effects of the catalogue are hypotheses, and what each of them does, told by trying it."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from irt.catalogue import hypothetical
from irt.fitting.effect_size import strong_values, try_path

#: Effects that are one thing by two names: no recording of a rig that stays the same tells them apart.
ALIKE = frozenset({"delay", "latency"})


#: Delays that differ from command to command: no draw of them can be predicted, and none is fitted. To the
#: filter they are a size of what is random, beside what they are on average.
JITTER = "delay_jitter"
#: What delays that differ are on average over many commands, which come late and smoothed: a delay, and a lag
#: whose time constant is their standard deviation.
MEAN, SMOOTHING = "delay", "lag"
ON_AVERAGE = (MEAN, SMOOTHING)
#: Names of their sizes: by so much commands come late, and by so much more they are smoothed.
SHIFT_S, SMOOTHED_S = f"{MEAN}.delay_s", f"{SMOOTHING}.time_constant_s"
#: Effects that are not beside delays that differ, which have them.
SMOOTHED = ALIKE | {SMOOTHING}


#: How the board resists a spin about the vertical: every set has it beside the five parameters, and none is
#: named for it. Marbles spin once they have met the rim, and engines differ by this more than by any
#: other thing.
SPINNING = "spinning_friction"
#: Name of its size.
SPIN = f"{SPINNING}.increase"

#: The board's own slopes, as a smooth map: a small push that depends on the place alone.
MAP = "slope_map"


def hypotheses(start: str = "rest") -> list[str]:
    """Return the names of the effects that recordings are asked for, one for each group of `ALIKE`.

    Effects that depend on how the marble has been turned depend on how it lies as a recording begins. Whoever
    lays it down can do so alike each time; one that rolls already lies another way in each recording, and no
    value is common to all.

    Parameters
    ----------
    start : str
        How marbles begin, as a rig says: "rest" or "moving".
    """
    return [
        info.name
        for info in hypothetical()
        if info.name != max(ALIKE)
        and (info.name == JITTER or _repeats(info.name))
        and (start == "rest" or not info.turns)
    ] + [MAP]


def group_of(name: str) -> list[str]:
    """Return the effects that an effect is at work in: its other name, and delays that differ have both."""
    if name == SMOOTHING:
        return [name, JITTER]
    return [*sorted(ALIKE), JITTER] if name in ALIKE else [name]


def simulated(effects: Sequence[str]) -> list[str]:
    """Return which effects the engine simulates for a set: for delays that differ, their average."""
    return [SPINNING, *(one for name in effects for one in (ON_AVERAGE if name == JITTER else (name,)))]


@functools.cache
def _repeats(name: str) -> bool:
    paths = try_path([{"name": name, **strong_values(name)}], seeds=[1, 2])
    return bool(np.array_equal(paths[0], paths[1]))
