"""What the tests of tuning share: small drives, and recipes that take no time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from irt.rig import RANGES, Board, Marble
from irt.tuning.drive import Drive, Run
from irt.tuning.recipes import Recipe


@pytest.fixture
def small_drive(wave: np.ndarray) -> Drive:
    """Two runs of different length, from rest."""
    runs = (
        Run(wave, None, np.zeros(2), np.zeros(2)),
        Run(wave[:25, ::-1], None, np.array([0.1, -0.1]), np.zeros(2)),
    )
    return Drive(runs, Board(), Marble(), dict(RANGES), "rest", "rolling", rows_per_input=5)


@pytest.fixture
def stamped_drive(wave: np.ndarray) -> Drive:
    """One stamped run that starts in motion."""
    run = Run(wave, np.full(40, 0.05), np.array([0.1, 0.0]), np.array([-0.05, 0.02]))
    return Drive((run,), Board(), Marble(), dict(RANGES), "moving", "rolling", time_scale=12.0)


@pytest.fixture
def recipe() -> Callable[..., Recipe]:
    """Return a recipe that trains within a second."""

    def make(**changes: object) -> Recipe:
        return Recipe(**{"pairs": 60, "epochs": 12, "batch": 20, **changes})  # type: ignore[arg-type]

    return make
