"""What a bag holds, read by programs that are not ours; and bags that cannot be taken."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from laboratory import CONFIG, DEFAULTS, messages
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from irt.bag import load_bag
from irt.errors import IrtError

HERE = Path(__file__).resolve().parent
Inside = Callable[..., CompletedProcess[str]]

LISTEN = '"$1" listen --seconds "$2" --out bags & "$3" "$4" points "$5" "$6" && wait $!'


@pytest.mark.slow
@pytest.mark.usefixtures("cyclone")
@pytest.mark.parametrize(("hz", "count"), [(100, 300), (1000, 3000)])
def test_no_point_is_lost(rig: Path, inside: Inside, tmp_path: Path, hz: int, count: int) -> None:
    (tmp_path / "rig.toml").write_text(CONFIG.format_map({**DEFAULTS, "reliability": "reliable"}))
    words = (rig, "12", sys.executable, HERE / "devices.py", str(count), str(hz))
    ran = inside("bash", "-c", LISTEN, "_", *words, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    bag = tmp_path / "bags" / "listen.mcap"
    numbers = [int(one.point.x) for topic, _, one in messages(bag) if topic == "/marble/position"]
    assert numbers == list(range(count))
    with pytest.raises(IrtError, match="contains no played file"):
        load_bag(bag)


def test_another_reader_reads_the_bag(rig: Path, inside: Inside, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(CONFIG.format_map(DEFAULTS))
    ran = inside(rig, "listen", "--seconds", "1", "--out", "bags", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    types = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(tmp_path / "bags" / "listen.mcap") as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        texts = [
            types.deserialize_cdr(data, connection.msgtype).msg
            for connection, _, data in reader.messages()
            if connection.topic == "/rig/events"
        ]
    assert kinds["/marble/position"] == "geometry_msgs/msg/PointStamped"
    assert kinds["/left/joint_states"] == "sensor_msgs/msg/JointState"
    assert texts[0].startswith("no peer is authenticated: every program that reaches 127.0.0.1 ")
    assert texts[1:] == ["listening", "nothing was commanded"]


@pytest.mark.parametrize(
    ("content", "said"), [(b"no bag", "not a bag"), (b"\x89MCAP0\r\n", "rig recover")], ids=["text", "cut"]
)
def test_what_is_no_bag_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "bag.mcap"
    path.write_bytes(content)
    with pytest.raises(IrtError, match=said):
        load_bag(path)
