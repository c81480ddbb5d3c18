"""Find the size parameter of an effect by simulation."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectParameter, effect
from irt.engine import rollouts

Array = NDArray[np.float64]


@functools.cache
def size_of(name: str) -> int | None:
    """Return the index of an effect's size parameter, at whose neutral value the effect vanishes, or None.

    Of an effect of the rim, which the run below never meets, it is the first.
    """
    if effect(name).of_rims:
        return 0
    plain = try_path([])
    silent = [
        index
        for index, one in enumerate(effect(name).required)
        if np.isfinite(one.neutral)
        and np.array_equal(try_path([{"name": name, **strong_values(name), one.name: one.neutral}]), plain)
    ]
    return silent[0] if len(silent) == 1 else None


@functools.cache
def sizes_of(name: str) -> Sequence[EffectParameter]:
    """Return an effect's size parameter, or all required ones but those that show only beside others.

    Without slopes the distance of a tilted camera does nothing: it is no size. What the run below never
    meets, such as a force at the rim, may be one.
    """
    known, size = effect(name).required, size_of(name)
    if size is not None:
        return (known[size],)
    strong, plain = strong_values(name), try_path([])
    together = try_path([{"name": name, **strong}])

    def is_size(one: EffectParameter) -> bool:
        alone = try_path([{"name": name, one.name: strong[one.name]}])
        others = try_path([{"name": name, **strong, one.name: one.neutral}])
        return not np.array_equal(alone, plain) or np.array_equal(others, together)

    return tuple(one for one in known if is_size(one))


def strong_values(name: str) -> dict[str, float]:
    """Return values of an effect with a clear influence on the path."""
    return {one.name: one.low + 0.4 * (one.high - one.low) for one in effect(name).required}


def try_path(chosen: Sequence[Mapping[str, object]], seeds: Sequence[int] = (1,)) -> Array:
    """Simulate a run that stays away from the rim for each of s seeds, (s, 30, 2)."""
    knobs = 0.05 * np.sin(np.linspace(0.0, 6.0, 30))[:, None] * [1.0, -0.7]
    base = np.tile([0.05, 0.05, 0.0005, 20.0, 1.0], (len(seeds), 1))
    return rollouts(base, knobs, effects=list(chosen), seed=list(seeds))
