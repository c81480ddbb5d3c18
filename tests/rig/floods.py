"""A rig that plays under an attack: it is asked to stop in the middle of it.

``python floods.py ATTACK FOLDER RIG``, in its own namespace, prints the outcome as JSON.
"""

from __future__ import annotations

import json
import signal
import sys
import time
from pathlib import Path
from typing import Any

from faults import playing
from laboratory import HERE, Fault, Inject, Laboratory, run

#: How long an attack lasts before the rig is asked to stop [s].
BEFORE_S = 4.0


def attacked(attack: str) -> Inject:
    def inject(lab: Laboratory) -> None:
        lab.write_commands(seconds=60.0)
        playing(lab)
        watch(lab, 0.0)
        words = (attack, f"{BEFORE_S + 6.0}", f"{lab.rig.pid}")
        attacker = lab.start(sys.executable, HERE / "attacks.py", *words)
        assert attacker.stdout is not None
        assert attacker.stdout.readline() == "begins\n", attacker.communicate()[1]
        watch(lab, BEFORE_S)
        lab.injected = time.time()
        lab.rig.send_signal(signal.SIGTERM)
        watch(lab, 30.0)
        said, _ = attacker.communicate(timeout=60.0)
        lab.facts["sent"] = int(said)

    return inject


def watch(lab: Laboratory, seconds: float) -> None:
    """Note the most memory that the rig has taken [MB], until it ends."""
    end = time.monotonic() + seconds
    while lab.rig.poll() is None:
        status = Path(f"/proc/{lab.rig.pid}/status").read_text(encoding="utf-8")
        peak = [line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")]
        if peak:
            lab.facts["peak_mb"] = int(peak[0]) / 1024
        if time.monotonic() > end:
            break
        time.sleep(0.02)


ATTACKS = {
    "points": "10,000 points a second",
    "joints": "10,000 joint states a second, of another joint",
    "e-stop": "10,000 messages a second on the e-stop topic, all false",
    "commands": "10,000 commands a second to the left arm",
    "points 1MB": "200 points a second of 1 MB each",
    "joints 1MB": "200 joint states a second of 1 MB each",
    "noise": "10,000 packets a second of random bytes",
    "changed": "10,000 packets a second, real ones with up to four changes",
    "lies": "10,000 packets a second in the name of a peer, with impossible numbers and lengths",
    "fragments": "5 packets a second that announce 256 MB of data each",
}

#: At rest the rig holds 35 MB: what floods it is seen before it takes much of the machine.
FLOODS = {name: Fault(what, attacked(name), config={"memory_mb": 100.0}) for name, what in ATTACKS.items()}

if __name__ == "__main__":
    name, folder, binary = sys.argv[1:]
    outcome: dict[str, Any] = run(FLOODS[name], Path(folder), Path(binary))
    print(json.dumps(outcome))
