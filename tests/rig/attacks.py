"""Floods by peers with the right types, and packets that are broken, at the ports of a rig.

``python attacks.py ATTACK SECONDS PROCESS`` attacks the rig of this process, and prints how often.
"""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable
from random import Random

from packets import MULTICAST, changed, heard, large_fragment, lie, ports_of, writers_of
from ros import Bool, Header, JointState, JointTrajectory, Peer, Point, PointStamped, TrajectoryPoint, stamp

#: Messages and packets a second, those of a megabyte, and packets that announce large data.
OFTEN_HZ, LARGE_HZ, FRAGMENTS_HZ = 10_000.0, 200.0, 5.0
MEGABYTE = 1 << 20
#: Sizes of data that packets announce [bytes]; while 256 MB are filled, DDS does nothing else.
ANNOUNCED = {"": 1 << 28, "8MB": 1 << 23}

Send = Callable[[], object]


def repeat(send: Send, hz: float, seconds: float) -> int:
    """Call a function at a rate, as far as this machine can; return how often."""
    begin, count = time.monotonic(), 0
    while (since := time.monotonic() - begin) < seconds:
        for _ in range(int(hz * since) - count):
            send()
            count += 1
            if time.monotonic() - begin > seconds:
                break
        time.sleep(5e-4)
    return count


def points(size: int) -> Send:
    writer, frame = Peer().writer("/marble/position", PointStamped, reliable=False), "b" * size
    return lambda: writer.write(PointStamped(Header(stamp(), frame), Point(0.0, 0.0, 0.0)))


def joints(size: int) -> Send:
    writer = Peer().writer("/left/joint_states", JointState, reliable=False)
    names = ["other" + "_" * size]
    return lambda: writer.write(JointState(Header(stamp(), ""), names, [0.0], [0.0], [0.0]))


def e_stop(size: int) -> Send:
    writer = Peer().writer("/rig/e_stop", Bool, reliable=False)
    return lambda: writer.write(Bool(False))


def commands(size: int) -> Send:
    writer = Peer().writer("/left/joint_trajectory", JointTrajectory)
    point = TrajectoryPoint([0.3], [0.1])
    return lambda: writer.write(JointTrajectory(Header(stamp(), ""), ["left_wrist"], [point]))


def packets(kind: str, process: int, announced: int) -> Send:
    """Return a function that sends a broken packet to one of the ports of a rig."""
    # A further participant makes all others announce themselves.
    participant = Peer()
    known, random = heard(2.0), Random(34)
    writers, ports = writers_of(known), ports_of(process)
    assert writers, "no data was heard"
    assert ports, "no port is open"
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    number = 0

    def send() -> None:
        nonlocal number
        number += 1
        writer = random.choice(writers)
        data = {
            "noise": lambda: random.randbytes(random.randrange(1500)),
            "changed": lambda: changed(known, random),
            "lies": lambda: lie(writer, random),
            "fragments": lambda: large_fragment(writer, number, announced),
        }[kind]()
        port = random.choice(ports)
        # The first two ports belong to all participants of the machine.
        address = MULTICAST if port in {7400, 7401} else "127.0.0.1"
        sender.sendto(data[:65_000], (address, port))

    send.participant = participant  # type: ignore[attr-defined]  # it takes part as long as packets are sent
    return send


FLOODS = {"points": points, "joints": joints, "e-stop": e_stop, "commands": commands}
KINDS = ("noise", "changed", "lies", "fragments")


def main(attack: str, seconds: float, process: int) -> None:
    name, _, size = attack.partition(" ")
    if name in FLOODS:
        send = FLOODS[name](MEGABYTE if size else 0)
        time.sleep(1.0)  # until it is matched
    else:
        send = packets(name, process, ANNOUNCED[size])
    hz = FRAGMENTS_HZ if name == "fragments" else LARGE_HZ if size else OFTEN_HZ
    print("begins", flush=True)
    print(repeat(send, hz, seconds), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))
