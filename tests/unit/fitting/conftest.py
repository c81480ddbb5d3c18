"""What the tests of fitting share: recordings of a planted truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from irt.engine import SUBSTEP_S, rollouts
from irt.recording import Recording
from irt.rig import RANGES, Board, Marble, Rig

TRUTH = np.array([0.06, 0.05, 0.0004, 20.0, 1.05])


@pytest.fixture
def planted(wave: np.ndarray) -> Callable[..., Rig]:
    """Return a rig whose recordings, 40 rows each, the engine made from `TRUTH`."""

    def plant(
        runs: int = 2,
        *,
        noise: float = 0.0,
        stamped: bool = False,
        moving: bool = False,
        truth: np.ndarray = TRUTH,
        effects: Sequence[dict[str, float | str]] = (),
    ) -> Rig:
        random = np.random.default_rng(runs)
        recordings = []
        for run in range(runs):
            knobs = np.roll(wave, 7 * run, axis=0) * (1.0 - 0.2 * run)
            start, velocity = random.uniform(-0.1, 0.1, 2), moving * random.uniform(-0.05, 0.05, 2)
            begun = {"start": start, "start_velocity": velocity}
            marble = rollouts([truth], knobs, effects=effects, **begun)[0]
            marble += noise * random.standard_normal(marble.shape)
            stamps = truth[3] * SUBSTEP_S * np.arange(len(knobs)) if stamped else None
            recordings.append(Recording(f"run-{run}", Path(f"run-{run}.csv"), knobs, marble, stamps))
        start_of_all = "moving" if moving else "rest"
        return Rig(Path("rig"), Board(), Marble(), start_of_all, dict(RANGES), tuple(recordings))

    return plant
