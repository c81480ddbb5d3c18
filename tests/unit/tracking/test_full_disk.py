"""Videos and positions that do not fit on the disk are no results."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from irt.errors import IrtError
from irt.tracking.overlay import Overlay
from irt.tracking.partial import Partial
from irt.tracking.source import Frame
from irt.tracking.tracker import Sighting

SCENE = SimpleNamespace(
    corners=np.array([[5.0, 5.0], [59.0, 5.0], [59.0, 43.0], [5.0, 43.0]]),
    learned=SimpleNamespace(radius=4.0),
)


@contextmanager
def largest(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size, as on a full disk [bytes]."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def drawn(path: Path, pictures: int = 40) -> Overlay:
    """Return an overlay of noise, which needs some kB a picture."""
    random = np.random.default_rng(0)
    overlay = Overlay(path, SCENE, 30.0)
    for index in range(pictures):
        picture = random.integers(0, 256, (48, 64, 3), dtype=np.uint8)
        overlay.add(Frame(index / 30.0, picture, 0.0), Sighting(20.0 + index / 2, 20.0, 1.0, True))
    return overlay


def test_a_video_that_is_complete_is_taken(tmp_path: Path) -> None:
    drawn(tmp_path / "seen.mp4").finish()


def test_a_video_that_did_not_fit_was_taken_for_complete(tmp_path: Path) -> None:
    with largest(8000):
        overlay = drawn(tmp_path / "seen.mp4")
        with pytest.raises(IrtError, match="of 40 pictures are in it; is the disk full"):
            overlay.finish()


def noted(path: Path) -> None:
    with Partial(path) as rows:
        for index in range(5000):
            rows.add(index / 30.0, np.array([0.1, 0.2]), 1.0)


def test_positions_that_do_not_fit_are_one_line_with_the_name_of_their_file(tmp_path: Path) -> None:
    path = tmp_path / "run.partial"
    with largest(2000), pytest.raises(IrtError, match=r"run\.partial: cannot be written"):
        noted(path)
    assert path.stat().st_size == 2000
