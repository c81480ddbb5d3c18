"""A peer without a certificate: it poses as tracker and arm, commands the arms, and uses the e-stop.

``python intruder.py SECONDS`` prints how many readers and writers of others it has matched at most.
"""

from __future__ import annotations

import sys
import time

from ros import Bool, Header, JointState, JointTrajectory, Peer, Point, PointStamped, TrajectoryPoint, stamp

#: A place of the marble that no other peer sends [board edges].
PLACE = 0.123456
_JOINTS = ("left", "right")


def main(seconds: float) -> None:
    peer = Peer()
    points = peer.writer("/marble/position", PointStamped, reliable=False)
    e_stop = peer.writer("/rig/e_stop", Bool)
    # The other arm's are listened to.
    states = peer.writer("/right/joint_states", JointState, reliable=False)
    commands = [peer.writer(f"/{side}/joint_trajectory", JointTrajectory) for side in _JOINTS]
    overheard = peer.reader("/left/joint_states", JointState, reliable=False)
    writers = (points, e_stop, states, *commands)
    matched, end, count = 0, time.monotonic() + seconds, 0
    while time.monotonic() < end:
        now = stamp()
        points.write(PointStamped(Header(now, "board"), Point(PLACE, PLACE, 0.0)))
        count += 1
        e_stop.write(Bool(count % 2 == 0))
        states.write(JointState(Header(now, ""), ["right_j2s7s300_joint_7"], [0.3], [0.0], [0.0]))
        for side, writer in zip(_JOINTS, commands, strict=True):
            point = TrajectoryPoint([0.3], [0.0])
            writer.write(JointTrajectory(Header(now, ""), [f"{side}_j2s7s300_joint_7"], [point]))
        matches = [one.get_publication_matched_status().current_count for one in writers]
        found = overheard.get_subscription_matched_status().current_count
        matched = max(matched, sum(matches) + found)
        time.sleep(0.02)
    print(matched)


if __name__ == "__main__":
    main(float(sys.argv[1]))
