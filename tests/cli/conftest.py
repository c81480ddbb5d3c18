"""A run of a rig with backlash, filmed once for the tests of `irt track`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def filmed(tmp_path_factory: pytest.TempPathFactory):
    """Return a folder of 110 pictures, the commands (110, 2) [rad], and the scene with its truth."""
    from filmed_runs import BACKLASH, film, played  # noqa: PLC0415  # not every test here needs OpenCV

    folder: Path = tmp_path_factory.mktemp("filmed") / "run-1"
    knobs, places, tilts = played(110, 3, BACKLASH)
    scene = film(folder, tilts, places)
    # Tests share them.
    knobs.setflags(write=False)
    return folder, np.asarray(knobs), scene
