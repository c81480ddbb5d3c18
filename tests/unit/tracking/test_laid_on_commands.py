"""A track is laid on the commands that were played."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from irt.errors import IrtError
from irt.recording import Commands
from irt.tracking.recorded import laid_on
from irt.tracking.run import Scene, Track

PICTURES = 110


def track(times: int = 1) -> Track:
    """Return a marble that moves along x by a hundredth of an edge a picture, at 30 pictures a second.

    Each picture is shown so many times, the repeats without a place.
    """
    count = times * PICTURES
    repeated = np.arange(count) % times != 0
    marble = np.column_stack([0.01 * np.arange(count) / times, np.zeros(count)])
    marble[repeated] = np.nan
    return Track(
        "run-1",
        cast(Scene, SimpleNamespace(tilt_noise=None)),
        np.arange(count) / (30.0 * times),
        300.0 * marble,
        marble,
        np.ones(count),
        repeated,
        np.ones(count, dtype=bool),
        np.full((count, 2), np.nan),
        (),
    )


@pytest.mark.parametrize(("rows", "is_right"), [(PICTURES, True), (50, False)])
def test_commands_without_stamps_are_one_for_each_picture(rows, is_right):
    commands = Commands(np.zeros((rows, 2)), None, None)
    if is_right:
        found = laid_on(track(), commands, Path("run-1.csv"))
        np.testing.assert_allclose(found.recording.marble, track().marble)
    else:
        with pytest.raises(IrtError, match="50 commands without stamps, but 110 pictures"):
            laid_on(track(), commands, Path("run-1.csv"))


@pytest.mark.parametrize("times", [1, 2, 3])
def test_a_command_between_two_pictures_has_the_place_between(times):
    """Of pictures that are shown twice or three times, only the new ones count."""
    # Issued a quarter of a picture late, from 10 pictures before the first to 10 after the last.
    stamps = (np.arange(PICTURES + 20) - 9.75) / 30.0
    found = laid_on(
        track(times), Commands(np.zeros((len(stamps), 2)), None, 100.0 + stamps), Path("a.csv"), -100.0
    )
    np.testing.assert_allclose(
        found.recording.marble[:, 0], 0.01 * (np.arange(PICTURES - 1) + 0.25), atol=1e-9
    )
    np.testing.assert_allclose(found.recording.stamps, stamps[10:-11], atol=1e-9)
