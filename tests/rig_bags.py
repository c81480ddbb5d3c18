"""Bags of `rig` with known truth: joints, a marble and played rows, written message by message."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from mcap_ros2.writer import Writer

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
    path: Path,
    *,
    joints: bool = True,
    lost: tuple[float, float] = (9.0, 9.0),
    stop: float = 99.0,
    ticks: int = 400,
    begin: int = 100,
) -> Path:
    """Ticks of 10 ms; from one of them on, rows of 0.1 s are played, at most 20 of them."""
    bag = Bag()
    for tick in range(ticks):
        t = 0.01 * tick
        if joints:
            bag.joints(t + 0.003, knobs(t + 0.003 - 0.05))
        bag.commanded(t, knobs(t))
        if begin <= tick < begin + 200 and tick % 10 == 0 and t < stop:
            bag.commanded(t, knobs(t), "/rig/command", "drive")
    for picture in range(ticks * 60 // 100):
        t = picture / 60.0
        if not lost[0] <= t <= lost[1]:
            bag.seen(t, marble(t))
    if stop < 99.0:
        bag.event(stop, "stopping:tracker_silent", "no valid point")
    return bag.save(path)
