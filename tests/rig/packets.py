"""Packets of DDS as an attacker sends them: changed ones of a running network, and ones whose numbers lie.

Numbers of submessages and entities are those of the RTPS specification 2.5, sections 9.3.1.2 and 9.4.5.
"""

from __future__ import annotations

import socket
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "fuzz"))

from mutations import edited

MULTICAST = "239.255.0.1"
#: Ports of discovery and of data in domain 0, those of its first 120 participants included.
PORTS = range(7400, 7650)
_ALL = 0x0003
_NEXT = (
    *(0, 1, 255, 256, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**48),
    *(2**62, 2**63 - 257, 2**63 - 2, 2**63 - 1),
)
_SIZES = (0, 1, 255, 65_535, 2**20, 2**26, 2**31 - 1, 2**31, 2**32 - 1)


class Packet(NamedTuple):
    """A packet of RTPS, and where it went."""

    address: str
    port: int
    data: bytes


class Writer(NamedTuple):
    """A writer that has sent data: its participant, the entities, and the last number."""

    prefix: bytes
    reader: bytes
    entity: bytes
    number: int


def heard(seconds: float) -> list[Packet]:
    """Return the packets of RTPS on the loopback in the next seconds, each once."""
    found: dict[Packet, None] = {}
    with socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ALL)) as listener:
        listener.settimeout(0.1)
        end = time.monotonic() + seconds
        while time.monotonic() < end and len(found) < 5000:
            try:
                data = listener.recv(1 << 17)
            except TimeoutError:
                continue
            begin = 4 * (data[0] & 15)
            port = struct.unpack(">H", data[begin + 2 : begin + 4])[0]
            if data[9] == socket.IPPROTO_UDP and data[begin + 8 : begin + 12] == b"RTPS":
                found[Packet(socket.inet_ntoa(data[16:20]), port, data[begin + 8 :])] = None
    return list(found)


def ports_of(process: int) -> list[int]:
    """Return the UDP ports of DDS on which a process listens."""
    inodes = set()
    for link in Path(f"/proc/{process}/fd").iterdir():
        target = str(link.readlink()) if link.is_symlink() else ""
        if target.startswith("socket:["):
            inodes.add(target[len("socket:[") : -1])
    rows = [row.split() for row in Path(f"/proc/{process}/net/udp").read_text().splitlines()[1:]]
    ports = {int(row[1].split(":")[1], 16) for row in rows if row[9] in inodes}
    return sorted(port for port in ports if port in PORTS)


def submessages(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield kind, flags and body of each submessage of a packet."""
    at = 20
    while at + 4 <= len(data):
        kind, flags = data[at], data[at + 1]
        length = struct.unpack_from("<H" if flags & 1 else ">H", data, at + 2)[0]
        yield kind, flags, data[at + 4 : at + 4 + length] if length else data[at + 4 :]
        at += 4 + (length or len(data))


def writers_of(packets: list[Packet]) -> list[Writer]:
    """Return the writers whose data is in packets, each with its highest number."""
    found: dict[bytes, Writer] = {}
    for packet in packets:
        for kind, flags, body in submessages(packet.data):
            if kind in {0x15, 0x16} and flags & 1 and len(body) >= 20:  # DATA, DATA_FRAG
                high, low = struct.unpack_from("<iI", body, 12)
                writer = Writer(packet.data[8:20], body[4:8], body[8:12], (high << 32) + low)
                key = writer.prefix + writer.entity
                if key not in found or found[key].number < writer.number:
                    found[key] = writer
    return list(found.values())


def _number(value: int) -> bytes:
    return struct.pack("<iI", (value >> 32) % 2**31, value % 2**32)


def _set(base: int, bits: int) -> bytes:
    words = min((bits + 31) // 32, 8)
    return _number(base) + struct.pack("<I", bits) + b"\xff" * (4 * words)


def _packet(prefix: bytes, *parts: tuple[int, int, bytes]) -> bytes:
    data = b"RTPS\x02\x05\x01\x0f" + prefix
    for kind, flags, body in parts:
        data += struct.pack("<BBH", kind, flags | 1, len(body)) + body
    return data


def lie(writer: Writer, random: Random) -> bytes:
    """Return a packet in the name of a writer, with numbers that no writer has."""
    far = random.choice((writer.number + random.choice(_NEXT), random.choice(_NEXT))) % 2**63
    other = random.choice((far, 1, writer.number, *_NEXT)) % 2**63
    ends, count = writer.reader + writer.entity, struct.pack("<i", random.randrange(-(2**31), 2**31))
    bits = random.choice((0, 1, 31, 256, 257, 2**31, 2**32 - 1))
    size, part = random.choice(_SIZES), random.choice((0, 1, 1024, 65_535))
    first = random.choice((0, 1, 2, 2**31, 2**32 - 1))
    fragment = struct.pack("<IHHI", first, random.choice((0, 1, 2, 65_535)), part, size)
    body = random.randbytes(random.choice((0, 4, 1024)))
    kinds = (
        (0x07, 0, ends + _number(other) + _number(far) + count),  # HEARTBEAT
        (0x08, 0, ends + _number(other) + _set(far, bits)),  # GAP
        (0x06, 0, ends + _set(far, bits) + count),  # ACKNACK
        (0x12, 0, ends + _number(far) + struct.pack("<II", first, bits) + b"\xff" * 32 + count),  # NACK_FRAG
        (0x13, 0, ends + _number(far) + struct.pack("<I", first) + count),  # HEARTBEAT_FRAG
        (0x16, 0, b"\0\0\x1c\0" + ends + _number(far) + fragment + body),  # DATA_FRAG
        (0x15, 4, b"\0\0\x10\0" + ends + _number(far) + b"\0\x01\0\0" + body),  # DATA
    )
    info = (0x09, 0, random.randbytes(8))  # INFO_TS
    return _packet(writer.prefix, *random.sample((info, *kinds), random.randrange(1, 4)))


def large_fragment(writer: Writer, ahead: int, size: int = 2**28) -> bytes:
    """Return the first fragment of data of this size [bytes]."""
    fragment = struct.pack("<IHHI", 1, 1, 65_535, size)
    ends = writer.reader + writer.entity
    return _packet(
        writer.prefix, (0x16, 0, b"\0\0\x1c\0" + ends + _number(writer.number + ahead) + fragment + bytes(64))
    )


def changed(packets: list[Packet], random: Random) -> bytes:
    """Return a packet with up to four changes."""
    return edited(
        random.choice(packets).data, [random.getrandbits(64) for _ in range(random.randrange(1, 5))]
    )
