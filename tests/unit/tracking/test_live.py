"""Points on `/marble/position`, read by a peer in a private network."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

from irt.tracking import live

PEER = """
import sys, time
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from irt.tracking.live import Publisher
from irt.tracking.messages import PointStamped
sent = Publisher(domain=77)
qos = Qos(Policy.Reliability.BestEffort, Policy.DataRepresentation(use_cdrv0_representation=True))
participant = DomainParticipant(77)
reader = DataReader(participant, Topic(participant, "rt/marble/position", PointStamped, qos=qos), qos=qos)
for _ in range(1000):
    sent.publish(0.125, -0.25, 1700000000.5)
    for one in reader.take(10):
        if hasattr(one, "point"):
            stamp = one.header.stamp
            print(one.point.x, one.point.y, stamp.sec, stamp.nanosec, one.header.frame_id)
            sys.exit()
    time.sleep(0.05)
sys.exit("nothing came")
"""
NAMESPACE = 'ip link set lo up; ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo; exec "$@"'


def test_points_reach_a_reader_in_a_network_of_its_own() -> None:
    pytest.importorskip("cyclonedds", reason="publishing needs cyclonedds: pip install labsim-irt[ros]")
    if not shutil.which("unshare") or not shutil.which("ip"):
        pytest.skip("no unshare or ip here to make a private network with")
    if subprocess.run(["unshare", "-n", "true"], capture_output=True, check=False).returncode:
        pytest.skip("this user may not make a private network (unshare -n)")
    command = ["unshare", "-n", "bash", "-c", NAMESPACE, "_", sys.executable, "-c", PEER]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.split() == ["0.125", "-0.25", "1700000000", "500000000", live.FRAME]
