"""A laboratory in its own network namespace: peers, an injected fault, and the rig's reaction."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

HERE = Path(__file__).resolve().parent

CONFIG = """
[network]
services = "cyclone"
match_s = {match_s}

[arms.x]
joint = "left_wrist"
joint_states = "/left/joint_states"
command = "/left/joint_trajectory"
gear = 1.0
level_rad = 0.0

[arms.y]
joint = "right_wrist"
joint_states = "/right/joint_states"
command = "/right/joint_trajectory"
gear = -1.0
level_rad = 0.0

[backend]
kind = "trajectory"

[limits]
window_rad = 0.5
velocity_rad_s = 0.35
acceleration_rad_s2 = {acceleration}
step_rad = 0.005
tracking_error_rad = {tracking_error}
home_velocity_rad_s = 0.1

# Longer than a laboratory would have them: the machine that runs the tests may be busy.
[timeouts]
tracker_s = 0.5
joints_s = 0.4
tracking_error_s = 0.2
overrun_s = {overrun_s}
command_s = 0.5
stamp_s = 1.0
frozen_s = 1.0

[tracker]
reliability = "{reliability}"
most_hz = 1000.0

[safety]
allow_arming = {allow_arming}
hold_s = 0.5
memory_mb = {memory_mb}
"""

DEFAULTS = {
    "match_s": 15.0,
    "acceleration": 4.0,
    "tracking_error": 0.1,
    "overrun_s": 0.5,
    "reliability": "best_effort",
    "allow_arming": "true",
    "memory_mb": 400.0,
}


class Laboratory:
    """Processes of one test, and its files."""

    def __init__(self, folder: Path, rig: Path, **config: Any) -> None:
        self.folder, self.binary = folder, rig
        self.processes: list[subprocess.Popen[str]] = []
        (folder / "rig.toml").write_text(CONFIG.format_map({**DEFAULTS, **config}))
        self.write_commands()
        self.environment: dict[str, str] = {}
        #: What an injection has measured.
        self.facts: dict[str, Any] = {}
        self.bags = folder / "bags"

    def write_commands(self, amplitude: float = 0.24, seconds: float = 12.0) -> None:
        """Write commands of knobs that turn back and forth at a constant rate, with hardly any rest."""
        rows = ["step,t_s,knob_x_rad,knob_y_rad"]
        for i in range(int(seconds / 0.05)):
            t = 0.05 * i
            x = amplitude * 2.0 / math.pi * math.asin(math.sin(math.pi / 2.0 * t))
            rows.append(f"{i},{t:.3f},{x!r},{0.5 * x!r}")
        (self.folder / "run.csv").write_text("\n".join(rows) + "\n")

    def start(self, *command: str | Path, **options: Any) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [str(part) for part in command],
            cwd=self.folder,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            **options,
        )
        self.processes.append(process)
        return process

    def peer(self, *words: str) -> subprocess.Popen[str]:
        return self.start(sys.executable, HERE / "devices.py", *words)

    def peers(self, *, tracker: str = "reliable") -> None:
        self.tracker = self.peer("tracker", tracker)
        self.arms = self.peer("arms", "received.json")

    def play(self, *options: str) -> subprocess.Popen[str]:
        words = ("play", "run.csv", "--out", self.bags, "--arm", *options)
        self.rig = self.start(self.binary, *words, env={**os.environ, **self.environment})
        return self.rig

    def ask(self, peer: subprocess.Popen[str], request: str) -> None:
        assert peer.stdin is not None
        peer.stdin.write(request + "\n")
        peer.stdin.flush()

    def wait_for_motion(self, seconds: float = 30.0) -> None:
        """Return one second after the bag says that the file is being played."""
        end = time.monotonic() + seconds
        bag = self.bags / "run.mcap"
        while time.monotonic() < end:
            if bag.exists() and b"playing" in bag.read_bytes():
                time.sleep(1.0)
                return
            if self.rig.poll() is not None:
                raise RuntimeError(f"the rig has ended: {self.rig.communicate()}")
            time.sleep(0.05)
        raise RuntimeError("the rig does not play")

    def end(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.kill()
            process.communicate()


Inject = Callable[[Laboratory], None]


@dataclass(frozen=True)
class Fault:
    """An injected fault, the stop or refusal that must follow, and changes of the configuration."""

    what: str
    inject: Inject
    stop: str = ""
    refusal: str = ""
    killed: bool = False
    #: What the last command was, of a rig whose loop does not go on.
    abandoned: str = ""
    config: dict[str, Any] = field(default_factory=dict)


def run(fault: Fault, folder: Path, rig: Path) -> dict[str, Any]:
    """Play, inject a fault, and return the outcome."""
    laboratory = Laboratory(folder, rig, **fault.config)
    try:
        began = time.time()
        fault.inject(laboratory)
        at = getattr(laboratory, "injected", began)
        try:
            _, err = laboratory.rig.communicate(timeout=40)
        except subprocess.TimeoutExpired:
            return {"error": "the rig goes on"}
        found = {"status": laboratory.rig.returncode, "err": err.strip(), "injected": at, **laboratory.facts}
        return {**found, **read(laboratory.bags / "run.mcap", rig)}
    finally:
        laboratory.end()


def read(bag: Path, rig: Path) -> dict[str, Any]:
    """Return from a bag when and why the arms were stopped, and how they came to rest."""
    if not bag.exists():
        return {"bag": None}
    # Not beside it, where the disk may be full.
    whole = bag.parent.with_name("whole.mcap")
    recovered = subprocess.run(
        [rig, "recover", bag, "--out", whole], capture_output=True, text=True, check=True
    )
    events: list[tuple[str, str]] = []
    points: list[tuple[float, float]] = []
    sent: list[float] = []
    last, stop = 0.0, 0
    # In the order in which they were written: a clock may be set in between.
    for topic, logged, message in messages(whole):
        last = max(last, logged)
        if topic == "/rig/events":
            events.append((message.function, message.msg))
            stop = len(points) if message.function.startswith("stopping:") else stop
        elif topic == "/rig/setpoint":
            points.append((seconds(message.header.stamp), max(abs(rate) for rate in message.velocity)))
        elif topic.endswith("joint_trajectory") and stop:
            sent.append(abs(message.points[0].velocities[0]))
    codes = [code for code, _ in events]
    found: dict[str, Any] = {"bag": recovered.stdout.strip(), "codes": codes, "last": last}
    if stop:
        code, why = next(event for event in events if event[0].startswith("stopping:"))
        # The set point of the tick that stops is written just before the event.
        ramp = points[stop - 1 :]
        moving = [when for when, rate in ramp if rate > 0.0]
        found |= {
            "code": code.removeprefix("stopping:"),
            "why": why,
            "stopped": ramp[0][0],
            "rate_before": points[stop - 2][1],
            "ramp_s": max(moving) - ramp[0][0] + 0.01 if moving else 0.0,
            "ramp_ticks": len(moving),
            "rests": ramp[-1][1] == 0.0 and bool(sent) and sent[-1] == 0.0,
            "latched": any(code.startswith("latched:") for code in codes),
        }
    return found


def messages(bag: Path):  # type: ignore[no-untyped-def]
    """Yield topic, time of logging and message, read by an independent library."""
    with bag.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            yield channel.topic, message.log_time / 1e9, decoded


def seconds(time: Any) -> float:
    return float(time.sec + time.nanosec / 1e9)
