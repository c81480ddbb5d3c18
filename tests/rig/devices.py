"""A tracker and a driver of two arms, in separate processes, with faults on request.

``python devices.py tracker`` and ``python devices.py arms LOG`` read requests from their standard input.
"""

from __future__ import annotations

import json
import math
import queue
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from ros import (
    Header,
    JointState,
    JointTrajectory,
    Peer,
    Point,
    PointStamped,
    stamp,
)

JOINTS = ("left_wrist", "right_wrist")


def requests() -> Callable[[], str | None]:
    """Return a function that returns the next line of standard input, if any; "end" once closed."""
    lines: queue.Queue[str] = queue.Queue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line.strip())
        lines.put("end")

    threading.Thread(target=read, daemon=True).start()

    def next_line() -> str | None:
        try:
            return lines.get_nowait()
        except queue.Empty:
            return None

    return next_line


def beat(hz: float) -> Callable[[], None]:
    """Return a function that sleeps until the next beat; missed beats are not caught up on."""
    due = time.monotonic()

    def wait() -> None:
        nonlocal due
        due = max(due + 1.0 / hz, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))

    return wait


def tracker(*, reliable: bool) -> None:
    writer = Peer().writer("/marble/position", PointStamped, reliable=reliable)
    request, wait, mode, frozen = requests(), beat(60.0), "good", 0.01
    for i in range(10**9):
        mode = request() or mode
        if mode == "end":
            return
        seen = 0.05 * math.sin(0.02 * i) + 1e-4 * math.sin(1e4 * i)
        x = {"nan": math.nan, "freeze": frozen, "jump": seen + 0.4 * (i // 5 % 2)}.get(mode, seen)
        age = {"old": 3.0}.get(mode, 0.01)
        for part in range(40 if mode == "flood" else 1):
            header = Header(stamp(time.time() - age + 1e-5 * part), "board")
            writer.write(PointStamped(header, Point(x, 0.0, 0.0)))
        wait()


class Arm:
    """A joint that follows trajectories and logs the commands that it received."""

    def __init__(self, peer: Peer, side: str, joint: str) -> None:
        self.joint = joint
        self.states = peer.writer(f"/{side}/joint_states", JointState)
        self.commands = peer.reader(f"/{side}/joint_trajectory", JointTrajectory)
        self.way = [(0.0, 0.0)]
        self.received: list[tuple[float, float, float]] = []
        self.lied = 0.0

    def hear(self) -> None:
        for message in self.commands.take(N=200):
            if not hasattr(message, "points"):
                continue  # a publisher that has ended
            now = time.monotonic()
            points = [
                (now + one.time_from_start.sec + 1e-9 * one.time_from_start.nanosec, one.positions[0])
                for one in message.points
            ]
            self.way = [(now, self.angle(now)), *points]
            self.received.append((time.time(), points[0][1], message.points[0].velocities[0]))

    def angle(self, now: float) -> float:
        before = [point for point in self.way if point[0] <= now] or [self.way[0]]
        after = [point for point in self.way if point[0] > now]
        if not after:
            return before[-1][1]
        (t0, a0), (t1, a1) = before[-1], after[0]
        return a0 + (a1 - a0) * (now - t0) / (t1 - t0) if t1 > t0 else a1

    def report(self, mode: str) -> None:
        now, wall = time.monotonic(), time.time()
        angle = self.angle(now)
        if mode != "lie":
            self.lied = angle
        angle = {"lie": self.lied, "jump": angle + 1.0}.get(mode, angle)
        self.states.write(JointState(Header(stamp(wall), ""), [self.joint], [angle], [0.0], [0.0]))


def arms(log: Path) -> None:
    peer = Peer()
    both = [Arm(peer, "left", JOINTS[0]), Arm(peer, "right", JOINTS[1])]
    request, wait, mode = requests(), beat(100.0), "good"
    intruder = None
    while mode != "end":
        mode = request() or mode
        for arm in both:
            arm.hear()
            if mode != "silent":
                arm.report(mode)
        if mode == "intrude" and intruder is None:
            intruder = Peer().writer("/left/joint_trajectory", JointTrajectory)
            print("intruding", flush=True)
        wait()
    log.write_text(json.dumps([arm.received for arm in both]))


def points(count: int, hz: float) -> None:
    """Send points at a rate, once there is a subscriber, each with its number as x."""
    writer = Peer().writer("/marble/position", PointStamped)
    while not writer.get_publication_matched_status().current_count:
        time.sleep(0.02)
    time.sleep(0.5)
    begin = time.monotonic()
    for i in range(count):
        time.sleep(max(0.0, begin + i / hz - time.monotonic()))
        writer.write(PointStamped(Header(stamp(), "board"), Point(float(i), 0.0, 0.0)))
    time.sleep(1.0)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["points", count, hz]:
            points(int(count), float(hz))
        case ["tracker", reliability]:
            tracker(reliable=reliability == "reliable")
        case ["arms", path]:
            arms(Path(path))
