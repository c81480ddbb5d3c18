"""Bags whose truth is known become recordings that hold it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from irt.cli.__main__ import main
from irt.errors import IrtError
from irt.importing import import_bags
from irt.recording import load_recording
from irt.rig import load_rig
from rig_bags import JOINT_AGE, TRACKER_AGE, Bag, knobs, marble, recorded


def test_rows_hold_the_positions_and_the_angles_of_their_time(tmp_path: Path) -> None:
    (one,) = import_bags([recorded(tmp_path / "bag.mcap")], tmp_path / "rig")
    rig = load_rig(tmp_path / "rig")
    (recording,) = rig.recordings
    assert rig.board.edge_x_m == 0.3
    assert recording.name == "drive"
    assert recording.stamps is not None
    assert np.allclose(recording.stamps, 0.1 * np.arange(20), atol=1e-6)
    times = 1.0 + recording.stamps
    assert np.allclose(recording.marble, [marble(t) for t in times], atol=2e-5)
    fine = np.linspace(0.0, 0.1, 201)[:-1] + 0.00025
    means = [np.mean([knobs(t + part - 0.05) for part in fine], axis=0) for t in times]
    assert np.allclose(recording.knobs, means, atol=2e-5)
    assert (one.rows, one.missing, one.knobs) == (20, 0, "measured")
    assert one.tracker_hz == pytest.approx(60.0, abs=1.0)
    assert one.tracker_age_s == pytest.approx(TRACKER_AGE, abs=1e-6)
    assert one.joint_age_s == pytest.approx(JOINT_AGE, abs=1e-6)
    assert one.lag_s == pytest.approx(0.05, abs=0.006)


def test_commanded_angles_are_taken_where_joints_are_not_heard_or_not_wanted(tmp_path: Path) -> None:
    silent = recorded(tmp_path / "silent.mcap", joints=False)
    heard = recorded(tmp_path / "heard.mcap")
    found = [import_bags([silent], tmp_path / "a"), import_bags([heard], tmp_path / "b", knobs="commanded")]
    assert [one.knobs for (one,) in found] == ["commanded", "commanded"]
    both = [load_recording(one.path).knobs for (one,) in found]
    assert np.array_equal(*both)
    assert np.allclose(both[0][:, 0], [knobs(1.045 + 0.1 * row)[0] for row in range(20)], atol=1e-3)
    with pytest.raises(IrtError, match="--knobs commanded"):
        import_bags([silent], tmp_path / "c", knobs="measured")


def test_missing_points_leave_rows_empty(tmp_path: Path) -> None:
    (one,) = import_bags([recorded(tmp_path / "bag.mcap", lost=(1.35, 1.75))], tmp_path / "rig")
    lost = np.isnan(load_recording(one.path).marble[:, 0])
    assert np.flatnonzero(lost).tolist() == [4, 5, 6, 7]
    assert one.missing == 4


def test_a_marble_that_is_lost_as_the_run_begins_is_where_it_lay(tmp_path: Path) -> None:
    (one,) = import_bags([recorded(tmp_path / "bag.mcap", lost=(0.9, 1.25))], tmp_path / "rig")
    assert np.allclose(load_recording(one.path).marble[0], marble(53 / 60.0), atol=1e-9)
    with pytest.raises(IrtError, match="did not see the marble"):
        import_bags([recorded(tmp_path / "never.mcap", lost=(-1.0, 1.25))], tmp_path / "other")


def test_a_run_that_was_stopped_ends_there(tmp_path: Path) -> None:
    (one,) = import_bags([recorded(tmp_path / "bag.mcap", stop=1.95)], tmp_path / "rig")
    assert (one.rows, one.stop) == (10, "no valid point")
    assert one.seconds == pytest.approx(0.95, abs=1e-6)


def test_rows_may_have_another_length_and_bags_of_one_name_a_number(tmp_path: Path) -> None:
    bags = [recorded(tmp_path / "a.mcap"), recorded(tmp_path / "b.mcap")]
    found = import_bags(bags, tmp_path / "rig", period=0.05)
    assert [one.path.name for one in found] == ["drive.csv", "drive-2.csv"]
    assert [one.rows for one in found] == [40, 40]


def test_a_bag_of_another_program_is_refused(tmp_path: Path) -> None:
    with pytest.raises(IrtError, match=r"no rig\.toml"):
        import_bags([Bag(config="").save(tmp_path / "other.mcap")], tmp_path / "rig")
    empty = Bag().save(tmp_path / "empty.mcap")
    with pytest.raises(IrtError, match="contains no played file"):
        import_bags([empty], tmp_path / "rig")


def test_the_verb_says_what_was_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = recorded(tmp_path / "bag.mcap", stop=1.95)
    assert main(["import", str(bag), "--out", str(tmp_path / "rig")]) == 0
    output = capsys.readouterr().out
    assert "10 rows over 0.95 s, measured knobs" in output
    assert "30.0 ms old" in output
    assert "stopped: no valid point" in output
    assert main(["import", str(tmp_path / "absent.mcap")]) == 1
    assert "absent.mcap: no such file; give a bag" in capsys.readouterr().err
