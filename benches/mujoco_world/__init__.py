"""A steel marble on a plate on two hinges, moved by MuJoCo: a world of `hide_effects`.

It shares no physics with the engines of this project. The plate really turns, in Euler angles about x, then
about y; marble, plate and four rims have contacts with sliding, spinning and rolling friction (condim 6,
elliptic cones). Effects act as in a laboratory: between command and hinge, as forces on the marble, as
coefficients of its contacts, in the camera. They are implemented again from their equations in
``docs/effects.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.rig import Board

from .commands import STEP_S, TILTS, TURNS, Clock, tilts
from .contacts import FACTORS, FORCES, OF_MARBLE, OF_RIMS
from .pictures import SEEN, place_of, see
from .plate import roll

Array = NDArray[np.float64]

KNOWN = frozenset(
    ["delay", "delay_jitter", "clock_drift", "latency", *TURNS, *TILTS, *FORCES, *FACTORS]
) | frozenset([*OF_MARBLE, *OF_RIMS, *SEEN])

#: Values of choices that it can simulate: no heavy side follows the path.
CHOICES = {"eccentric_marble": {"follows_path": 0.0}}


def simulate(
    values: Array,
    knobs: Array,
    effects: Sequence[dict[str, Any]],
    *,
    start: Array | None,
    seeds: NDArray[np.int64],
) -> Array:
    """Return observed positions (n, rows, 2) [board edges] of parameters (5,) under knobs (n, rows, 2).

    Parameters
    ----------
    values : (5,)
        ``gear_x``, ``gear_y``, ``rolling_friction``, ``time_scale``, ``observation_scale``.
    knobs : (n, rows, 2)
        Commands [rad]: each holds until the next one.
    effects : sequence of dict
        Each with its ``name`` and its parameters; those left out are neutral.
    start : (n, 2), optional
        Where the camera sees marbles that rest in row 0 [board edges]; default the middle.
    seeds : (n,)
        Of delays that differ by chance.
    """
    hidden = {str(one["name"]): {key: float(one[key]) for key in one if key != "name"} for one in effects}
    if unknown := set(hidden) - KNOWN:
        raise ValueError(f"MuJoCo's world has no {', '.join(sorted(unknown))}")
    runs, rows = knobs.shape[:2]
    clock = Clock.of(values[3], rows, hidden)
    turned = tilts(values, knobs, hidden, seeds, clock)
    edges_per_m = values[4] / Board().edge_x_m
    seen = np.zeros((runs, 2)) if start is None else start
    places = roll(turned, place_of(seen, turned[:, 0], edges_per_m, hidden), values[2], hidden)
    # What a picture shows is as old as its latency; before row 0 the marble rested.
    moments = np.clip((clock.pictures - hidden.get("latency", {}).get("latency_s", 0.0)) / STEP_S, 0.0, None)
    before = np.floor(moments).astype(int)
    part = (moments - before)[:, None]
    shown = (1.0 - part) * places[:, before] + part * places[:, before + 1]
    # The plate as it was just before the picture, which is before that row's command.
    tilted = turned[:, np.maximum(np.ceil(moments).astype(int) - 1, 0)]
    pictures = see(shown, tilted, edges_per_m, hidden)
    pictures[:, 0] = seen
    return pictures
