"""Commands that set the rate of the tilt are met before a fit; those that set the tilt are not."""

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
@pytest.mark.parametrize("seed", [8, 12])
def test_rates_are_met(seed: int, stamped: bool) -> None:
    found = irt.check(rig_of(truth_of(seed, motors=True), stamped=stamped))
    (one,) = [each for each in found.findings if "they set the tilt's rate" in each.what]
    assert one.severity == "error"
    assert "import" in one.advice


def test_rates_are_met_by_the_marble_alone() -> None:
    random = np.random.default_rng(3)
    rows, row_s = np.arange(500), 0.02
    recordings = []
    for number in range(8):
        speeds, angles = np.zeros((500, 2)), np.zeros((500, 2))
        for row in rows[1:]:
            speeds[row] = speeds[row - 1]
            if row % 10 == 0:
                speeds[row] = 0.5 * random.normal(size=2) - 2.0 * angles[row - 1]
            angles[row] = angles[row - 1] + row_s * speeds[row]
        (path,) = irt.rollouts([[0.5, 0.5, 6e-4, 240.0 * row_s, 1.0]], angles)
        marble = path + random.normal(0.0, 0.0002, path.shape)
        name = f"run-{number}"
        recordings.append(Recording.from_arrays(commands=speeds, marble=marble, t=row_s * rows, name=name))
    found = irt.check(Rig.from_recordings(recordings))
    (one,) = [each for each in found.findings if "they set the tilt's rate" in each.what]
    assert one.severity == "error"
    assert "record the board's tilt as well" in one.advice


@pytest.mark.parametrize("kind", ["waves", "steps"])
@pytest.mark.parametrize("lag_s", [0.05, 0.3, 1.0, 2.0])
def test_a_long_lag_is_no_rate(lag_s: float, kind: str) -> None:
    random = np.random.default_rng(3)
    rows, row_s = np.arange(160), 0.05
    recordings = []
    for _ in range(4):
        phases, periods = random.uniform(0.0, 6.0, 2), random.uniform(0.7, 8.0, 2)
        knobs = 0.12 * np.sin(2.0 * np.pi * row_s * rows[:, None] / periods + phases)
        if kind == "steps":
            knobs = np.repeat(random.uniform(-0.12, 0.12, (20, 2)), 8, axis=0)
        lag = [{"name": "lag", "time_constant_s": lag_s}]
        (path,) = irt.rollouts([[0.07, 0.06, 6e-4, 240.0 * row_s, 1.0]], knobs, effects=lag)
        marble = path + random.normal(0.0, 0.001, path.shape)
        name = f"run-{len(recordings)}"
        recordings.append(Recording.from_arrays(commands=knobs, marble=marble, t=row_s * rows, name=name))
    found = irt.check(Rig.from_recordings(recordings))
    assert not [each for each in found.findings if "they set the tilt's rate" in each.what]


@pytest.mark.parametrize("seed", [2, 3, 7])
def test_angles_are_not(seed: int) -> None:
    found = irt.check(rig_of(truth_of(seed, motors=False)))
    assert not [each for each in found.findings if "they set the tilt's rate" in each.what]


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
    assert "they set the tilt's rate" not in checked.out
