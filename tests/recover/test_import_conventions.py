"""Plant a convention in a lab's log, import it, and find axes, signs, units and clocks as they were planted.

``IRT_DRAWS=100 python -m pytest tests/recover/test_import_conventions.py`` draws a hundred of each format.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import lab_logs
from irt.importing.logs import Summary, import_logs
from irt.recording import load_recording
from irt.rig import Board, load_rig
from lab_logs import PLAIN, Convention, Truth, draw_convention, simulate

#: Clocks are to be found within this [s].
CLOCK_S = 0.005
#: One of each format for a quick look.
DRAWS = [
    pytest.param(seed, marks=[pytest.mark.slow] if seed else [])
    for seed in range(int(os.environ.get("IRT_DRAWS", "4")))
]


def check_recordings(summary: Summary, truth: Truth, convention: Convention, edge: float) -> None:
    """Compare what was written with the truth in the frame of the logged marble, row by row."""
    expected_tilt = convention.expected_tilt(truth)
    expected_marble = convention.marble(truth) / edge
    # Rows by their stamps: runs begin where the log does, or after a gap.
    stamps = truth.stamps
    begin = 0
    for recording in (load_recording(one.path) for one in summary.recordings):
        seen = np.flatnonzero(recording.seen)
        row = begin + int(np.argmin(np.abs(expected_marble[begin:] - recording.marble[seen[0]]).sum(axis=1)))
        row -= int(seen[0])
        rows = slice(row, row + len(recording.marble))
        begin = row
        assert np.allclose(np.diff(stamps[rows]), np.diff(recording.stamps), atol=2e-6)
        assert np.allclose(recording.marble[seen], expected_marble[rows][seen], atol=1e-9)
        assert recording.tilt is not None
        known = np.isfinite(recording.tilt)
        assert known.mean() > 0.9
        # Interpolated by a clock that is known within 5 ms, a tilt of up to 0.4 rad/s is within 2 mrad.
        exact = 1e-9 if summary.tilt_offset is None else 0.004
        assert np.quantile(np.abs(recording.tilt - expected_tilt[rows])[known], 0.99) < exact
        held = truth.held[rows]
        assert not recording.seen[held].any()


def check_axes(summary: Summary, truth: Truth, convention: Convention) -> None:
    gear = convention.expected_gear(truth)
    size = np.abs(gear).max()
    found = summary.command_map
    assert found is not None
    # The fitted matrix in our axes against the planted one.
    ours = found.gains[list(summary.tilt.order)] * np.array(summary.tilt.signs)[:, None]
    assert np.abs(ours - gear).max() < 0.03 * size
    mixed = bool((np.abs(gear) > 0.5 * size).all())
    assert summary.matrix == mixed
    main = [gear[axis, summary.commands.order[axis]] for axis in (0, 1)]
    assert np.allclose(summary.commands.gains, main, rtol=0.05, atol=0.03 * size)
    if not mixed:
        assert abs(main[0] * main[1]) > 0.2 * size**2
    assert summary.tilt.sure == ("surely", "surely")
    rig = load_rig(summary.recordings[0].path.parent)
    assert rig.commands.matrix == mixed
    for name, value in zip(("gear_x", "gear_y"), main, strict=True):
        low, high = rig.ranges[name]
        assert low < value < high


def dead_times(summary: Summary) -> np.ndarray:
    assert summary.command_map is not None
    return summary.command_map.delay


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("seed", DRAWS)
def test_a_cyberrunner_bag(tmp_path: Path, seed: int, storage: str) -> None:
    rng = np.random.default_rng(seed)
    truth, convention = simulate(rng, unit=1000.0), draw_convention(rng)
    bag = lab_logs.write_bag(
        tmp_path / "bag", truth, convention, storage=storage, command_offset=convention.offset
    )
    summary = import_logs([bag], tmp_path / "rig", "cyberrunner")
    check_axes(summary, truth, convention)
    # States and commands have moments of receipt only: their clocks and the dead time add up.
    assert np.abs(dead_times(summary) - (truth.delay - convention.offset)).max() < CLOCK_S
    # Commands that come after their effect are moved to a dead time of zero.
    late = truth.delay - convention.offset
    assert summary.command_shift == pytest.approx(min(late, 0.0), abs=CLOCK_S)
    check_recordings(summary, truth, convention, 0.276)


@pytest.mark.parametrize("seed", DRAWS)
def test_a_bag_whose_headers_are_of_another_clock(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, convention = simulate(rng, unit=300.0), draw_convention(rng)
    offset = convention.offset + np.sign(convention.offset)
    bag = lab_logs.write_bag(
        tmp_path / "bag",
        truth,
        convention,
        package="tag_interfaces",
        command="HiwonderVel",
        topics=("/tag_state_estimation/estimate", "/tag_hiwonder/cmd"),
        header_offset=offset,
    )
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "rig.toml").write_text(
        '[board]\nedge_x_m = 0.276\nedge_y_m = 0.231\n[commands]\nunit = "servo"\n'
    )
    summary = import_logs([bag], tmp_path / "rig", "tag")
    note = next(note for note in summary.logs[0].notes if "another clock" in note)
    assert float(note.split("clock: ")[1].split(" ")[0]) == pytest.approx(-offset, abs=CLOCK_S)
    # Corrected by that, the dead time alone remains.
    assert np.abs(dead_times(summary) - truth.delay).max() < CLOCK_S


@pytest.mark.parametrize("seed", DRAWS)
def test_a_tag_folder(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    board = Board(0.259, 0.229, wall_restitution=0.3)
    truth, convention = simulate(rng, unit=300.0, rate=30.0, board=board), draw_convention(rng)
    folder = lab_logs.write_tag_folder(tmp_path / "session", truth, convention)
    summary = import_logs([folder], tmp_path / "rig", "tag")
    check_axes(summary, truth, convention)
    # Both files share the monotonic clock: the dead time is the actuator's alone.
    assert np.abs(dead_times(summary) - truth.delay).max() < CLOCK_S
    if abs(convention.offset) > CLOCK_S:
        note = next(note for note in summary.logs[0].notes if "ROS clock" in note)
        assert float(note.split("is ")[1].split(" ")[0]) == pytest.approx(convention.offset, abs=CLOCK_S)
    check_recordings(summary, truth, convention, 0.259)


@pytest.mark.parametrize("seed", DRAWS)
def test_a_plain_csv(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, convention = simulate(rng, by_rows=True), draw_convention(rng)
    log = lab_logs.write_plain_csv(tmp_path / "log.csv", truth, convention)
    summary = import_logs([log], tmp_path / "rig", "csv", mapping=PLAIN)
    check_axes(summary, truth, convention)
    # Tilt and marble are of two clocks, which the marble's acceleration brings together.
    assert summary.tilt_offset == pytest.approx(-convention.offset, abs=CLOCK_S)
    assert np.abs(dead_times(summary) - truth.delay).max() < 2.0 * CLOCK_S
    check_recordings(summary, truth, convention, 0.276)
