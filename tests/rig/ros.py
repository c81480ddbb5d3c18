"""ROS 2 messages for Cyclone DDS, and a participant that stays on the loopback.

Cyclone reads the types of fields as they are written: no annotations from the future here.
"""

import os
import time
from dataclasses import dataclass, field
from typing import Any

# Before Cyclone starts: it would speak on every interface.
os.environ["CYCLONEDDS_URI"] = (
    "<CycloneDDS><Domain><General><Interfaces>"
    '<NetworkInterface address="127.0.0.1" multicast="true"/>'
    "</Interfaces></General><Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"
)

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import float32, float64, int8, int32, int64, sequence, uint8, uint16, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
@final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
@final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
@final
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
@final
class PointStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PointStamped_"):
    header: Header = field(default_factory=Header)
    point: Point = field(default_factory=Point)


@dataclass
@final
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header = field(default_factory=Header)
    name: sequence[str] = field(default_factory=list)
    position: sequence[float64] = field(default_factory=list)
    velocity: sequence[float64] = field(default_factory=list)
    effort: sequence[float64] = field(default_factory=list)


@dataclass
@final
class TrajectoryPoint(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64] = field(default_factory=list)
    velocities: sequence[float64] = field(default_factory=list)
    accelerations: sequence[float64] = field(default_factory=list)
    effort: sequence[float64] = field(default_factory=list)
    time_from_start: Time = field(default_factory=Time)


@dataclass
@final
class JointTrajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    header: Header = field(default_factory=Header)
    joint_names: sequence[str] = field(default_factory=list)
    points: sequence[TrajectoryPoint] = field(default_factory=list)


@dataclass
@final
class Dimension(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"):
    label: str = ""
    size: uint32 = 0
    stride: uint32 = 0


@dataclass
@final
class Layout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    dim: sequence[Dimension] = field(default_factory=list)
    data_offset: uint32 = 0


@dataclass
@final
class Float64MultiArray(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    layout: Layout = field(default_factory=Layout)
    data: sequence[float64] = field(default_factory=list)


@dataclass
@final
class JointVelocity(IdlStruct, typename="kinova_msgs::msg::dds_::JointVelocity_"):
    joint1: float32 = 0.0
    joint2: float32 = 0.0
    joint3: float32 = 0.0
    joint4: float32 = 0.0
    joint5: float32 = 0.0
    joint6: float32 = 0.0
    joint7: float32 = 0.0


@dataclass
@final
class Bool(IdlStruct, typename="std_msgs::msg::dds_::Bool_"):
    data: bool = False


@dataclass
@final
class TriggerRequest(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    """A request as Cyclone's ROS 2 layer sends it, behind the number of who asks."""

    client: uint64 = 0
    number: int64 = 0
    structure_needs_at_least_one_member: uint8 = 0


@dataclass
@final
class TriggerResponse(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    client: uint64 = 0
    number: int64 = 0
    success: bool = False
    message: str = ""


@dataclass
@final
class StateEstimate(IdlStruct, typename="cyberrunner_interfaces::msg::dds_::StateEstimate_"):
    x_b: float64 = 0.0
    y_b: float64 = 0.0
    x_b_dot: float64 = 0.0
    y_b_dot: float64 = 0.0
    alpha: float64 = 0.0
    beta: float64 = 0.0


@dataclass
@final
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header = field(default_factory=Header)
    height: uint32 = 0
    width: uint32 = 0
    encoding: str = ""
    is_bigendian: uint8 = 0
    step: uint32 = 0
    data: sequence[uint8] = field(default_factory=list)


@dataclass
@final
class StateEstimateSub(IdlStruct, typename="cyberrunner_interfaces::msg::dds_::StateEstimateSub_"):
    state: StateEstimate = field(default_factory=StateEstimate)
    subimg: Image = field(default_factory=Image)


@dataclass
@final
class DynamixelVel(IdlStruct, typename="cyberrunner_interfaces::msg::dds_::DynamixelVel_"):
    vel_1: float64 = 0.0
    vel_2: float64 = 0.0


@dataclass
@final
class ResetRequest(IdlStruct, typename="cyberrunner_interfaces::srv::dds_::DynamixelReset_Request_"):
    client: uint64 = 0
    number: int64 = 0
    max_temp: uint16 = 0


@dataclass
@final
class ResetResponse(IdlStruct, typename="cyberrunner_interfaces::srv::dds_::DynamixelReset_Response_"):
    client: uint64 = 0
    number: int64 = 0
    success: int8 = 0


def qos(*, reliable: bool = True, depth: int = 100) -> Qos:
    reliability = Policy.Reliability.Reliable(duration(milliseconds=100))
    return Qos(
        reliability if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


class Peer:
    """A participant of a domain."""

    def __init__(self, domain: int = 0) -> None:
        self.participant = DomainParticipant(domain)

    def writer(self, name: str, kind: type, *, reliable: bool = True) -> DataWriter:
        topic = Topic(self.participant, f"rt{name}", kind)
        return DataWriter(self.participant, topic, qos=qos(reliable=reliable))

    def reader(self, name: str, kind: type, *, reliable: bool = True) -> DataReader:
        topic = Topic(self.participant, f"rt{name}", kind)
        return DataReader(self.participant, topic, qos=qos(reliable=reliable, depth=5000))

    def call(self, name: str, request: IdlStruct, answer: type, seconds: float) -> Any:
        """Ask a service, with 7 as the number of who asks; return its answer, or None after a time."""
        asked = Topic(self.participant, f"rq{name}Request", type(request))
        answered = Topic(self.participant, f"rr{name}Reply", answer)
        writer = DataWriter(self.participant, asked, qos=qos())
        reader = DataReader(self.participant, answered, qos=qos())
        end = time.monotonic() + seconds
        while time.monotonic() < end and not writer.get_publication_matched_status().current_count:
            time.sleep(0.02)
        writer.write(request)
        while time.monotonic() < end:
            found = [one for one in reader.take(N=10) if one.client == 7]
            if found:
                return found[0]
            time.sleep(0.01)
        return None

    def call_trigger(self, name: str, seconds: float) -> bool:
        """Ask a service of std_srvs/Trigger; say whether it answered yes."""
        answer = self.call(name, TriggerRequest(client=7, number=1), TriggerResponse, seconds)
        return answer is not None and bool(answer.success)


def stamp(seconds: float | None = None) -> Time:
    """Return a moment, or now."""
    nanos = time.time_ns() if seconds is None else int(seconds * 1e9)
    return Time(nanos // 10**9, nanos % 10**9)
