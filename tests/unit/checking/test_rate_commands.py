"""Commands that set the rate of a measured tilt are met before a fit; those that set the tilt are not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irt
from irt.recording import CMD, Recording, save_recording
from irt.rig import Board, Commands, Rig
from lab_logs import Truth, simulate

BOARD = Board(wall_restitution=0.3)


def rig_of(truth: Truth, *, stamped: bool = True) -> Rig:
    recording = Recording.from_arrays(
        commands=truth.commands,
        marble=truth.marble_m / BOARD.edge_x_m,
        tilt=truth.tilt,
        t=truth.stamps - truth.stamps[0] if stamped else None,
        columns=CMD,
    )
    ranges = dict.fromkeys(("gear_x", "gear_y"), (-5.0, 5.0)) | {"time_scale": (3.0, 6.0)}
    commands = Commands("action", True)
    return Rig.from_recordings([recording], board=BOARD, start="moving", ranges=ranges, commands=commands)


def truth_of(seed: int, *, motors: bool) -> Truth:
    random = np.random.default_rng(seed)
    return simulate(random, seconds=25.0, unit=1.0, by_rows=True, motors=motors, spoil=False, jitter=0.0)


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("seed", [2, 11])
def test_rates_are_met(seed: int, stamped: bool) -> None:
    found = irt.check(rig_of(truth_of(seed, motors=True), stamped=stamped))
    (one,) = [each for each in found.findings if "they set its rate" in each.what]
    assert one.severity == "warning"
    assert "import" in one.advice


@pytest.mark.parametrize("seed", [2, 3, 7])
def test_angles_are_not(seed: int) -> None:
    found = irt.check(rig_of(truth_of(seed, motors=False)))
    assert not [each for each in found.findings if "they set its rate" in each.what]


def test_the_advice_works(tmp_path: Path, irt: Callable[..., Any]) -> None:
    (recording,) = rig_of(truth_of(7, motors=True)).recordings
    arrays = (recording.knobs, recording.marble, recording.stamps)
    save_recording(tmp_path / "run.csv", *arrays, tilt=recording.tilt, columns=CMD)
    names = ("t_s", *CMD, "marble_x", "marble_y", "tilt_x_rad", "tilt_y_rad")
    words = [word for name in names for word in ("--map", f"{name}={name}")]
    done = irt("import", tmp_path / "run.csv", "--from", "csv", *words, "--out", tmp_path / "rig")
    assert done.status == 0, done.err
    assert "written as the command" in done.out
    checked = irt("check", tmp_path / "rig")
    assert "they set its rate" not in checked.out
