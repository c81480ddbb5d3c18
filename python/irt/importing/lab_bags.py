"""Bags of CyberRunner, TAG and their forks: rosbag2 in MCAP or sqlite3, read without ROS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.extras import require
from irt.importing.messages import COMMANDS, STATES, definitions, short_name

Array = NDArray[np.float64]
Columns = dict[str, Array]
Progress = Callable[[int, int, str], None]

#: Headers older than this at receipt [s], or from the future, belong to another clock.
_OLDEST_S = 0.5
_NEWEST_S = -0.002
#: Messages between two reports of progress.
_REPORT = 2000


def topics_of(path: Path) -> dict[str, str]:
    """Return the message type of each topic of a bag.

    Raises
    ------
    IrtError
        If it is no bag, or a truncated one.
    """
    with _Opened(path) as reader:
        return {one.topic: one.msgtype for one in reader.connections}


def read_bag(
    path: Path, topics: Sequence[str] = (), progress: Progress | None = None
) -> tuple[Columns, Columns, tuple[str, ...]]:
    """Return the columns of states and of commands, with stamps ``t_s`` [s], and notes.

    States and commands are found by the type of their messages. Stamps are the times of receipt, or those
    of the headers if messages have them; headers of another clock are converted to the bag's.

    Parameters
    ----------
    path : Path
        An ``.mcap`` or ``.db3`` file, or the folder of a bag.
    topics : sequence of str
        Topics to use if several hold states or commands.
    progress : callable, optional
        Called with messages read, messages in all, and a text.

    Raises
    ------
    IrtError
        If the bag cannot be read, or states are missing, ambiguous or of an unknown type.
    """
    with _Opened(path) as reader:
        kinds = {one.topic: one for one in reader.connections}
        for topic in topics:
            if topic not in kinds:
                raise IrtError(f"{path}: no topic {topic}; the bag has {_listed(reader.connections)}")
        notes: list[str] = []
        state = _chosen(path, reader.connections, STATES, topics, notes)
        if state is None:
            raise IrtError(
                f"{path}: no topic with states ({' or '.join(STATES)}); the bag has "
                f"{_listed(reader.connections)}"
            )
        command = _chosen(path, reader.connections, COMMANDS, topics, notes)
        wanted = [one for one in (state, command) if one is not None]
        decoders = {one.topic: _Decoder(path, one) for one in wanted}
        rows: dict[str, list[tuple[float, float, dict[str, float]]]] = {one.topic: [] for one in wanted}
        total = sum(one.msgcount for one in wanted)
        try:
            for done, (connection, nanos, data) in enumerate(reader.messages(wanted)):
                if progress is not None and done % _REPORT == 0:
                    progress(done, total, f"reading {path.name}")
                stamp, values = decoders[connection.topic].read(data)
                rows[connection.topic].append((nanos / 1e9, stamp, values))
        except IrtError:
            raise
        except Exception as error:
            raise IrtError(f"{path}: broken or cut short ({_reason(error)}); {_mend(path)}") from error
    if not rows[state.topic]:
        raise IrtError(f"{path}: {state.topic} holds no messages; record the states again")
    notes.insert(0, f"states from {state.topic} ({state.msgtype})")
    states = _columns(rows[state.topic], state.topic, notes)
    if command is None or not rows[command.topic]:
        notes.append("no commands in the bag")
        return states, {name: np.zeros(0) for name in ("t_s", "vel_1", "vel_2")}, tuple(notes)
    notes.insert(1, f"commands from {command.topic} ({command.msgtype})")
    return states, _columns(rows[command.topic], command.topic, notes), tuple(notes)


class _Opened:
    """An open bag; errors of its library become one line."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __enter__(self) -> Any:
        require("rosbags", "importing a bag")
        from rosbags.rosbag2 import Reader  # noqa: PLC0415

        path = self.path
        if path.is_dir() and not (path / "metadata.yaml").exists():
            # A killed recorder leaves no metadata, but its file is a valid bag.
            inside = sorted([*path.glob("*.db3"), *path.glob("*.mcap")])
            if len(inside) != 1:
                found = f"{len(inside)} bag files" if inside else "no bag file"
                raise IrtError(f"{path}: {found} and no metadata.yaml in this folder; name one file")
            path = inside[0]
        try:
            self.reader = Reader(path)
            self.reader.open()
        except FileNotFoundError as error:
            raise IrtError(f"{path}: no such file") from error
        except Exception as error:
            raise IrtError(
                f"{path}: no bag, or one that was cut short ({_reason(error)}); {_mend(path)}"
            ) from error
        words = [word for one in self.reader.connections for word in (one.topic, one.msgtype)]
        if not all(isinstance(word, str) for word in words):
            self.reader.close()
            raise IrtError(f"{path}: broken: a topic lacks its name or its type; {_mend(path)}")
        return self.reader

    def __exit__(self, *_: object) -> None:
        self.reader.close()


class _Decoder:
    """Messages of one topic as numbers by name."""

    def __init__(self, path: Path, connection: Any) -> None:
        from rosbags.interfaces import MessageDefinitionFormat  # noqa: PLC0415

        self.path, self.kind, self.topic = path, connection.msgtype, connection.topic
        self.embedded = (
            connection.msgdef.data if connection.msgdef.format == MessageDefinitionFormat.MSG else None
        )
        self.types: Any = None

    def read(self, data: bytes) -> tuple[float, dict[str, float]]:
        """Return the header's stamp [s], NaN without one, and the numbers of a message."""
        if self.types is None:
            self.types = self._fitting(data)
        message = self.types.deserialize_cdr(data, self.kind)
        message = getattr(message, "state", message)
        header = getattr(message, "header", None)
        stamp = float("nan") if header is None else header.stamp.sec + header.stamp.nanosec / 1e9
        return stamp, _numbers(message)

    def _fitting(self, data: bytes) -> Any:
        """Return the types that read the first message: those in the bag, else the known ones."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

        if self.embedded is not None:
            types = get_typestore(Stores.ROS2_HUMBLE)
            found = get_types_from_msg(self.embedded, self.kind)
            types.register({name: one for name, one in found.items() if name not in types.fielddefs})
            return types
        if definitions(self.kind, header=False) is None:
            raise IrtError(
                f"{self.path}: messages of {self.topic} are {self.kind}, whose definition is neither in the "
                "bag nor known here; record as MCAP, or convert the topic to a CSV and import with --from csv"
            )
        for header in (False, True):
            types = get_typestore(Stores.ROS2_HUMBLE)
            for kind, text in (definitions(self.kind, header=header) or {}).items():
                types.register(get_types_from_msg(text, kind))
            try:
                types.deserialize_cdr(data, self.kind)
            # Bytes of another type raise errors of any kind, depending on the wrong field.
            except Exception:
                continue
            return types
        raise IrtError(
            f"{self.path}: messages of {self.topic} ({self.kind}) have other fields than are known here "
            f"({len(data)} bytes); record as MCAP, which holds definitions, or import a CSV"
        )


def _numbers(message: Any, prefix: str = "") -> dict[str, float]:
    found: dict[str, float] = {}
    for one in fields(message):
        value = getattr(message, one.name)
        if one.name == "header":
            continue
        if is_dataclass(value):
            found |= _numbers(value, f"{prefix}{one.name}_")
        elif isinstance(value, int | float):
            found[f"{prefix}{one.name}"] = float(value)
    return found


def _chosen(
    path: Path, connections: Sequence[Any], kinds: Sequence[str], topics: Sequence[str], notes: list[str]
) -> Any | None:
    """Return the connection of the states or commands: by name if given, else by the first known type."""
    what = "state" if kinds is STATES else "command"
    named = [one for one in connections if one.topic in topics]
    of_kind = [one for one in named if short_name(one.msgtype) in kinds]
    # A given topic of an unknown type can only be the states.
    others = [one for one in named if short_name(one.msgtype) not in (*STATES, *COMMANDS)]
    if of_kind or (what == "state" and others):
        return (of_kind or others)[0]
    for kind in kinds:
        found = [one for one in connections if short_name(one.msgtype) == kind and one.msgcount]
        if len(found) > 1:
            names = ", ".join(sorted(one.topic for one in found))
            raise IrtError(f"{path}: {len(found)} topics with {what}s ({names}); choose one with --topic")
        if found:
            if any(
                short_name(one.msgtype) in kinds and one is not found[0] and one.msgcount
                for one in connections
            ):
                notes.append(f"other {what} topics ignored; choose with --topic")
            return found[0]
    return None


def _columns(rows: list[tuple[float, float, dict[str, float]]], topic: str, notes: list[str]) -> Columns:
    receipt = np.array([one[0] for one in rows])
    header = np.array([one[1] for one in rows])
    columns = {name: np.array([one[2][name] for one in rows]) for name in rows[0][2]}
    stamps = receipt
    if np.isfinite(header).all() and (header > 0.0).all():
        ages = receipt - header
        typical, least = float(np.median(ages)), float(np.min(ages))
        stamps = header
        if not _NEWEST_S <= least <= typical <= _OLDEST_S:
            # The age of a message is positive and unknown; the smallest one counts as zero.
            from irt.importing.clocks import clock_offset  # noqa: PLC0415

            offset, error = clock_offset(header, receipt)
            stamps = header + offset
            notes.append(
                f"headers of {topic} have another clock: {offset:+.4f} +- {error:.4f} s to the bag's, "
                "including the transport time of the quickest message"
            )
    else:
        note = "no headers: stamped at receipt, which includes the time of transport"
        if note not in notes:
            notes.append(note)
    order = np.argsort(stamps, kind="stable")
    return {"t_s": stamps[order], **{name: values[order] for name, values in columns.items()}}


def _listed(connections: Sequence[Any]) -> str:
    return ", ".join(sorted(f"{one.topic} ({one.msgtype})" for one in connections)) or "no topics"


def _reason(error: Exception) -> str:
    return (str(error) or type(error).__name__).rstrip(".")


def _mend(path: Path) -> str:
    if path.suffix == ".mcap":
        return "try 'mcap recover'"
    return "copy it again, or rebuild it with 'sqlite3 old.db3 .recover | sqlite3 new.db3'"
