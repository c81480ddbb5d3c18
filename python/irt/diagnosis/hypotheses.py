"""Which effects of the catalogue are hypotheses, and what each of them does, told by trying it."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from irt.catalogue import effect, hypothetical
from irt.fitting.effect_size import size_of, strong_values, try_path

#: Effects that are one thing by two names: no recording of a rig that stays the same tells them apart.
ALIKE = frozenset({"delay", "latency"})
#: Parameters that say where on the board something is.
PLACE = {"x_m", "y_m"}
#: Change of a path that is rounding [board edges].
_NOTHING = 1e-12
#: A change of size by so little changes a path alike, as the cosine between the changes.
_LITTLE, _ALIKE = 0.01, 0.9


#: Delays that differ from command to command: no draw of them can be predicted, and none is fitted. To the
#: filter they are a size of what is random, beside their mean.
JITTER = "delay_jitter"
#: The effect that is the mean of delays that differ.
MEAN = "delay"
#: Effects that are not beside delays that differ: on average over many commands these come late and smoothed.
SMOOTHED = ALIKE | {"lag"}


def hypotheses() -> list[str]:
    """Return the names of the effects that the recordings are asked for, one for each group of `ALIKE`."""
    return [
        info.name
        for info in hypothetical()
        if info.name != max(ALIKE) and (info.name == JITTER or _repeats(info.name))
    ]


def group_of(name: str) -> list[str]:
    """Return the effects that an effect is at work in: its other name, and for a delay those that differ."""
    if name not in ALIKE:
        return [name]
    return [*sorted(ALIKE), JITTER]


def simulated(effects: Sequence[str]) -> list[str]:
    """Return which effects the engine simulates for a set: of delays that differ, their mean."""
    return [MEAN if name == JITTER else name for name in effects]


@functools.cache
def _repeats(name: str) -> bool:
    paths = try_path([{"name": name, **strong_values(name)}], seeds=[1, 2])
    return bool(np.array_equal(paths[0], paths[1]))


@functools.cache
def acts_on_impacts_alone(name: str) -> bool:
    """Whether an effect changes nothing away from the rim, but where a run is seen to begin."""
    if not all(np.isfinite(one.neutral) for one in effect(name).required):
        return False
    changed = try_path([{"name": name, **strong_values(name)}])
    return bool(np.ptp(changed - try_path([]), axis=1).max() < _NOTHING)


def is_law_of_impacts(name: str) -> bool:
    """Whether an effect says how a marble leaves the rim, and not where that is."""
    return acts_on_impacts_alone(name) and effect(name).stage == "contact"


def has_place(name: str) -> bool:
    """Whether an effect pushes the marble at a place of the board."""
    info = effect(name)
    return info.stage != "sensing" and {one.name for one in info.required} >= PLACE


@functools.cache
def is_rough(name: str) -> bool:
    """Whether a little more of an effect changes a path in another way: each size is to be tried."""
    index = size_of(name)
    if index is None:
        return False
    strong, one = strong_values(name), effect(name).required[index]
    more = one.neutral + (1.0 + _LITTLE) * (strong[one.name] - one.neutral)
    plain = try_path([])
    changes = [
        try_path([{"name": name, **strong, one.name: size}]) - plain for size in (strong[one.name], more)
    ]
    lengths = [float(np.linalg.norm(change)) for change in changes]
    return float((changes[0] * changes[1]).sum()) < _ALIKE * lengths[0] * lengths[1]
