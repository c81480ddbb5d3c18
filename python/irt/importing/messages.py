"""Definitions of the labs' ROS 2 messages, which sqlite3 bags of Humble do not contain.

Written from the published names and types of the fields, each without and with a header, because forks have
both. The first message of a bag shows its variant.
"""

from __future__ import annotations

_STATE = "float64 x_b\nfloat64 y_b\nfloat64 x_b_dot\nfloat64 y_b_dot\nfloat64 alpha\nfloat64 beta\n"
_VELOCITIES = "float64 vel_1\nfloat64 vel_2\n"
_HEADER = "std_msgs/Header header\n"

#: Message types, by their name without the package, that hold a state.
STATES = ("StateEstimate", "StateEstimateSub")
#: The same of commands.
COMMANDS = ("DynamixelVel", "HiwonderVel")

_FIELDS = {
    "StateEstimate": _STATE,
    "DynamixelVel": _VELOCITIES,
    "HiwonderVel": _VELOCITIES,
}


def short_name(kind: str) -> str:
    """Return a message type without its package: ``cyberrunner_interfaces/msg/X`` is ``X``."""
    return kind.rpartition("/")[2]


def definitions(kind: str, *, header: bool) -> dict[str, str] | None:
    """Return the texts of a message type and of those that it holds, by full name; None if it is unknown."""
    name, package = short_name(kind), kind.partition("/")[0]
    head = _HEADER if header else ""
    if name in _FIELDS:
        return {kind: head + _FIELDS[name]}
    if name == "StateEstimateSub":
        state = f"{package}/msg/StateEstimate"
        return {
            state: head + _STATE,
            kind: f"{package}/StateEstimate state\nsensor_msgs/Image subimg\n",
        }
    return None
