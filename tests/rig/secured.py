"""The rig beside its twin, and an intruder.

``python secured.py FOLDER RIG KEYSTORE TWINS_KEYSTORE INTRUDE``, in its own namespace, prints the outcome as
JSON; a keystore that is empty leaves DDS Security off.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from intruder import PLACE
from laboratory import HERE, messages


def environment(keystore: str) -> dict[str, str]:
    """Return the environment of a node with a keystore, or without."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("ROS_SECURITY")}
    if not keystore:
        return kept
    return {
        **kept,
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": keystore,
    }


def main(folder: Path, rig: Path, keystore: str, twins: str, intrude: str) -> dict[str, Any]:
    os.chdir(folder)
    twin = subprocess.Popen(
        [rig, "twin", "--model", "model.toml"], env=environment(twins), stdout=subprocess.PIPE, text=True
    )
    intruder = None
    try:
        assert twin.stdout is not None
        twin.stdout.readline()
        if intrude:
            intruder = subprocess.Popen(
                [sys.executable, HERE / "intruder.py", "25"], stdout=subprocess.PIPE, text=True
            )
        played = subprocess.run(
            [rig, "play", "run-1.csv", "--out", "bags", "--arm"],
            env=environment(keystore),
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
        matched = int(intruder.communicate(timeout=60.0)[0]) if intruder else 0
    finally:
        twin.send_signal(signal.SIGINT)
        twin.wait(20.0)
        if intruder and intruder.poll() is None:
            intruder.kill()
            intruder.wait()
    found: dict[str, Any] = {
        "status": played.returncode,
        "out": played.stdout,
        "err": played.stderr,
        "matched": matched,
    }
    bag = Path("bags/run-1.mcap")
    if bag.exists():
        topics: dict[str, int] = {}
        events, foreign, pressed = [], 0, 0
        for topic, _, message in messages(bag):
            topics[topic] = topics.get(topic, 0) + 1
            if topic == "/rig/events":
                events.append((message.function, message.msg))
            foreign += topic == "/marble/position" and message.point.x == PLACE
            pressed += topic == "/rig/e_stop"
        found |= {"events": events, "topics": topics, "foreign": foreign, "pressed": pressed}
    return found


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])))
