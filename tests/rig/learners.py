"""Learners of two other labs, reduced to open-loop commands, which write what they see.

``python learners.py cyberrunner OUT`` speaks ROS 2 by Cyclone DDS; ``python learners.py tag OUT`` listens for
the bridge on TCP port 5555. Each writes JSON with rows of t [s], x_b, y_b [m], alpha, beta [rad].
"""

from __future__ import annotations

import base64
import json
import math
import socket
import sys
import time
from pathlib import Path
from typing import Any

#: Commands for so long [s]: first about one axis, later about the other.
CYBERRUNNER = ((0.3, 0.0, 0.0), (0.2, -200.0, 0.0), (0.3, 0.0, 0.0), (0.3, 0.0, -200.0), (0.5, 0.0, 0.0))
TAG = ((0.3, 0.0, 0.0), (0.7, 100.0, 0.0), (0.6, 100.0, -100.0))


def cyberrunner() -> dict[str, Any]:
    from ros import (  # noqa: PLC0415
        DynamixelVel,
        Peer,
        ResetRequest,
        ResetResponse,
        StateEstimate,
        StateEstimateSub,
    )

    peer = Peer()
    commands = peer.writer("/cyberrunner_dynamixel/cmd", DynamixelVel)
    states = peer.reader("/cyberrunner_state_estimation/estimate_subimg", StateEstimateSub)
    plain = peer.reader("/stateEstimation", StateEstimate)
    while not commands.get_publication_matched_status().current_count:
        time.sleep(0.01)
    picture: dict[str, Any] = {}

    def watch(seconds: float) -> list[list[float]]:
        rows, begin = [], time.monotonic()
        while time.monotonic() < begin + seconds:
            for message in states.take(N=100):
                state, image = message.state, message.subimg
                rows.append([time.monotonic(), state.x_b, state.y_b, state.alpha, state.beta, state.x_b_dot])
                # Without a marble there is nothing to cut out: such a picture is black.
                if not picture and math.isfinite(state.x_b):
                    whole = list(image.data)
                    middle = 3 * (64 * 32 + 32)
                    picture.update(
                        shape=[image.height, image.width, image.step, len(whole)],
                        encoding=image.encoding,
                        corner=whole[:3],
                        middle=whole[middle : middle + 3],
                    )
            time.sleep(0.002)
        return rows

    rows = []
    for seconds, vel_1, vel_2 in CYBERRUNNER:
        commands.write(DynamixelVel(vel_1, vel_2))
        rows += watch(seconds)
    asked = time.monotonic()
    answer = peer.call("/cyberrunner_dynamixel/reset", ResetRequest(7, 1, 0), ResetResponse, 10.0)
    took = time.monotonic() - asked
    watch(0.2)
    return {
        "rows": rows,
        "picture": picture,
        "plain": len(plain.take(N=5000)),
        "success": answer and answer.success,
        "took": took,
        "after": watch(0.3),
    }


def tag() -> dict[str, Any]:
    server = socket.create_server(("127.0.0.1", 5555))
    server.settimeout(20.0)
    stream, _ = server.accept()
    lines = stream.makefile("rb")

    def ask(request: bytes) -> Any:
        stream.sendall(request + b"\n")
        return json.loads(lines.readline())

    def row(answer: dict[str, Any]) -> list[float]:
        return [time.monotonic(), *(answer[key] for key in ("x_b", "y_b", "alpha", "beta"))]

    while not (first := ask(b'{"cmd":"obs"}'))["ok"]:
        time.sleep(0.01)
    wrong = [ask(b"{"), ask(b'{"cmd":"fly"}'), ask(b"x" * 70000)]
    rows = []
    for seconds, vel_1, vel_2 in TAG:
        request = json.dumps({"cmd": "step", "vel_1": vel_1, "vel_2": vel_2, "timeout": 0.05}).encode()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rows.append(row(ask(request)))
    # After a second of silence the driver goes home.
    time.sleep(1.8)
    silent = row(ask(b'{"cmd":"obs"}'))
    reset = ask(b'{"cmd":"reset"}')
    time.sleep(0.5)
    return {
        "rows": rows,
        "picture": len(base64.b64decode(first["image_b64"])),
        "wrong": wrong,
        "silent": silent,
        "reset": reset,
        "after": row(ask(b'{"cmd":"obs"}')),
    }


if __name__ == "__main__":
    found = {"cyberrunner": cyberrunner, "tag": tag}[sys.argv[1]]()
    Path(sys.argv[2]).write_text(json.dumps(found))
