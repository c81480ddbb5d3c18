"""Bags whose truth is known become recordings that hold it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_ros2.writer import Writer

from irt.cli.__main__ import main
from irt.errors import IrtError
from irt.importing import import_bags
from irt.recording import load_recording
from irt.rig import load_rig

CONFIG = """
[arms.x]
joint = "left"
joint_states = "/joints"
command = "/left"
gear = 2.0
level_rad = 1.0
[arms.y]
joint = "right"
joint_states = "/joints"
command = "/right"
gear = -1.0
level_rad = 0.0
[tracker]
unit = "m"
edge_x_m = 0.3
"""

HEADER = (
    f"{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
POINT = (
    f"std_msgs/Header header\ngeometry_msgs/Point point\n{'=' * 80}\n"
    "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
)
STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
LOG = (
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
    "string function\nuint32 line\n"
    f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
BEGIN = 1_700_000_000.0
TRACKER_AGE, JOINT_AGE = 0.03, 0.002


def knobs(t: float) -> tuple[float, float]:
    """Knob angles that joints follow [rad]."""
    return 0.1 * np.sin(1.5 * t), 0.05 * np.cos(2.0 * t)


def marble(t: float) -> tuple[float, float]:
    return 0.2 * np.sin(t), 0.1 * np.cos(0.7 * t)


class Bag:
    """A bag in the making."""

    def __init__(self, config: str = CONFIG) -> None:
        self.stream = io.BytesIO()
        self.writer = Writer(self.stream)
        if config:
            self.writer._writer.add_attachment(0, 0, "rig.toml", "application/toml", config.encode())
        register = self.writer.register_msgdef
        self.point = register("geometry_msgs/msg/PointStamped", POINT + HEADER)
        self.state = register("sensor_msgs/msg/JointState", STATE + HEADER)
        self.log = register("rcl_interfaces/msg/Log", LOG)

    def write(self, topic: str, schema: Any, t: float, age: float, message: dict[str, Any]) -> None:
        self.writer.write_message(
            topic, schema, message, log_time=int((BEGIN + t + age) * 1e9), publish_time=int((BEGIN + t) * 1e9)
        )

    def stamped(self, topic: str, schema: Any, t: float, age: float, frame: str = "", **fields: Any) -> None:
        nanos = int((BEGIN + t) * 1e9)
        stamp = {"sec": nanos // 10**9, "nanosec": nanos % 10**9}
        self.write(topic, schema, t, age, {"header": {"stamp": stamp, "frame_id": frame}, **fields})

    def event(self, t: float, code: str, text: str) -> None:
        nanos = int((BEGIN + t) * 1e9)
        stamp = {"sec": nanos // 10**9, "nanosec": nanos % 10**9}
        fields = {"name": "rig", "msg": text, "file": "", "function": code, "line": 0, "level": 40}
        self.write("/rig/events", self.log, t, 0.0, {"stamp": stamp, **fields})

    def joints(self, t: float, angles: tuple[float, float]) -> None:
        position = [1.0 + 2.0 * angles[0] + 2.0 * np.pi, -angles[1]]
        fields = {"name": ["left", "right"], "position": position, "velocity": [], "effort": []}
        self.stamped("/joints", self.state, t, JOINT_AGE, **fields)

    def seen(self, t: float, at: tuple[float, float]) -> None:
        self.stamped(
            "/marble/position",
            self.point,
            t,
            TRACKER_AGE,
            point={"x": 0.3 * at[0], "y": 0.3 * at[1], "z": 0.0},
        )

    def commanded(
        self, t: float, angles: tuple[float, float], topic: str = "/rig/setpoint", frame: str = "playing"
    ) -> None:
        fields = {
            "name": ["knob_x", "knob_y"],
            "position": list(angles),
            "velocity": [0.0, 0.0],
            "effort": [],
        }
        self.stamped(topic, self.state, t, 0.0, frame, **fields)

    def save(self, path: Path) -> Path:
        self.writer.finish()
        path.write_bytes(self.stream.getvalue())
        return path


def recorded(
    path: Path, *, joints: bool = True, lost: tuple[float, float] = (9.0, 9.0), stop: float = 99.0
) -> Path:
    """Four seconds, 20 of whose rows of 0.1 s are played from second 1 on."""
    bag = Bag()
    for tick in range(400):
        t = 0.01 * tick
        if joints:
            bag.joints(t + 0.003, knobs(t + 0.003 - 0.05))
        bag.commanded(t, knobs(t))
        if 100 <= tick < 300 and tick % 10 == 0 and t < stop:
            bag.commanded(t, knobs(t), "/rig/command", "drive")
    for picture in range(240):
        t = picture / 60.0
        if not lost[0] <= t <= lost[1]:
            bag.seen(t, marble(t))
    if stop < 99.0:
        bag.event(stop, "stopping:tracker_silent", "no valid point")
    return bag.save(path)


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
    assert "absent.mcap: cannot be read" in capsys.readouterr().err
