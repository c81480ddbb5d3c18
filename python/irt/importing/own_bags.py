"""From bags of `rig play` to recordings: knob angles and marble positions row by row, by the stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from irt.bag import Array, Bag, Play, Series, load_bag
from irt.errors import IrtError
from irt.files import PathLike, make_folder, write_atomic
from irt.recording import save_recording

#: Sources of a recording's knob angles.
Knobs = Literal["measured", "commanded"]

# Largest age of the last point before a run that still gives the start position [s].
_BEFORE_S = 1.0
# Gap between points, in periods, above which points are missing.
_GAP = 2.5
# Number of parts of a row for the mean of the knob's angle.
_PARTS = 64


@dataclass(frozen=True)
class Imported:
    """A recording and statistics of its bag.

    Attributes
    ----------
    path : Path
        The recording.
    rows, missing : int
        Number of rows, and of rows in which the marble was lost.
    seconds : float
        Its duration [s].
    knobs : {"measured", "commanded"}
        Source of the knob angles.
    tracker_hz, tracker_age_s : float
        Points per second, and their smallest age at receipt [s], which includes the clocks' offset.
    joint_age_s : float
        The same for the joint states; NaN without any.
    following : float
        Root mean square difference of measured and commanded knob angles [rad]; NaN without measured ones.
    lag_s : float
        Lag of the measured angles behind the commanded ones [s]; NaN without measured ones.
    stop : str
        Reason of a stop; empty without one.
    """

    path: Path
    rows: int
    missing: int
    seconds: float
    knobs: Knobs
    tracker_hz: float
    tracker_age_s: float
    joint_age_s: float
    following: float
    lag_s: float
    stop: str


def import_bags(
    bags: Sequence[PathLike],
    folder: PathLike,
    *,
    knobs: Knobs | None = None,
    period: float | None = None,
) -> list[Imported]:
    """Write a recording for each play of each bag, and ``rig.toml`` unless the folder has one.

    The position of a row is interpolated between the tracker's points before and after the time of the row's
    command, and left empty if points are missing there. Its knob angle is the mean over the row, because arms
    take some time to follow a command.

    Parameters
    ----------
    bags : sequence of path
        Bags of `rig play`.
    folder : path
        The rig's folder, which may have recordings of other bags.
    knobs : {"measured", "commanded"}, optional
        Source of the knob angles; by default measured if the bag has joint states.
    period : float, optional
        Duration of a row [s]; by default the rows of the played file.

    Raises
    ------
    IrtError
        If a bag cannot be read or has no points of the marble, or a recording exists already.
    """
    read = [load_bag(bag) for bag in bags]
    target = make_folder(folder)
    taken = [path.stem for path in target.glob("*.csv")]
    found = []
    for bag in read:
        for play in bag.plays:
            name = next(name for name in _names(play.name, len(taken)) if name not in taken)
            taken.append(name)
            found.append(_import(bag, play, target / f"{name}.csv", knobs, period))
    if not (target / "rig.toml").exists():
        edge = read[0].edge_x_m
        board = "" if edge == 0.276 else f"[board]\nedge_x_m = {edge!r}\n\n"
        write_atomic(target / "rig.toml", f'{board}[recordings]\nstart = "rest"\n')
    return found


def _names(name: str, most: int) -> list[str]:
    return [name, *(f"{name}-{number}" for number in range(2, most + 3))]


def _import(bag: Bag, play: Play, path: Path, asked: Knobs | None, period: float | None) -> Imported:
    stamps = play.stamps
    if period is not None:
        stamps = stamps[0] + period * np.arange(np.ceil((play.end - stamps[0]) / period))
    # A remainder within the stamps' rounding is no row.
    stamps = stamps[stamps < play.end - 1e-4]
    if stamps.size < 2:
        raise IrtError(f"{bag.path}, {play.name}: fewer than two rows were played before the stop")
    measured = bag.measured if bag.measured is not None and _covers(bag.measured, stamps) else None
    if asked == "measured" and measured is None:
        raise IrtError(f"{bag.path}, {play.name}: no joint states throughout; use --knobs commanded")
    if bag.marble.stamps.size < 2:
        raise IrtError(f"{bag.path}: the tracker sent no points; check its topic and record again")
    ends = np.append(stamps[1:], play.end)
    chosen: Knobs = "commanded" if asked == "commanded" or measured is None else "measured"
    source = bag.set_points if measured is None or chosen == "commanded" else measured
    knobs = _mean(source, stamps, ends, held=chosen == "commanded")
    marble = _positions(bag.marble, stamps)
    if np.isnan(marble[0]).any():
        marble[0] = _at_rest(bag, play, stamps[0])
    save_recording(path, knobs, marble, stamps - stamps[0])
    during = (bag.marble.stamps >= stamps[0]) & (bag.marble.stamps <= play.end)
    following, lag = _following(bag.set_points, measured, stamps[0], play.end)
    return Imported(
        path=path,
        rows=stamps.size,
        missing=int(np.isnan(marble[:, 0]).sum()),
        seconds=float(play.end - stamps[0]),
        knobs=chosen,
        tracker_hz=float(during.sum() / (play.end - stamps[0])),
        tracker_age_s=float(bag.marble.ages.min()),
        joint_age_s=float(bag.measured.ages.min()) if bag.measured is not None else float("nan"),
        following=following,
        lag_s=lag,
        stop=play.stop,
    )


def _covers(series: Series, stamps: Array) -> bool:
    return bool(series.stamps[0] <= stamps[0] and series.stamps[-1] >= stamps[-1])


def _mean(series: Series, begins: Array, ends: Array, *, held: bool) -> Array:
    """Return the mean of a series over each row, (n, 2), with values held or linearly interpolated."""
    parts = (np.arange(_PARTS) + 0.5) / _PARTS
    times = begins[:, None] + parts * (ends - begins)[:, None]
    if held:
        last = np.clip(np.searchsorted(series.stamps, times, side="right") - 1, 0, None)
        return np.asarray(series.values[last].mean(axis=1))
    columns = [np.interp(times, series.stamps, values).mean(axis=1) for values in series.values.T]
    return np.column_stack(columns)


def _positions(marble: Series, stamps: Array) -> Array:
    """Return the marble's positions at these times, (n, 2), NaN where points are missing around them."""
    after = np.searchsorted(marble.stamps, stamps)
    inside = (after > 0) & (after < marble.stamps.size)
    after = np.clip(after, 1, marble.stamps.size - 1)
    apart = marble.stamps[after] - marble.stamps[after - 1]
    known = inside & (apart <= _GAP * np.median(np.diff(marble.stamps)))
    columns = [np.interp(stamps, marble.stamps, values) for values in marble.values.T]
    return np.where(known[:, None], np.column_stack(columns), np.nan)


def _at_rest(bag: Bag, play: Play, begin: float) -> Array:
    """Return the marble's position before its run: the last point, if it is recent."""
    before = np.flatnonzero((bag.marble.stamps <= begin) & (bag.marble.stamps >= begin - _BEFORE_S))
    if before.size == 0:
        raise IrtError(f"{bag.path}, {play.name}: the tracker did not see the marble at the start of the run")
    return np.asarray(bag.marble.values[before[-1]])


def _following(set_points: Series, measured: Series | None, begin: float, end: float) -> tuple[float, float]:
    """Return the difference of measured from commanded knobs [rad, rms], and the lag [s], or NaN."""
    if measured is None or set_points.stamps.size == 0:
        return float("nan"), float("nan")
    inside = (measured.stamps >= begin) & (measured.stamps <= end)
    if not inside.any():
        return float("nan"), float("nan")
    stamps, values = measured.stamps[inside], measured.values[inside]

    def apart(lag: float) -> float:
        asked = [np.interp(stamps - lag, set_points.stamps, column) for column in set_points.values.T]
        return float(np.sqrt(np.mean((values - np.column_stack(asked)) ** 2)))

    lags = np.arange(-0.1, 0.4, 0.005)
    return apart(0.0), float(min(lags, key=apart))
