"""A rig that is flooded, or sent broken packets, stops when it is asked to; it takes little memory."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random
from subprocess import CompletedProcess
from typing import Any

import pytest
from floods import ATTACKS
from packets import Packet, Writer, changed, large_fragment, lie, submessages, writers_of

HERE = Path(__file__).resolve().parent
Inside = Callable[..., CompletedProcess[str]]

#: Number of laboratories at once.
TOGETHER = 2
#: safety.memory_mb is 100 here, and messages go on coming while the stop is repeated: 256 MB each 0.2 s [MB].
MOST_MB = 2000.0


def observe(attack: str, folder: Path, rig: Path, inside: Inside) -> dict[str, Any]:
    folder.mkdir()
    ran = inside(sys.executable, HERE / "floods.py", attack, folder, rig, timeout=300.0)
    if ran.returncode != 0:
        return {"error": ran.stderr.strip()[-2000:]}
    found: dict[str, Any] = json.loads(ran.stdout.strip().splitlines()[-1])
    return found


def wrong(attack: str, found: dict[str, Any]) -> list[str]:
    """Return the failed checks.

    Packets that lie can end the thread of the DDS library (rustdds 0.15.1, an index into an empty bitmap).
    The rig then hears nothing more, and has to stop by itself.
    """
    if "error" in found:
        return [f"it failed: {found['error']}"]
    panicked = re.findall(r"panicked at \S+", found["err"])
    if attack == "lies" and found.get("code") == "joints_silent":
        panicked = [one for one in panicked if "/registry/" not in one]
    checks = {
        "it was attacked": found["sent"] > 0,
        f"it is stopped: {found['err']}": found["status"] == 1 and f"({found.get('code')})" in found["err"],
        f"no thread panics: {panicked}": not panicked,
        "it is latched": bool(found.get("latched")),
        "at rest": bool(found.get("rests")),
        f"in time: {found.get('ramp_ticks')} ticks": found.get("ramp_ticks", 99) <= 13,
        f"memory is bounded: {found['peak_mb']} MB": found["peak_mb"] < MOST_MB,
        "it stops by itself far above its limit": found["peak_mb"] < 200.0 or found["code"] != "signal",
    }
    return [what for what, right in checks.items() if not right]


@pytest.mark.slow
@pytest.mark.usefixtures("cyclone")
def test_a_rig_under_attack_stops_in_time_and_takes_little_memory(
    rig: Path, inside: Inside, tmp_path: Path
) -> None:
    with ThreadPoolExecutor(TOGETHER) as pool:
        outcomes = pool.map(
            lambda attack: observe(attack, tmp_path / attack.replace(" ", "-"), rig, inside), ATTACKS
        )
        found = dict(zip(ATTACKS, outcomes, strict=True))
    failures = {attack: (what, one) for attack, one in found.items() if (what := wrong(attack, one))}
    assert not failures, json.dumps(failures, indent=1)


PREFIX, READER, ENTITY = bytes(range(12)), b"\0\0\0\x04", b"\0\0\x01\x03"


def data_packet(number: int) -> Packet:
    body = b"\0\0\x10\0" + READER + ENTITY + number.to_bytes(8, "big")[:4] + number.to_bytes(4, "little")
    message = b"\x15\x05" + len(body).to_bytes(2, "little") + body
    return Packet("127.0.0.1", 7411, b"RTPS\x02\x05\x01\x0f" + PREFIX + message)


def test_writers_are_found_in_packets_with_their_last_number() -> None:
    assert writers_of([data_packet(3), data_packet(7), data_packet(5)]) == [Writer(PREFIX, READER, ENTITY, 7)]


def test_packets_that_lie_are_well_formed_and_differ() -> None:
    writer, random = Writer(PREFIX, READER, ENTITY, 7), Random(1)
    made = [lie(writer, random) for _ in range(300)]
    assert len(set(made)) == len(made)
    kinds = {kind for data in made for kind, _, _ in submessages(data)}
    assert kinds == {0x06, 0x07, 0x08, 0x09, 0x12, 0x13, 0x15, 0x16}
    assert all(20 + sum(4 + len(body) for _, _, body in submessages(data)) == len(data) for data in made)
    (kind, _, body), *others = submessages(large_fragment(writer, 1))
    assert (kind, others) == (0x16, [])
    assert int.from_bytes(body[28:32], "little") == 2**28


def test_changed_packets_differ_from_real_ones() -> None:
    real = [data_packet(number) for number in range(1, 9)]
    random = Random(1)
    differ = [changed(real, random) not in {one.data for one in real} for _ in range(100)]
    assert sum(differ) > 90
