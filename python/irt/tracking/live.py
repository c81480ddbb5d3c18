"""The marble's place on ``/marble/position``, as ROS 2 nodes read it; no ROS is needed.

``geometry_msgs/PointStamped`` over DDS by the PyPI package ``cyclonedds``. The frame is ``board``, x and y
are in board edges as in recordings, the stamp is when the picture came. A marble that is lost is not
published: whoever listens sees it by the age of the last point.

Discovery stays on this machine's loopback unless ``CYCLONEDDS_URI`` says otherwise.
"""

from __future__ import annotations

import os
from typing import Any

from irt.errors import IrtError
from irt.extras import require

TOPIC = "/marble/position"
FRAME = "board"
#: Points that are kept for a reader which is slow, or has missed some.
DEPTH = 10
_LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
    "</General></Domain></CycloneDDS>"
)


class Publisher:
    """Publishes points.

    Parameters
    ----------
    topic : str
        A ROS topic's full name.
    domain : int
        ``ROS_DOMAIN_ID``.

    Raises
    ------
    IrtError
        If the package is missing, or the network refuses.
    """

    def __init__(self, topic: str = TOPIC, domain: int | None = None) -> None:
        os.environ.setdefault("CYCLONEDDS_URI", _LOOPBACK)
        require("cyclonedds", "irt track --publish")
        from cyclonedds.core import DDSException, Policy, Qos  # noqa: PLC0415
        from cyclonedds.domain import DomainParticipant  # noqa: PLC0415
        from cyclonedds.pub import DataWriter  # noqa: PLC0415
        from cyclonedds.topic import Topic  # noqa: PLC0415

        from irt.tracking import messages  # noqa: PLC0415

        if domain is None:
            domain = int(os.environ.get("ROS_DOMAIN_ID", "0"))
        # Reliable: heard by readers of either kind.
        quality = Qos(
            Policy.Reliability.Reliable(max_blocking_time=0),
            Policy.History.KeepLast(DEPTH),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        try:
            self._participant = DomainParticipant(domain)
            name = Topic(self._participant, f"rt{topic}", messages.PointStamped, qos=quality)
            self._writer: Any = DataWriter(self._participant, name, qos=quality)
        except DDSException as error:
            raise IrtError(f"{topic}: cannot be published: {error}") from error
        self._messages = messages

    def publish(self, x: float, y: float, wall: float) -> None:
        """Publish a place [board edges] that was seen at a time [s since 1970]."""
        messages = self._messages
        nanoseconds = round(wall * 1e9)
        stamp = messages.Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        header = messages.Header(stamp=stamp, frame_id=FRAME)
        self._writer.write(messages.PointStamped(header=header, point=messages.Point(x=x, y=y, z=0.0)))

    @property
    def listeners(self) -> int:
        """How many readers are matched."""
        return len(self._writer.get_matched_subscriptions())
