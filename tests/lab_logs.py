"""Logs of made-up labs with known truth: a simulated board and marble, logged in a random convention."""

from __future__ import annotations

import contextlib
import csv
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from irt.engine import rollouts
from irt.rig import Board, Marble

#: The truth is simulated at this rate [Hz]: the engine's own.
FINE = 240.0
BEGIN = 1_700_000_000.0


@dataclass
class Truth:
    """One run in the board's own frame; tilt by the right-hand rule.

    ``gear`` (2, 2) is in rad per unit of command: tilt_x, tilt_y by command 1, 2. Of motors that friction
    holds it is in rad/s per unit beyond ``dead``, and ``lag`` is of the speed. ``level`` is the tilt's zero.
    """

    stamps: np.ndarray
    marble_m: np.ndarray
    tilt: np.ndarray
    command_stamps: np.ndarray
    commands: np.ndarray
    gear: np.ndarray
    delay: float
    lag: float
    dead: float
    level: np.ndarray
    held: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    jumped: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))


@dataclass
class Convention:
    """How a lab logs: signs and swaps of its columns, and what its clocks differ by."""

    marble_signs: np.ndarray
    tilt_swap: bool
    tilt_signs: np.ndarray
    offset: float

    def marble(self, truth: Truth) -> np.ndarray:
        return truth.marble_m * self.marble_signs

    def tilt(self, truth: Truth) -> np.ndarray:
        """Logged tilt, (n, 2) [rad]."""
        tilt = truth.tilt * self.tilt_signs
        return tilt[:, ::-1] if self.tilt_swap else tilt

    def expected_tilt(self, truth: Truth) -> np.ndarray:
        """Tilt about x and y in the frame of the logged marble, (n, 2) [rad]."""
        # x'' = +5/7 g tilt_y and y'' = -5/7 g tilt_x hold in a mirrored frame if the tilts are mirrored so.
        return truth.tilt * self.marble_signs[::-1]

    def expected_gear(self, truth: Truth) -> np.ndarray:
        """Gear from the logged commands to `expected_tilt`, (2, 2)."""
        return self.marble_signs[::-1, None] * truth.gear


def draw_convention(rng: np.random.Generator) -> Convention:
    signs = rng.choice([-1.0, 1.0], size=(2, 2))
    return Convention(signs[0], bool(rng.integers(2)), signs[1], float(rng.uniform(-0.3, 0.3)))


def draw_gear(rng: np.random.Generator, unit: float) -> np.ndarray:
    """A gear of either order and signs; in a third of the draws each command moves both axes alike."""
    gear = np.diag(rng.choice([-1.0, 1.0], size=2) * rng.uniform(0.7, 1.4, size=2) / unit)
    if rng.integers(2):
        gear = gear[:, ::-1]
    if rng.integers(3) == 0:
        turn = np.pi / 4.0
        gear = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ gear
    return gear


def simulate(
    rng: np.random.Generator,
    *,
    seconds: float = 60.0,
    rate: float = 55.0,
    unit: float = 1.0,
    board: Board | None = None,
    jitter: float = 0.001,
    spoil: bool = True,
    by_rows: bool = False,
    motors: bool = False,
) -> Truth:
    """Simulate a run: commands in steps, a chain of gear, dead time and lag, a marble, a camera with noise.

    Commands are of the order 0.03 rad x ``unit``. With ``spoil``, places of a lost marble are held, and the
    tilt jumps where a marker is hidden. With ``by_rows``, a command is issued as each state is seen, as in a
    loop that logs one row a turn; else they are event-driven. With ``motors``, commands are currents of
    motors that friction holds: they set the tilt's rate, in a closed loop, and are of the order ``unit``.
    """
    board = board or Board(wall_restitution=0.3)
    stamps = np.arange(0.0, seconds, 1.0 / rate)
    stamps = stamps + rng.uniform(-jitter, jitter, stamps.size)
    delay, lag = rng.uniform(0.03, 0.09), rng.uniform(0.02, 0.15)
    gear = draw_gear(rng, unit)
    # Event-driven commands: a new one after 30 to 120 ms, and now and then silence.
    gaps = rng.uniform(0.03, 0.12, size=int(40 * seconds))
    gaps[rng.random(gaps.size) < 0.02] += 1.0
    command_stamps = np.cumsum(gaps) - 0.5
    command_stamps = stamps if by_rows else command_stamps[command_stamps < seconds + 0.5]
    phases, rates = rng.uniform(0, 2 * np.pi, (4, 2)), rng.uniform(1.5, 7.0, (4, 2))
    waves = np.sin(rates * command_stamps[:, None, None] + phases).sum(axis=1) / 2.0
    commands = unit * (0.045 * waves + 0.008 * rng.standard_normal(waves.shape))
    fine = np.arange(-0.5, seconds + 0.1, 1.0 / FINE)
    # A command counts from the next fine step on, half a step late on average.
    since = fine - delay + 0.5 / FINE
    sent = np.clip(np.searchsorted(command_stamps, since, "right") - 1, 0, None)
    decay = np.exp(-1.0 / (FINE * lag))
    dead = 0.0
    if motors:
        dead, gear = 0.2 * unit, 0.8 * gear / np.abs(gear).max() / unit
        wanted = 0.03 * waves + 0.02 * rng.standard_normal(waves.shape)
        commands, tilt = _driven(wanted, gear, dead, decay, sent)
    else:
        asked = (commands @ gear.T)[sent]
        tilt = np.empty_like(asked)
        tilt[0] = asked[0]
        for row in range(1, len(fine)):
            tilt[row] = asked[row - 1] + (tilt[row - 1] - asked[row - 1]) * decay
    level = rng.uniform(-0.01, 0.01, 2)
    rig = SimpleNamespace(board=board, marble=Marble(radius_m=0.006, mass_kg=0.007))
    places = rollouts(
        [[1.0, 1.0, 0.003, 1.0, 1.0]],
        tilt,
        rig=rig,
        start=[0.0, 0.0],
        durations=np.full(len(fine), 1.0 / FINE),
        threads=1,
    )[0]
    marble = np.column_stack([np.interp(stamps, fine, one) for one in places.T]) * board.edge_x_m
    seen = np.column_stack([np.interp(stamps, fine, one) for one in tilt.T]) + level
    marble += 0.0005 * rng.standard_normal(marble.shape)
    seen += np.deg2rad(0.05) * rng.standard_normal(seen.shape)
    held, jumped = np.zeros(stamps.size, dtype=bool), np.zeros(stamps.size, dtype=bool)
    if spoil:
        for first in rng.integers(100, stamps.size - 100, 4):
            rows = slice(first, first + int(rng.integers(3, 20)))
            marble[rows], held[rows] = marble[first - 1], True
        for first in rng.integers(100, stamps.size - 100, 3):
            rows = slice(first, first + int(rng.integers(3, 15)))
            if not jumped[first - 60 : first + 60].any():
                seen[rows] += rng.uniform(0.1, 0.2) * rng.choice([-1.0, 1.0])
                jumped[rows] = True
    return Truth(stamps, marble, seen, command_stamps, commands, gear, delay, lag, dead, level, held, jumped)


def _driven(
    wanted: np.ndarray, gear: np.ndarray, dead: float, decay: float, sent: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return currents (m, 2) of a loop that seeks a wanted tilt (m, 2) [rad], and the tilt (n, 2).

    ``sent`` is which current acts in each fine step, ``decay`` what one leaves of a difference of speed.
    """
    commands, inverse = np.zeros_like(wanted), np.linalg.inv(gear)
    tilt, speed = np.zeros((len(sent), 2)), np.zeros(2)
    last = -1
    for row in range(1, len(sent)):
        # Each command is of the tilt when it begins to act: the phase of this loop does not matter.
        while last < sent[row]:
            last += 1
            rolling = inverse @ (4.0 * (wanted[last] - tilt[row - 1]))
            commands[last] = rolling + dead * np.sign(rolling)
        current = commands[sent[row]]
        asked = gear @ (current - np.clip(current, -dead, dead))
        speed = asked + (speed - asked) * decay
        tilt[row] = np.clip(tilt[row - 1] + speed / FINE, -0.14, 0.14)
    return commands, tilt


def write_bag(
    path: Path,
    truth: Truth,
    convention: Convention,
    *,
    storage: str = "sqlite3",
    package: str = "cyberrunner_interfaces",
    command: str = "DynamixelVel",
    topics: tuple[str, str] = ("/stateEstimation", "/cyberrunner_dynamixel/cmd"),
    header_offset: float | None = None,
    command_offset: float = 0.0,
    sub_image: bool = False,
    extra: Sequence[str] = (),
) -> Path:
    """Write a rosbag2 folder as a lab's recorder leaves it: sqlite3 without message definitions, or MCAP.

    Parameters
    ----------
    header_offset : float, optional
        What the clock of the headers is ahead of the bag's [s]; states have no header by default.
    command_offset : float
        Added to the moments of receipt of commands [s].
    sub_image : bool
        Whether states come as StateEstimateSub, with a picture.
    extra : sequence of str
        Further topics that repeat the states.
    """
    types = get_typestore(Stores.ROS2_HUMBLE)
    state, sent = f"{package}/msg/StateEstimate", f"{package}/msg/{command}"
    sub = f"{package}/msg/StateEstimateSub"
    head = "" if header_offset is None else "std_msgs/Header header\n"
    fields = "".join(f"float64 {name}\n" for name in ("x_b", "y_b", "x_b_dot", "y_b_dot", "alpha", "beta"))
    types.register(get_types_from_msg(head + fields, state))
    types.register(get_types_from_msg("float64 vel_1\nfloat64 vel_2\n", sent))
    types.register(get_types_from_msg(f"{package}/StateEstimate state\nsensor_msgs/Image subimg\n", sub))
    kind = sub if sub_image else state
    noise = np.random.default_rng(truth.stamps.size)
    places, tilts = convention.marble(truth), convention.tilt(truth)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        states = [writer.add_connection(topic, kind, typestore=types) for topic in (topics[0], *extra)]
        commands = writer.add_connection(topics[1], sent, typestore=types)
        for stamp, place, tilt in zip(truth.stamps, places, tilts, strict=True):
            # A message takes a while; receipt is what a bag knows.
            late = 0.0 if header_offset is None else float(noise.exponential(0.002))
            values = [*place, 0.0, 0.0, *tilt]
            if header_offset is not None:
                nanos = round((BEGIN + stamp + header_offset) * 1e9)
                time = types.types["builtin_interfaces/msg/Time"](nanos // 10**9, nanos % 10**9)
                values = [types.types["std_msgs/msg/Header"](time, "board"), *values]
            message = types.types[state](*values)
            if sub_image:
                message = types.types[sub](message, _picture(types))
            data = types.serialize_cdr(message, kind)
            for one in states:
                writer.write(one, round((BEGIN + stamp + late) * 1e9), data)
        for stamp, pair in zip(truth.command_stamps, truth.commands, strict=True):
            data = types.serialize_cdr(types.types[sent](*pair), sent)
            writer.write(commands, round((BEGIN + stamp + command_offset) * 1e9), data)
    if storage == "sqlite3":
        _forget_definitions(path)
    return path


def _forget_definitions(path: Path) -> None:
    """Empty the table of definitions, which bags of Humble do not have."""
    for file in path.glob("*.db3"):
        with contextlib.closing(sqlite3.connect(file)) as base:
            base.execute("DELETE FROM message_definitions")
            base.commit()


def _picture(types: Any) -> Any:
    time = types.types["builtin_interfaces/msg/Time"](0, 0)
    header = types.types["std_msgs/msg/Header"](time, "")
    pixels = np.zeros(12, dtype=np.uint8)
    return types.types["sensor_msgs/msg/Image"](header, 2, 2, "bgr8", 0, 6, pixels)


def write_tag_folder(path: Path, truth: Truth, convention: Convention) -> Path:
    """Write a TAG recorder's folder; the ROS clock of its commands is ahead by the convention's offset."""
    path.mkdir()
    places, tilts = convention.marble(truth), convention.tilt(truth)
    age = 0.02
    noise = np.random.default_rng(truth.stamps.size)

    def clocks(stamps: np.ndarray, offset: float) -> dict[str, list[int]]:
        monotonic = stamps + 5000.0
        ros = BEGIN + stamps + offset + noise.normal(0.0, 0.0005, stamps.size)
        return {
            "ros_time_ns": [round(float(one) * 1e9) for one in ros],
            "monotonic_ns": [round(float(one) * 1e9) for one in monotonic],
        }

    lost = truth.held
    write_csv(
        path / "states.csv",
        {
            **clocks(truth.stamps + age, 0.0),
            "source_age_ns": [round(age * 1e9)] * len(lost),
            "x_b_m": places[:, 0],
            "y_b_m": places[:, 1],
            "x_b_dot_mps": np.zeros(len(lost)),
            "y_b_dot_mps": np.zeros(len(lost)),
            "alpha_rad": tilts[:, 0],
            "beta_rad": tilts[:, 1],
            "ball_visible": ["False" if one else "True" for one in lost],
        },
    )
    write_csv(
        path / "commands.csv",
        {
            **clocks(truth.command_stamps, convention.offset),
            "vel_1": truth.commands[:, 0],
            "vel_2": truth.commands[:, 1],
            "target_pos_1": 500.0 + 1.5 * truth.commands[:, 0],
            "target_pos_2": 500.0 + 1.5 * truth.commands[:, 1],
        },
    )
    return path


def write_plain_csv(path: Path, truth: Truth, convention: Convention) -> Path:
    """Write one table in degrees and milliseconds; the tilt has a clock of its own, ahead by the offset."""
    places, tilts = convention.marble(truth), np.rad2deg(convention.tilt(truth))
    last = np.clip(np.searchsorted(truth.command_stamps, truth.stamps, "right") - 1, 0, None)
    return write_csv(
        path,
        {
            "stamp_ms": 1e3 * truth.stamps,
            "tilt_stamp_ms": 1e3 * (truth.stamps + convention.offset),
            "xb": places[:, 0],
            "yb": places[:, 1],
            "alpha_deg": tilts[:, 0],
            "beta_deg": tilts[:, 1],
            "u1": truth.commands[last, 0],
            "u2": truth.commands[last, 1],
        },
    )


#: The mapping of `write_plain_csv`.
PLAIN = (
    "t_s=stamp_ms/1000",
    "tilt_t_s=tilt_stamp_ms/1000",
    "marble_x=xb/0.276",
    "marble_y=yb/0.276",
    "tilt_x_rad=rad(alpha_deg)",
    "tilt_y_rad=rad(beta_deg)",
    "cmd_x=u1",
    "cmd_y=u2",
)


def write_csv(path: Path, columns: dict[str, Sequence[Any] | np.ndarray]) -> Path:
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path
