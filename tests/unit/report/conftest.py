"""One made-up recording, fit and pair of predictions for all tests of pictures and pages."""

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_up import make_diagnosis, sample_rig

from irt.fitting.fit import Estimate, FitResult, Iteration
from irt.maze import Maze
from irt.model import Model
from irt.recording import Recording
from irt.report import style
from irt.report.diagnosis_report import write_diagnosis_report
from irt.report.plots import Prediction
from irt.rig import RANGES, Board, Marble, Rig

ROWS = 40
TRUE = np.array([0.04, 0.06, 4e-4, 16.0, 1.05])
LOST = (7, 8, 9, 20)


def make_recording(name):
    phase = 2 * np.pi * np.arange(ROWS) / ROWS
    marble = 0.3 * np.stack([1 - np.cos(phase), -np.sin(phase)], axis=1)
    marble[list(LOST)] = np.nan
    # Tests share it.
    marble.setflags(write=False)
    return Recording(name, Path(f"{name}.csv"), np.zeros((ROWS, 2)), marble)


@pytest.fixture(scope="session")
def recording():
    return make_recording("run-1")


@pytest.fixture(scope="session")
def rig(recording):
    return Rig(Path("rig"), Board(), Marble(), "rest", dict(RANGES), (recording, make_recording("run-2")))


@pytest.fixture(scope="session")
def result(rig):
    """Two starts; the winner's best iteration is not its last."""

    def estimate(*errors):
        return Estimate(tuple(Iteration(TRUE * (1 + error), error) for error in errors))

    estimates = (estimate(0.2, 0.01, 0.02), estimate(0.3, 0.05))
    model = Model.from_rig(rig, TRUE, intervals=np.stack([0.98 * TRUE, 1.02 * TRUE], axis=1))
    return FitResult("irt", model, 0.002, estimates, 10, ("gears & time: <one> number",), (), 0, 1.5)


@pytest.fixture(scope="session")
def predictions(recording, result):
    filled = np.nan_to_num(recording.marble)
    return [
        Prediction("untuned", 1.5 * filled, result.model, style.UNTUNED),
        Prediction("tuned", filled, result.model),
    ]


@pytest.fixture
def drawn(monkeypatch):
    """The figure that was drawn last, as `drawn.figure`, while files are written as ever."""
    last = SimpleNamespace(figure=None)
    drawing = style.drawing

    @contextmanager
    def spy(*args) -> Iterator:
        with drawing(*args) as last.figure:
            yield last.figure

    monkeypatch.setattr(style, "drawing", spy)
    return last


@pytest.fixture(scope="session")
def labyrinth():
    return sample_rig()


@pytest.fixture(scope="session")
def diagnosis_of(labyrinth):
    """A made-up diagnosis of the sample rig, by its verdict."""
    return functools.cache(lambda verdict: make_diagnosis(labyrinth, verdict))


@pytest.fixture(scope="session")
def reports(tmp_path_factory, labyrinth, diagnosis_of):
    """The page of each verdict, its pictures beside it; that of `unlisted` has a wall and a hole."""
    folder = tmp_path_factory.mktemp("reports")
    found = {verdict: diagnosis_of(verdict) for verdict in ("sufficient", "missing", "unlisted")}
    maze = Maze(walls=((-0.05, 0.02, 0.03, 0.06),), holes=((0.1, -0.04),))
    found["unlisted"] = replace(found["unlisted"], model=replace(found["unlisted"].model, maze=maze))
    return {
        verdict: write_diagnosis_report(folder / verdict, labyrinth, diagnosis)
        for verdict, diagnosis in found.items()
    }
