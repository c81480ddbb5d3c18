"""The injected faults, and the required reaction to each.

``python faults.py FAULT FOLDER RIG``, in its own namespace, prints the outcome of one as JSON.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from freeze import freeze, thread_of
from laboratory import HERE, Fault, Inject, Laboratory, run


def playing(lab: Laboratory, **options: Any) -> None:
    lab.peers(**options)
    lab.play()
    lab.wait_for_motion()
    lab.injected = time.time()


def tracker_says(mode: str) -> Inject:
    def inject(lab: Laboratory) -> None:
        playing(lab)
        lab.ask(lab.tracker, mode)

    return inject


def arms_say(mode: str) -> Inject:
    def inject(lab: Laboratory) -> None:
        playing(lab)
        lab.ask(lab.arms, mode)

    return inject


def tracker_gets(number: signal.Signals) -> Inject:
    def inject(lab: Laboratory) -> None:
        playing(lab)
        lab.tracker.send_signal(number)

    return inject


def arms_get(number: signal.Signals) -> Inject:
    def inject(lab: Laboratory) -> None:
        playing(lab)
        lab.arms.send_signal(number)

    return inject


def rig_gets(number: signal.Signals) -> Inject:
    def inject(lab: Laboratory) -> None:
        playing(lab)
        lab.rig.send_signal(number)

    return inject


def arms_stall(lab: Laboratory) -> None:
    playing(lab)
    lab.arms.send_signal(signal.SIGSTOP)
    time.sleep(0.8)
    lab.arms.send_signal(signal.SIGCONT)


def rig_stalls(lab: Laboratory) -> None:
    playing(lab)
    lab.rig.send_signal(signal.SIGSTOP)
    time.sleep(0.3)
    lab.rig.send_signal(signal.SIGCONT)


def memory_is_full(lab: Laboratory) -> None:
    # An attacker takes a while to begin.
    lab.write_commands(seconds=60.0)
    playing(lab)
    words = ("fragments 8MB", "30", f"{lab.rig.pid}")
    attacker = lab.start(sys.executable, HERE / "attacks.py", *words)
    assert attacker.stdout is not None
    attacker.stdout.readline()
    lab.injected = time.time()


def loop_hangs(lab: Laboratory) -> None:
    playing(lab)
    freeze(lab.rig.pid, lab.rig.pid)


def network_hangs(lab: Laboratory) -> None:
    playing(lab)
    freeze(lab.rig.pid, thread_of(lab.rig.pid, "RustDDS Partici"))


def interface_goes(lab: Laboratory) -> None:
    playing(lab)
    subprocess.run(["ip", "link", "set", "lo", "down"], check=True)


def clock_steps_back(lab: Laboratory) -> None:
    offset = lab.folder / "offset"
    offset.write_text("0")
    library = lab.folder / "clock.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, HERE / "clock.c", "-ldl"], check=True)
    lab.environment = {"LD_PRELOAD": f"{library}", "CLOCK_OFFSET": f"{offset}"}
    playing(lab)
    offset.write_text("-5")


def disk_fills(lab: Laboratory) -> None:
    lab.bags.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", lab.bags], check=True)
    playing(lab)
    with contextlib.suppress(OSError):
        (lab.bags / "other").write_bytes(bytes(1 << 20))


def e_stop(lab: Laboratory) -> None:
    playing(lab)
    lab.start(sys.executable, "-c", _E_STOP, env={**os.environ, "PYTHONPATH": f"{HERE}"})


def e_stop_is_pressed(lab: Laboratory) -> None:
    lab.peers()
    lab.start(sys.executable, "-c", _E_STOP, env={**os.environ, "PYTHONPATH": f"{HERE}"})
    time.sleep(5.0)
    lab.play()


def stop_service(lab: Laboratory) -> None:
    playing(lab)
    lab.start(sys.executable, "-c", _SERVICE, env={**os.environ, "PYTHONPATH": f"{HERE}"})


_E_STOP = """
import time
from ros import Bool, Peer
writer = Peer().writer("/rig/e_stop", Bool)
while True:
    writer.write(Bool(True))
    time.sleep(0.05)
"""

_SERVICE = """
from ros import Peer
assert Peer().call_trigger("/rig/stop", 10.0)
"""


def only_play(lab: Laboratory) -> None:
    lab.peers()
    lab.play()


def no_arms(lab: Laboratory) -> None:
    lab.tracker = lab.peer("tracker", "reliable")
    lab.play()


def quality_differs(lab: Laboratory) -> None:
    lab.peers(tracker="best_effort")
    lab.play()


def another_publisher_is_there(lab: Laboratory) -> None:
    lab.peers()
    lab.ask(lab.arms, "intrude")
    assert lab.arms.stdout is not None
    assert lab.arms.stdout.readline() == "intruding\n"
    lab.play()


def commands_are_broken(lab: Laboratory) -> None:
    text = (lab.folder / "run.csv").read_text().splitlines()
    text[7] = "6,0.3,nan,0.0"
    (lab.folder / "run.csv").write_text("\n".join(text))
    lab.play()


def commands_are_too_fast(lab: Laboratory) -> None:
    lab.write_commands(amplitude=0.49)
    text = (lab.folder / "run.csv").read_text().splitlines()
    text[9] = "8,0.4,-0.45,0.0"
    (lab.folder / "run.csv").write_text("\n".join(text))
    lab.play()


def folder_is_full(lab: Laboratory) -> None:
    lab.bags.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", lab.bags], check=True)
    (lab.bags / "other").write_bytes(bytes(4096))
    lab.play()


FAULTS = {
    "tracker killed": Fault("kill -9 of the tracker", tracker_gets(signal.SIGKILL), stop="tracker_silent"),
    "tracker stalled": Fault("SIGSTOP of the tracker", tracker_gets(signal.SIGSTOP), stop="tracker_silent"),
    "tracker frozen": Fault("the same place to the last bit", tracker_says("freeze"), stop="tracker_lies"),
    "tracker jumps": Fault("the marble 0.4 edges away and back", tracker_says("jump"), stop="tracker_lies"),
    "tracker floods": Fault("2400 points a second", tracker_says("flood"), stop="tracker_lies"),
    "tracker NaN": Fault("NaN positions", tracker_says("nan"), stop="tracker_silent"),
    "tracker old": Fault("stamps 3 s old", tracker_says("old"), stop="tracker_silent"),
    "joints stop": Fault("joint states stop, the driver lives", arms_say("silent"), stop="joints_silent"),
    "joints lie": Fault("joint states stay at their last value", arms_say("lie"), stop="tracking_error"),
    "joints jump": Fault("joint states 1 rad off", arms_say("jump"), stop="joints_lie"),
    "arms killed": Fault("kill -9 of the driver", arms_get(signal.SIGKILL), stop="joints_silent"),
    "arms stalled": Fault("SIGSTOP of the driver, SIGCONT after 0.8 s", arms_stall, stop="joints_silent"),
    "second publisher": Fault("another publisher while playing", arms_say("intrude"), stop="other_publisher"),
    "clock back": Fault("the machine's clock set back by 5 s", clock_steps_back, stop="clock_stepped"),
    "disk full": Fault("the disk fills while playing", disk_fills, stop="recorder"),
    "SIGTERM": Fault("SIGTERM of the rig", rig_gets(signal.SIGTERM), stop="signal"),
    "SIGINT": Fault("Ctrl-C", rig_gets(signal.SIGINT), stop="signal"),
    "interface gone": Fault("the network interface goes down", interface_goes, stop="joints_silent"),
    "e-stop topic": Fault("true on the e-stop topic", e_stop, stop="emergency_stop"),
    "stop service": Fault("the stop service is called", stop_service, stop="emergency_stop"),
    "rig stalled": Fault(
        "SIGSTOP of the rig for 0.3 s", rig_stalls, stop="overrun", config={"overrun_s": 0.15}
    ),
    "loop hangs": Fault("the rig's loop never goes on", loop_hangs, abandoned="to move"),
    "network hangs": Fault("a thread of DDS never goes on", network_hangs, stop="joints_silent"),
    "memory": Fault(
        "packets announce 8 MB of data each", memory_is_full, stop="memory", config={"memory_mb": 100.0}
    ),
    "rig killed": Fault("kill -9 of the rig", rig_gets(signal.SIGKILL), killed=True),
    "e-stop pressed": Fault("the e-stop is true beforehand", e_stop_is_pressed, refusal="emergency stop"),
    "publisher there": Fault(
        "another publisher beforehand", another_publisher_is_there, refusal="somebody else publishes"
    ),
    "no arms": Fault("no driver", no_arms, refusal="nobody publishes there", config={"match_s": 3.0}),
    "QoS differs": Fault(
        "best-effort tracker, reliable rig",
        quality_differs,
        refusal="QoS",
        config={"reliability": "reliable", "match_s": 10.0},
    ),
    "limits": Fault(
        "a stop would take too long",
        only_play,
        refusal="limits.acceleration_rad_s2",
        config={"acceleration": 1.0},
    ),
    "not allowed": Fault(
        "arming is not allowed", only_play, refusal="allow_arming", config={"allow_arming": "false"}
    ),
    "commands NaN": Fault("a NaN command", commands_are_broken, refusal="row 6, knob_x_rad"),
    "commands fast": Fault(
        "a step that arms cannot follow", commands_are_too_fast, refusal="behind as the row"
    ),
    "folder full": Fault("no room for a bag", folder_is_full, refusal="cannot be written"),
}

if __name__ == "__main__":
    name, folder, binary = sys.argv[1:]
    print(json.dumps(run(FAULTS[name], Path(folder), Path(binary))))
