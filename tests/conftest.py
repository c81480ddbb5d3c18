"""Fixtures of all tests."""

from __future__ import annotations

import os

# Before numpy and torch are imported: threads of their matrix libraries wait for each other longer than such
# matrices take, and beside a second worker up to twenty times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import gc
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import ArrayLike

from irt.cli.__main__ import main
from irt.recording import save_recording

# The workers of a run share the cores: more threads of the engine and of OpenCV only wait for each other.
_THREADS = max(1, (os.cpu_count() or 1) // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
os.environ.setdefault("RAYON_NUM_THREADS", str(_THREADS))
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", str(_THREADS))

# A shell ignores SIGINT in what it starts in the background, and so would the programs that tests send it to.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# A busy machine exceeds any deadline. `make test` names the profile ci, with twice as many examples.
settings.register_profile("quick", deadline=None, max_examples=50)
settings.load_profile("quick")

ROOT = Path(__file__).resolve().parents[1]

#: Called with recordings by name, each (knobs, marble) or (knobs, marble, stamps), and the text of rig.toml.
WriteRig = Callable[..., Path]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without looking for cycles, and never look through modules again, which stay to the end.

    With torch, matplotlib and all tests in memory, looking through everything takes a quarter of a second.
    Modules and shared results that come later stay as well: cycles are looked for a tenth as often as usual.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(10 * gc.get_threshold()[0])
        gc.enable()


class Outcome(NamedTuple):
    """What a command line did."""

    status: int
    out: str
    err: str


@pytest.fixture
def write_rig(tmp_path: Path) -> WriteRig:
    """Write a small rig from arrays and return its folder."""

    def write(
        recordings: Mapping[str, Sequence[ArrayLike]], toml: str | None = None, folder: str = "rig"
    ) -> Path:
        path = tmp_path / folder
        path.mkdir()
        for name, arrays in recordings.items():
            save_recording(path / f"{name}.csv", *arrays)
        if toml is not None:
            (path / "rig.toml").write_text(toml)
        return path

    return write


@pytest.fixture
def wave() -> np.ndarray:
    """Knob angles, (40, 2) [rad], that move the marble about without taking it far from the centre."""
    phase = 2.0 * np.pi * np.arange(40)[:, None] / np.array([20.0, 13.0])
    return 0.05 * np.sin(phase)


@pytest.fixture
def shared() -> Path:
    """Return the folder of data that lies beside the checkout."""
    path = ROOT.parent / "shared"
    if not path.is_dir():
        pytest.skip(f"the shared data are not beside this checkout (no folder {path.name} there)")
    return path


@pytest.fixture
def irt(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run a command line in this process and return its exit status and what it printed."""

    def run(*words: str | Path) -> Outcome:
        try:
            status = main([str(word) for word in words])
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        return Outcome(status, *capsys.readouterr())

    return run
