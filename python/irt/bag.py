"""Read bags recorded by `rig`: commands, joint states and marble positions from an MCAP file of ROS 2."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.extras import require
from irt.files import PathLike, TomlTable, parse_toml

Array = NDArray[np.float64]

#: Topics that `rig` adds to a bag: events, the rows of played files, and set points.
EVENTS, ROWS, SET_POINTS = "/rig/events", "/rig/command", "/rig/setpoint"
_ERROR = 40
#: Largest angle [rad] or position [board edges]; larger ones are broken, and their squares may overflow.
_LARGEST = 1e6


@dataclass(frozen=True, eq=False)
class Series:
    """The messages of a topic as a time series.

    Attributes
    ----------
    stamps : (n,) array
        Stamps of the messages [s since 1970], strictly increasing.
    values : (n, 2) array
        Values of the messages, never NaN.
    ages : (n,) array
        Age of the stamps on arrival [s]: transport, and the difference of the clocks.
    """

    stamps: Array
    values: Array
    ages: Array


@dataclass(frozen=True, eq=False)
class Play:
    """A played file.

    Attributes
    ----------
    name : str
        Name of the file, without suffix.
    stamps : (n,) array
        Time at which each row was issued [s since 1970].
    end : float
        End of the last row, or time of the stop [s since 1970].
    stop : str
        Reason of the stop, empty if there was none.
    """

    name: str
    stamps: Array
    end: float
    stop: str


@dataclass(frozen=True, eq=False)
class Bag:
    """The contents of a bag.

    Attributes
    ----------
    path : Path
        The file.
    edge_x_m : float
        The board's long edge [m], as the rig was configured at the time of the recording.
    plays : tuple of Play
        Played files, in order.
    set_points : Series
        Commanded knob angles [rad].
    measured : Series or None
        Measured knob angles [rad]; None unless both joints were recorded.
    marble : Series
        Positions [board edges].
    """

    path: Path
    edge_x_m: float
    plays: tuple[Play, ...]
    set_points: Series
    measured: Series | None
    marble: Series


@dataclass(frozen=True)
class _Arm:
    """An arm in the rig's configuration: joint angle = level + gear x knob angle."""

    joint: str
    topic: str
    gear: float
    level_rad: float


def load_bag(path: PathLike) -> Bag:
    """Read a bag.

    Raises
    ------
    IrtError
        If the bag cannot be read, is broken or truncated, or was recorded by another program, or if the
        packages for bags are not installed.
    """
    require("mcap_ros2", "reading a bag")
    path = Path(path)
    try:
        stream = path.open("rb")
    except OSError as error:
        raise IrtError(f"{path}: cannot be read: {error.strerror}") from error
    with stream, _of_library(path):
        return _read(path, stream)


def is_own(path: PathLike) -> bool:
    """Return whether `rig` recorded a bag: it contains the rig's configuration, or is broken."""
    require("mcap_ros2", "reading a bag")
    from mcap.reader import make_reader  # noqa: PLC0415

    try:
        with Path(path).open("rb") as stream, _of_library(Path(path)):
            return any(one.name == "rig.toml" for one in make_reader(stream).iter_attachments())
    except (IrtError, OSError):
        return True


@contextmanager
def _of_library(path: Path) -> Iterator[None]:
    """Turn what the library makes of broken bytes into one line.

    It raises errors of all kinds, `MemoryError` for a length that lies among them, and its parser of message
    definitions prints.
    """
    try:
        with redirect_stderr(io.StringIO()):
            yield
    except IrtError:
        raise
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise IrtError(
            f"{path}: not a bag, or one that was cut short ({reason}); try 'rig recover {path}'"
        ) from error


def _read(path: Path, stream: IO[bytes]) -> Bag:
    from mcap.reader import make_reader  # noqa: PLC0415
    from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415

    reader = make_reader(stream, decoder_factories=[DecoderFactory()])
    if reader.get_summary() is None:
        raise IrtError(f"{path}: was cut short; repair it with 'rig recover {path}'")
    attached = {one.name: one.data for one in reader.iter_attachments()}
    if "rig.toml" not in attached:
        raise IrtError(f"{path}: another program recorded it (no rig.toml in it); record with 'rig play'")
    messages: dict[str, list[Any]] = {}
    for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
        age = (message.log_time - message.publish_time) / 1e9
        messages.setdefault(channel.topic, []).append((age, decoded))
    if ROWS not in messages or SET_POINTS not in messages:
        raise IrtError(f"{path}: contains no played file (no {ROWS}); record it with 'rig play'")
    config = parse_toml(f"{path}, rig.toml", attached["rig.toml"])
    joints = [_joint(messages, arm) for arm in _arms(config.section("arms"))]
    tracker = config.section("tracker")
    edge = _within(tracker, "edge_x_m", 0.276, 0.01, 10.0)
    unit = 1.0 / edge if tracker.content.get("unit") == "m" else 1.0
    topic = tracker.word("topic") if "topic" in tracker else "/marble/position"
    points = [
        (age, message.header, (message.point.x * unit, message.point.y * unit))
        for age, message in messages.get(topic, [])
    ]
    return Bag(
        path=path,
        edge_x_m=edge,
        plays=tuple(_plays(messages)),
        set_points=_series([(age, point.header, point.position) for age, point in messages[SET_POINTS]]),
        measured=_together(*joints),
        marble=_series(points),
    )


def _arms(table: TomlTable) -> Iterator[_Arm]:
    """Yield the arms about x and about y."""
    for arm in (table.section("x"), table.section("y")):
        gear = arm.number("gear")
        if not 1e-3 <= abs(gear) <= 1e3:
            raise arm.error("gear", f"expected 0.001 to 1000 in either direction, found {gear:g}")
        yield _Arm(arm.word("joint"), arm.word("joint_states"), gear, arm.number("level_rad"))


def _within(table: TomlTable, key: str, otherwise: float, low: float, high: float) -> float:
    number = table.number(key) if key in table else otherwise
    if not low <= number <= high:
        raise table.error(key, f"expected a number from {low:g} to {high:g}, found {number:g}")
    return number


def _stamp(time: Any) -> float:
    return float(time.sec) + float(time.nanosec) / 1e9


def _series(messages: list[tuple[float, Any, Any]]) -> Series:
    """Return messages as a series, without impossible values and stamps that do not increase."""
    kept: list[tuple[float, float, float, float]] = []
    for age, header, (x, y) in messages:
        stamp = _stamp(header.stamp)
        if abs(x) <= _LARGEST and abs(y) <= _LARGEST and (not kept or stamp > kept[-1][0]):
            kept.append((stamp, x, y, age))
    columns = np.array(kept, dtype=np.float64).reshape(-1, 4)
    return Series(columns[:, 0], columns[:, 1:3], columns[:, 3])


def _joint(messages: dict[str, list[Any]], arm: _Arm) -> Series:
    """Return the knob angle of a joint in the first column; the second is not used."""
    found = []
    for age, message in messages.get(arm.topic, []):
        if arm.joint in message.name:
            angle = message.position[list(message.name).index(arm.joint)]
            found.append((age, message.header, (angle, 0.0)))
    series = _series(found)
    joint = np.unwrap(series.values[:, 0])
    turned = joint - arm.level_rad
    if turned.size:
        # A continuous joint may be some full turns away from its configured level.
        turned = turned - 2.0 * np.pi * np.round(turned[0] / (2.0 * np.pi))
    return Series(series.stamps, np.column_stack([turned / arm.gear, np.zeros(turned.size)]), series.ages)


def _together(x: Series, y: Series) -> Series | None:
    """Return both knob angles at the stamps of the first."""
    if x.stamps.size < 2 or y.stamps.size < 2:
        return None
    other = np.interp(x.stamps, y.stamps, y.values[:, 0])
    return Series(x.stamps, np.column_stack([x.values[:, 0], other]), x.ages)


def _plays(messages: dict[str, list[Any]]) -> Iterator[Play]:
    stops = [
        (_stamp(event.stamp), str(event.msg))
        for _, event in messages.get(EVENTS, [])
        if event.level >= _ERROR and event.function.startswith("stopping:")
    ]
    rows = [(message.header.frame_id, _stamp(message.header.stamp)) for _, message in messages[ROWS]]
    for name in dict.fromkeys(name for name, _ in rows):
        stamps = np.array([stamp for run, stamp in rows if run == name])
        end = stamps[-1] + (stamps[-1] - stamps[-2] if stamps.size > 1 else 0.0)
        stop = next(((at, why) for at, why in stops if stamps[0] <= at <= end), None)
        yield Play(name, stamps, end if stop is None else stop[0], "" if stop is None else stop[1])
