"""Programs that disturb a rig on its own network, each until it is killed.

``python attackers.py KIND COUNT`` writes how many messages or packets it has sent to the file COUNT.
"""

from __future__ import annotations

import random
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from ros import Bool, Header, JointState, Peer, Point, PointStamped, stamp

#: The discovery ports of domain 0: multicast, and those of the first participants.
MULTICAST = ("239.255.0.1", 7400)
UNICAST = [("127.0.0.1", port) for port in range(7410, 7430)]

#: Discovery packets of other programs that are kept to be changed.
KEPT = 200

LIES = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF)

#: RTPS submessages: DATA, HEARTBEAT, ACKNACK, INFO_TS, GAP, DATA_FRAG, secure ones, and none.
SUBMESSAGES = (0x15, 0x07, 0x06, 0x09, 0x08, 0x16, 0x12, 0x13, 0x30, 0x33, 0x00, 0xFF)


def broken_packets(draws: random.Random, seen: list[bytes]) -> Iterator[bytes]:
    """Yield random bytes, submessages that lie about their length, and changed packets of others."""
    while True:
        kind = draws.random()
        if kind < 0.1:
            yield draws.randbytes(draws.randrange(1, 1400))
        elif kind < 0.4 or not seen:
            packet = b"RTPS\x02\x04" + draws.randbytes(14)
            for _ in range(draws.randrange(1, 5)):
                body = draws.randbytes(draws.randrange(0, 120))
                length = draws.choice((len(body), draws.choice(LIES) & 0xFFFF))
                kind_and_flags = bytes([draws.choice(SUBMESSAGES), draws.randrange(256)])
                packet += kind_and_flags + length.to_bytes(2, "little") + body
            yield packet
        else:
            packet = bytearray(draws.choice(seen))
            for _ in range(draws.randrange(1, 6)):
                at = draws.randrange(20, len(packet))
                edit = draws.randrange(4)
                if edit == 0:
                    packet[at] ^= 1 << draws.randrange(8)
                elif edit == 1:
                    packet[at : at + 4] = draws.choice(LIES).to_bytes(4, "little")
                elif edit == 2:
                    packet[at:at] = packet[at : at + draws.randrange(1, 64)]
                elif len(packet) > 40:
                    del packet[max(at, 24) :]
            yield bytes(packet[:60_000])


def packets(count: Path) -> None:
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    listener.bind(("", MULTICAST[1]))
    group = socket.inet_aton(MULTICAST[0]) + socket.inet_aton("127.0.0.1")
    listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    listener.setblocking(False)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    draws, seen = random.Random(1), []
    made = broken_packets(draws, seen)

    def send() -> None:
        while len(seen) < KEPT:
            try:
                seen.append(listener.recv(65_536))
            except BlockingIOError:
                break
        sender.sendto(next(made), draws.choice([MULTICAST, *UNICAST]))

    repeat(send, 10_000.0, count)


def repeat(send: Callable[[], None], hz: float, count: Path) -> None:
    """Call at a rate; what is late is made up for."""
    begin, sent = time.monotonic(), 0
    while True:
        while sent < hz * (time.monotonic() - begin):
            send()
            sent += 1
            if sent % 100 == 0:
                count.write_text(f"{sent}")
        time.sleep(0.0005)


def e_stop(count: Path) -> None:
    """Say ten thousand times a second that nobody presses it."""
    writer = Peer().writer("/rig/e_stop", Bool, reliable=False)
    repeat(lambda: writer.write(Bool(False)), 10_000.0, count)


def joints(count: Path) -> None:
    """Send ten thousand states a second of joints that are not asked for."""
    writer = Peer().writer("/left/joint_states", JointState, reliable=False)
    state = JointState(Header(stamp(), ""), ["other"], [0.0], [0.0], [0.0])
    repeat(lambda: writer.write(state), 10_000.0, count)


def big_joints(count: Path) -> None:
    """Send fifty states a second of one megabyte."""
    writer = Peer().writer("/left/joint_states", JointState)
    state = JointState(Header(stamp(), ""), ["other"], [0.0] * 125_000, [], [])
    repeat(lambda: writer.write(state), 50.0, count)


def points(count: Path) -> None:
    """Send ten thousand points a second, beside the tracker."""
    writer = Peer().writer("/marble/position", PointStamped, reliable=False)
    repeat(lambda: writer.write(PointStamped(Header(stamp(), ""), Point())), 10_000.0, count)


KINDS = {"packets": packets, "e_stop": e_stop, "joints": joints, "big_joints": big_joints, "points": points}

if __name__ == "__main__":
    KINDS[sys.argv[1]](Path(sys.argv[2]))
