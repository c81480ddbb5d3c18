"""From files to logs: detection of the lab, and columns by the mapping."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.importing import lab_bags, tables
from irt.importing.labs import ANY, CYBERRUNNER, REPLAY, TAG, WITHOUT_ROS, Lab
from irt.importing.likely_mapping import suggested_command
from irt.importing.log import Log
from irt.importing.mapping import COMMAND_STAMP, SEEN, TARGETS, TILT_STAMP, Expression
from irt.importing.messages import COMMANDS, STATES, short_name
from irt.recording import CMD, KNOBS, MARBLE, STAMP, TILT

Array = NDArray[np.float64]
Columns = dict[str, Array]
Progress = Callable[[int, int, str], None]
#: Values of ``--from``.
Kind = Literal["rig", "cyberrunner", "tag", "csv"]
KINDS: tuple[Kind, ...] = get_args(Kind)

#: Distance of rows [s] above which stamps are in another unit, because no camera is as slow.
_LONGEST_STEP_S = 2.0
#: Gap between episodes whose clocks restart [s]; any gap that splits a run.
_APART_S = 10.0
#: Backward step of a stamp [s] that starts a new run; after a smaller one the row was late.
_NEW_CLOCK_S = 0.5
#: First bytes of an MCAP file.
_MCAP = b"\x89MCAP"
#: Larger values are broken and count as missing: counts of 32 bits are the largest numbers in use for angles,
#: places and commands, and nanoseconds since 1970, of 1.8e18, for stamps. Squares of broken ones overflow.
_LARGEST, _LARGEST_STAMP = 2.0**32, 1e19


@dataclass(frozen=True)
class Reading:
    """Options for reading logs.

    Attributes
    ----------
    mapping : dict
        The user's expressions, which replace the format's.
    topics : sequence of str
        Topics to use if a bag has several.
    episode : str or None
        A column that changes at the start of each run.
    edge_x_m : float
        The board's long edge [m].
    """

    mapping: Mapping[str, Expression] = field(default_factory=dict)
    topics: Sequence[str] = ()
    episode: str | None = None
    edge_x_m: float = 0.276


def detect(path: Path, *, mapped: bool = False) -> Kind:
    """Return the format of a source.

    Raises
    ------
    IrtError
        If it is not certain; the message asks for ``--from``.
    """
    tables.refuse_pickle(path)
    ask = f"choose with --from {'|'.join(KINDS)}"
    if path.is_dir():
        if (path / "states.csv").is_file():
            return "tag"
        if not list(path.glob("*.db3")) + list(path.glob("*.mcap")):
            files = "name its CSV files one by one" if list(path.glob("*.csv")) else ask
            raise IrtError(f"{path}: neither a bag (metadata.yaml, *.db3, *.mcap) nor a TAG folder; {files}")
        return _of_topics(path, ask)
    if not path.exists():
        raise IrtError(f"{path}: no such file; give a bag, a folder, a CSV or an NPZ file of the log")
    if path.suffix.lower() == ".npz":
        return "cyberrunner"
    if path.suffix.lower() == ".csv":
        return "csv" if mapped else _of_columns(path, ask)
    return _of_topics(path, ask) if path.suffix.lower() == ".db3" else _of_file(path, ask)


def lab_of(path: Path, kind: Kind) -> Lab:
    """Return the lab of a source."""
    if kind == "tag":
        return TAG
    if kind == "csv":
        return ANY
    return {".npz": REPLAY, ".csv": WITHOUT_ROS}.get(path.suffix.lower(), CYBERRUNNER)


def read_log(path: Path, kind: Kind, reading: Reading, progress: Progress | None = None) -> Log:
    """Read one log in the declared convention of its format.

    Raises
    ------
    IrtError
        If it cannot be read or has no states; one line with advice.
    """
    tables.refuse_pickle(path)
    lab = lab_of(path, kind)
    if path.is_dir() and kind == "tag" and (path / "states.csv").exists():
        states, commands, notes = tables.read_tag_folder(path)
        return _log(path, lab, reading, states, commands, notes=notes)
    if path.suffix.lower() == ".npz":
        states, episodes = tables.read_replay(path)
        states["t_s"] = np.arange(len(episodes)) / lab.rate
        notes = (f"a replay has no stamps: rows are assumed to be 1/{lab.rate:g} s apart",)
        return _log(path, lab, reading, states, states, episodes=episodes, notes=notes, stamped=False)
    if path.suffix.lower() == ".csv" or (kind == "csv" and path.is_file()):
        states = tables.read_columns(path)
        if kind != "cyberrunner":
            return _log(path, lab, reading, states, states)
        if not set(states) >= tables.WITHOUT_ROS:
            missing = ", ".join(sorted(tables.WITHOUT_ROS - set(states)))
            raise IrtError(
                f"{path}: no log of a CyberRunner without ROS: {missing} missing; use --from csv --map ..."
            )
        states, episodes = tables.read_without_ros(path, states)
        notes = ("row i was observed after action i: its command is the action of the next row",)
        return _log(path, lab, reading, states, states, episodes=episodes, notes=notes)
    states, commands, notes = lab_bags.read_bag(path, reading.topics, progress)
    return _log(path, lab, reading, states, commands, notes=notes)


def _of_columns(path: Path, ask: str) -> Kind:
    columns = tables.read_columns(path)
    if set(columns) >= tables.WITHOUT_ROS:
        return "cyberrunner"
    if set(MARBLE) <= set(columns):
        return "csv"
    raise IrtError(
        f"{path}: columns of no known lab ({', '.join(sorted(columns))}); "
        + (_suggestion(path, columns) or f"name them with --map, such as --map marble_x=xb/0.276, or {ask}")
    )


def _suggestion(path: Path, columns: Columns) -> str | None:
    likely = suggested_command(path, columns)
    return None if likely is None else f"by their names and units this may be right: {likely}"


def _of_file(path: Path, ask: str) -> Kind:
    from irt.bag import is_own  # noqa: PLC0415

    tables.refuse_packed(path)
    if path.suffix.lower() != ".mcap" and not tables.begins_with(path, (_MCAP,)):
        raise IrtError(
            f"{path}: a file of no known kind: bags are *.mcap or *.db3, replays *.npz, tables *.csv; "
            "a table of another name is read with --from csv"
        )
    # The reader of `rig play`'s bags reports the error of a file that is no bag.
    return "rig" if is_own(path) else _of_topics(path, ask)


def _of_topics(path: Path, ask: str) -> Kind:
    topics = lab_bags.topics_of(path)
    names = {short_name(kind) for kind in topics.values()}
    if "HiwonderVel" in names or any(topic.startswith("/tag_") for topic in topics):
        return "tag"
    if names & {*STATES, *COMMANDS}:
        return "cyberrunner"
    if any(topic.startswith("/rig/") for topic in topics):
        return "rig"
    listed = ", ".join(sorted(topics)) or "none"
    raise IrtError(f"{path}: topics of no known lab ({listed}); {ask}")


def _log(
    path: Path,
    lab: Lab,
    reading: Reading,
    states: Columns,
    commands: Columns,
    *,
    episodes: Array | None = None,
    notes: Sequence[str] = (),
    stamped: bool = True,
) -> Log:
    """Apply the mapping to the columns of states and commands, which may be one table."""
    mapping = _full_mapping(path, lab, reading.mapping, states)
    one_table = commands is states
    rows, command_rows = len(next(iter(states.values()))), len(next(iter(commands.values())))

    def value(target: str, *, of_commands: bool = False) -> Array | None:
        if target not in mapping:
            return None
        table, count = (commands, command_rows) if of_commands else (states, rows)
        known = {**table, "edge_x_m": np.full(count, reading.edge_x_m), "nan": np.full(count, np.nan)}
        most = _LARGEST_STAMP if target in {STAMP, COMMAND_STAMP, TILT_STAMP} else _LARGEST
        return _sound(mapping[target].evaluate(known, count, f"{path}"), most)

    stamps = _sound(mapping[STAMP].evaluate(states, rows, f"{path}"), _LARGEST_STAMP)
    marble = _pair(path, MARBLE, value, rows)
    tilt = _columns_of(TILT, value, rows)
    names = _command_names(path, mapping)
    sent = np.zeros((command_rows, 2))
    for axis, name in enumerate(names):
        if (spoken := value(name, of_commands=True)) is not None:
            sent[:, axis] = spoken
    seen = value(SEEN)
    if seen is not None:
        marble = np.where((np.nan_to_num(seen) != 0.0)[:, None], marble, np.nan)
    if reading.episode is not None:
        if reading.episode not in states:
            raise IrtError(
                f"{path}: no column {reading.episode} for --episode; there are {', '.join(states)}"
            )
        episodes = states[reading.episode]
    runs = np.zeros(rows) if episodes is None else np.asarray(episodes)
    command_stamps = value(COMMAND_STAMP, of_commands=True)
    if command_stamps is None:
        command_stamps = stamps if one_table else commands["t_s"]
    tilt_stamps = value(TILT_STAMP)
    stamps, runs, offsets, keep = _rising(path, stamps, runs)
    if one_table:
        command_stamps, sent = (command_stamps + offsets)[keep], sent[keep]
    if not np.isfinite(marble).any() and (MARBLE[0] in mapping and mapping[MARBLE[0]].text != "nan"):
        raise IrtError(
            f"{path}: the marble is lost in every row; if this is a run of tilt alone, say so with "
            "--map marble_x=nan --map marble_y=nan"
        )
    return Log(
        name=path.stem if path.stem != "states" else path.parent.name,
        path=path,
        stamps=stamps,
        marble=marble[keep],
        tilt=None if tilt is None else tilt[keep],
        tilt_stamps=None if tilt_stamps is None else (tilt_stamps + offsets)[keep],
        command_stamps=command_stamps,
        commands=sent,
        episodes=runs,
        columns=names,
        marble_names=_texts(mapping, MARBLE),
        tilt_names=_texts(mapping, TILT),
        command_names=_texts(mapping, names),
        stamped=stamped,
        notes=tuple(notes),
    )


def _sound(values: Array, most: float) -> Array:
    """Return values with NaN for those beyond the largest possible one."""
    return np.where(np.abs(values) <= most, values, np.nan)


def _full_mapping(
    path: Path, lab: Lab, own: Mapping[str, Expression], states: Columns
) -> dict[str, Expression]:
    """Return the format's mapping with the user's changes; raise if time or position is missing."""
    mapping = lab.expressions(own)
    if lab.mapping:
        # The user's knob angles replace the format's commands.
        for pair, other in ((KNOBS, CMD), (CMD, KNOBS)):
            if any(name in own for name in pair):
                mapping = {name: one for name, one in mapping.items() if name not in other or name in own}
        if "ball_visible" in states:
            mapping.setdefault(SEEN, Expression.parse("ball_visible"))
        mapping.setdefault(STAMP, Expression.parse("t_s"))
    else:
        # Columns with the convention's names are mapped to themselves.
        mapping = {name: Expression.parse(name) for name in TARGETS if name in states} | mapping
    if not any(target in mapping for target in (*MARBLE, *TILT)):
        otherwise = f"map them, such as --map marble_x=xb/0.276 (columns: {', '.join(states)})"
        raise IrtError(
            f"{path}: no columns of the marble's position; {_suggestion(path, states) or otherwise}"
        )
    if STAMP not in mapping:
        raise IrtError(
            f"{path}: no stamps of the rows; map their time in seconds, such as "
            f"--map t_s=stamp_ms/1000 or --map t_s=frame/30 (columns: {', '.join(states)})"
        )
    return mapping


def _pair(path: Path, targets: tuple[str, str], value: Callable[[str], Array | None], rows: int) -> Array:
    found = [value(target) for target in targets]
    if (found[0] is None) != (found[1] is None):
        missing = targets[0] if found[0] is None else targets[1]
        raise IrtError(f"{path}: {missing} is not mapped; map both {' and '.join(targets)} or neither")
    if found[0] is None or found[1] is None:
        return np.full((rows, 2), np.nan)
    places = np.column_stack([found[0], found[1]])
    places[~np.isfinite(places).all(axis=1)] = np.nan
    return places


def _columns_of(targets: tuple[str, str], value: Callable[[str], Array | None], rows: int) -> Array | None:
    found = [value(target) for target in targets]
    if found[0] is None and found[1] is None:
        return None
    return np.column_stack([np.full(rows, np.nan) if one is None else one for one in found])


def _command_names(path: Path, mapping: Mapping[str, Expression]) -> tuple[str, str]:
    """Return the columns of the commands; the user's choice replaces the format's."""
    has_knobs = any(name in mapping for name in KNOBS)
    has_commands = any(name in mapping for name in CMD)
    if has_knobs and has_commands:
        raise IrtError(
            f"{path}: both {' or '.join(KNOBS)} and {' or '.join(CMD)} are mapped; knob_* are for angles in "
            "radians, cmd_* for any other unit: map one pair"
        )
    return KNOBS if has_knobs else CMD


def _texts(mapping: Mapping[str, Expression], targets: tuple[str, str]) -> tuple[str, str]:
    first, second = (mapping[target].text if target in mapping else "-" for target in targets)
    return first, second


def _rising(path: Path, stamps: Array, episodes: Array) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Return increasing stamps, their episodes, the added offset by row, and the kept rows.

    A clock that restarts begins a new episode; rows without a stamp and late rows are dropped.
    """
    known = np.isfinite(stamps)
    if known.sum() < 2:
        raise IrtError(f"{path}: {int(known.sum())} rows with a stamp; at least two are needed")
    steps = np.diff(stamps[known])
    typical = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if typical == 0.0:
        raise IrtError(
            f"{path}: all rows have the same stamp; expected seconds that increase from row to row"
        )
    if typical > _LONGEST_STEP_S:
        # The unit in which rows are closest to 1/40 s apart.
        unit, name = min(
            ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")),
            key=lambda one: abs(np.log(typical / one[0] * 40.0)),
        )
        raise IrtError(
            f"{path}: rows are {typical:.3g} s apart: stamps seem to be in {name}; divide by {unit:.0e}, "
            f"such as --map t_s=stamp/{unit:.0e}"
        )
    offsets, runs = np.zeros(len(stamps)), np.asarray(episodes, dtype=np.float64).copy()
    restarts = np.zeros(len(stamps), dtype=bool)
    rows = np.flatnonzero(known)
    back = rows[1:][steps < -_NEW_CLOCK_S]
    for row in back.tolist():
        before = rows[np.searchsorted(rows, row) - 1]
        offsets[row:] += stamps[before] - stamps[row] + _APART_S
        restarts[row] = True
    changed = np.concatenate([[False], np.diff(np.nan_to_num(runs, nan=-1.0)) != 0.0]) | restarts
    runs = np.cumsum(changed).astype(np.float64)
    whole = stamps + offsets
    keep, last = [], -np.inf
    for row in rows.tolist():
        if whole[row] > last:
            keep.append(row)
            last = whole[row]
    kept = np.array(keep)
    return whole[kept], runs[kept], offsets, kept
