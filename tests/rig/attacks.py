"""Floods and broken packets while a file is played, and how the rig then stops.

``python attacks.py KIND FOLDER RIG``, in its own namespace, prints the outcome of one as JSON.
"""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from attackers import KINDS
from laboratory import HERE, Fault, Laboratory, run

#: Time for which a rig bears an attack before it is asked to stop [s].
SECONDS = 3.0


def attack(kind: str) -> Callable[[Laboratory], None]:
    def inject(lab: Laboratory) -> None:
        lab.write_commands(seconds=30.0)
        lab.peers()
        lab.play()
        lab.wait_for_motion()
        lab.injected = time.time()
        lab.start(sys.executable, HERE / "attackers.py", kind, "sent")
        end = time.monotonic() + SECONDS
        while time.monotonic() < end and lab.rig.poll() is None:
            time.sleep(0.01)
        if lab.rig.poll() is None:
            lab.injected = time.time()
            lab.rig.send_signal(signal.SIGTERM)

    return inject


def observe(kind: str, folder: Path, rig: Path) -> dict[str, Any]:
    found = run(Fault(kind, attack(kind)), folder, rig)
    sent = folder / "sent"
    return {**found, "sent": int(sent.read_text() or 0) if sent.exists() else 0}


if __name__ == "__main__":
    kind, folder, binary = sys.argv[1:]
    assert kind in KINDS
    print(json.dumps(observe(kind, Path(folder), Path(binary))))
