"""Rigs whose recordings are simulated with a known truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irt.engine import rollouts
from irt.recording import Recording
from irt.rig import Rig
from simulated_rigs import NOISE, STEP_S, TRUTH, drive, rig_of

MakeRig = Callable[..., Rig]


@pytest.fixture
def make_rig() -> MakeRig:
    """Simulate a rig whose tracker has white noise."""

    def make(
        runs: int = 4,
        rows: int = 120,
        *,
        stamped: bool = True,
        noise: float = NOISE,
        amplitude: float = 0.08,
        effects: Sequence[Mapping[str, Any]] = (),
        **fields,
    ) -> Rig:
        random = np.random.default_rng(0)
        recordings = []
        for number in range(runs):
            knobs = drive(rows, number, amplitude)
            marble = rollouts(TRUTH, knobs, effects=effects, time_step="continuous")[0]
            marble = marble + noise * random.standard_normal(marble.shape)
            stamps = STEP_S * np.arange(rows) if stamped else None
            recordings.append(
                Recording(f"run-{number + 1}", Path(f"run-{number + 1}.csv"), knobs, marble, stamps)
            )
        return rig_of(recordings, **fields)

    return make
