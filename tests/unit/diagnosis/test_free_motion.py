"""Runs that start in motion are predicted in short windows with individual start states."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irt.diagnosis.dataset import Dataset
from irt.engine import rollouts
from irt.recording import Recording
from irt.rig import Board, Marble, Rig

#: A plate seen at 5 Hz, whose ball goes fast: its speed estimated from the first rows is inaccurate.
TRUTH = (0.9, 0.95, 2e-3, 48.0, 1.0)
RANGES = {
    "gear_x": (0.2, 2.0),
    "gear_y": (0.2, 2.0),
    "rolling_friction": (0.0, 0.02),
    "time_scale": (24.0, 72.0),
    "observation_scale": (0.8, 1.2),
}
BOARD = Board(edge_x_m=2.0, edge_y_m=2.0)
LATE = {"name": "delay", "delay_s": 0.15}


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    recordings = []
    for index in range(3):
        random = np.random.default_rng(index)
        time = 0.2 * np.arange(104)[:, None, None]
        waves = np.sin(2.0 * np.pi * (time * random.uniform(0.3, 0.9, (2, 3)) + random.random((2, 3))))
        knobs = 0.05 * waves.sum(axis=2)
        rig = Rig(Path("rig"), BOARD, Marble(), "moving", RANGES, ())
        marble = rollouts([TRUTH], knobs, rig=rig, effects=[LATE])[0]
        marble = marble + 0.001 * random.standard_normal(marble.shape)
        stamps = 0.2 * np.arange(len(knobs))
        path = Path(f"run-{index}.csv")
        recordings.append(Recording(f"run-{index}", path, knobs[20:], marble[20:], stamps[20:]))
    dataset = Dataset.of(Rig(Path("rig"), BOARD, Marble(), "moving", RANGES, tuple(recordings)))
    return replace(dataset, segments=tuple(segment.cut(0, 10) for segment in dataset.segments))


def loss(dataset: Dataset, effects: tuple[str, ...], values: np.ndarray, iterations: int) -> float:
    """Return the loss after a descent from these values, as counted by least squares [nats]."""
    (found,) = dataset.problem(effects).refine(values[None], iterations=iterations)
    residuals = np.concatenate([one.ravel() for one in found.residuals])
    return float(2.5 * np.log1p((residuals / dataset.noise) ** 2 / 4.0).sum())


def test_a_descent_from_the_best_fit_stays_there(dataset: Dataset) -> None:
    best = dataset.fit(starts=8)
    begun, again = (loss(dataset, (), best.values, iterations) for iterations in (0, 12))
    assert again < begun + 3.0


def test_what_holds_the_truth_fits_better_than_what_lacks_it(dataset: Dataset) -> None:
    best = dataset.fit(starts=8)
    late = loss(dataset, ("delay",), np.append(best.values, 0.005), 40)
    assert late < loss(dataset, (), best.values, 12) - 100.0
    (found,) = dataset.problem(("delay",)).refine(np.append(best.values, 0.005)[None], iterations=40)
    assert found.values[-1] == pytest.approx(0.15, abs=0.03)
