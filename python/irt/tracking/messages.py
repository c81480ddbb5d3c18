# mypy: disable-error-code="call-arg, misc"
"""The ROS 2 messages that the tracker speaks, by their names on the wire; needs cyclonedds."""

# cyclonedds reads the annotations as they run: they must not be postponed.
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import float64, int32, uint32


@dataclass
@final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """A time since 1970."""

    sec: int32
    nanosec: uint32


@dataclass
@final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """When, and in which frame."""

    stamp: Time
    frame_id: str


@dataclass
@final
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    """A place."""

    x: float64
    y: float64
    z: float64


@dataclass
@final
class PointStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PointStamped_"):
    """A place at a time."""

    header: Header
    point: Point
