"""Datasets with planted effects."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irt.diagnosis.dataset import Dataset
from irt.engine import SUBSTEP_S, rollouts
from irt.recording import Recording
from irt.rig import RANGES, Board, Marble, Rig

TRUTH = (0.06, 0.05, 4e-4, 15.0, 1.03)
NOISE = 1e-3

Plant = Callable[..., Dataset]


@pytest.fixture(scope="session")
def plant() -> Plant:
    """Return a function that makes a dataset of runs with planted effects, driven by sums of sinusoids.

    With `pushed`, the knobs deviate from the recorded commands by a random angle in each row, given as a
    share of the largest command.
    """

    def planted(
        effects: Sequence[Mapping[str, Any]] = (),
        *,
        runs: int = 4,
        rows: int = 80,
        seed: int = 0,
        stamped: bool = False,
        pushed: float = 0.0,
        **dataset: Any,
    ) -> Dataset:
        random, chance = np.random.default_rng(seed), np.random.default_rng([seed, 1])
        stamps = TRUTH[3] * SUBSTEP_S * np.arange(rows) if stamped else None
        recordings = []
        for index in range(runs):
            time = np.arange(rows)[:, None, None] / rows
            waves = np.sin(2 * np.pi * (time * random.uniform(0.7, 5.0, (2, 3)) + random.random((2, 3))))
            knobs = (waves * random.uniform(0.01, 0.05, (2, 3))).sum(axis=2)
            done = knobs + pushed * np.abs(knobs).max() * chance.standard_normal(knobs.shape)
            start = random.uniform(-0.1, 0.1, 2)
            marble = rollouts([TRUTH], done, effects=effects, start=start, seed=[1000 * seed + index])[0]
            marble = marble + NOISE * random.standard_normal(marble.shape)
            recordings.append(Recording(f"run-{index}", Path(f"run-{index}.csv"), knobs, marble, stamps))
        rig = Rig(Path("rig"), Board(), Marble(), "rest", dict(RANGES), tuple(recordings))
        return Dataset.of(rig, **dataset)

    return planted


@pytest.fixture(scope="session")
def in_motion() -> Callable[[Dataset, int], Dataset]:
    """Return a function that cuts off the first rows of a dataset, so that its recordings begin in motion."""

    def cut(planted: Dataset, gone: int) -> Dataset:
        recordings = tuple(
            replace(one, knobs=one.knobs[gone:], marble=one.marble[gone:], stamps=one.stamps[gone:])
            for one in planted.rig.recordings
        )
        return Dataset.of(replace(planted.rig, start="moving", recordings=recordings))

    return cut
