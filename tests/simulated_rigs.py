"""Rigs whose recordings are simulated with a known truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from irt.rig import RANGES, Board, Marble, Rig

#: gear_x, gear_y, rolling_friction, time_scale (12.5 rows a second), observation_scale.
TRUTH = np.array([[0.07, 0.05, 3e-4, 19.2, 1.0]])
STEP_S = 0.08
NOISE = 0.001


def drive(rows: int, seed: int, amplitude: float = 0.08) -> np.ndarray:
    """Return knobs, (rows, 2) [rad], of four sines each."""
    random = np.random.default_rng(seed)
    time = np.arange(rows)[:, None]
    sines = [
        np.sin(2.0 * np.pi * time * random.uniform(0.01, 0.06, (1, 2)) + random.uniform(0.0, 6.3, (1, 2)))
        for _ in range(4)
    ]
    return np.asarray(amplitude * sum(sines) / 2.0)


def rig_of(recordings, **fields) -> Rig:
    """Return a rig of recordings: the paper's, but for what is given."""
    return Rig(
        **{
            "path": Path("rig"),
            "board": Board(),
            "marble": Marble(),
            "start": "rest",
            "ranges": dict(RANGES),
            "recordings": tuple(recordings),
            **fields,
        }
    )
