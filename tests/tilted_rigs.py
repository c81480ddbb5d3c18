"""Rigs with a measured tilt, simulated from planted values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from irt.engine import rollouts
from irt.recording import Recording
from irt.rig import Board, Marble, Rig

#: gear_x, gear_y, rolling_friction, time_scale, observation_scale; rows last time_scale / 240 s.
VALUES = (0.9, 1.1, 0.004, 8.0, 1.0)
ROW_S = VALUES[3] / 240.0
ZERO = (-0.02, 0.03)
SENSOR = {"name": "tilt_sensor", "zero_x_rad": ZERO[0], "zero_y_rad": ZERO[1]}
TILT_NOISE_RAD, TRACKER_NOISE = 0.001, 0.0005
RANGES = {
    "gear_x": (0.3, 2.0),
    "gear_y": (0.3, 2.0),
    "rolling_friction": (0.0, 0.02),
    "time_scale": (6.0, 10.0),
    "observation_scale": (0.9, 1.1),
}


def drive(rows: int, seed: int) -> np.ndarray:
    """Commands (rows, 2) [rad] that step at random and are held for a while."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.03, (rows // 8 + 1, 2))
    return np.repeat(steps, 8, axis=0)[:rows]


def tilted_recordings(
    effects: Sequence[Mapping[str, Any]] = (), *, runs: int = 4, rows: int = 150, seed: int = 0
) -> list[Recording]:
    """Return runs of a rig in motion with these effects, stamped, with noise on marble and tilt."""
    rng = np.random.default_rng(seed)
    found = []
    for run in range(runs):
        knobs = drive(rows, 100 * seed + run)
        marble, tilt = rollouts(
            [VALUES],
            knobs,
            effects=[*effects, SENSOR],
            start=rng.uniform(-0.2, 0.2, 2),
            knobs_before=knobs[0],
            durations=np.full(rows, ROW_S),
            tilt=True,
        )
        found.append(
            Recording(
                f"run-{run + 1}",
                Path(f"run-{run + 1}.csv"),
                knobs,
                marble[0] + rng.normal(0.0, TRACKER_NOISE, (rows, 2)),
                ROW_S * np.arange(rows),
                tilt[0] + rng.normal(0.0, TILT_NOISE_RAD, (rows, 2)),
            )
        )
    return found


def rig_of(recordings: Sequence[Recording]) -> Rig:
    """Return the rig of recordings in motion."""
    return Rig(Path("rig"), Board(), Marble(), "moving", dict(RANGES), tuple(recordings))
