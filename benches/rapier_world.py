"""Marbles moved by rapier in 3-D: a world of `hide_effects`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import irt

Array = NDArray[np.float64]

KNOWN = frozenset(one.name for one in irt.effects())
CHOICES: dict[str, dict[str, float]] = {}


def simulate(
    values: Array,
    knobs: Array,
    effects: Sequence[dict[str, Any]],
    *,
    start: Array | None,
    seeds: NDArray[np.int64],
) -> Array:
    """Return observed positions (n, rows, 2) [board edges] of parameters (5,) under knobs (n, rows, 2)."""
    many = np.tile(values, (len(knobs), 1))
    return irt.rollouts(many, knobs, engine="rapier", effects=effects, start=start, seed=seeds, threads=1)
