"""From bags to recordings: what the knobs did and where the marble was, row by row, by the stamps."""

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

#: Where the knob angles of a recording come from.
Knobs = Literal["measured", "commanded"]

# A marble that nobody moves may be looked up this long before its run [s].
_BEFORE_S = 1.0
# Points further apart than this many periods have others missing between them.
_GAP = 2.5
# Parts of a row over which the knob's angle is averaged.
_PARTS = 64


@dataclass(frozen=True)
class Imported:
    """One recording, and what was seen while it was made.

    Attributes
    ----------
    path : Path
        The recording.
    rows, missing : int
        How many rows it has, and in how many of them the marble was lost.
    seconds : float
        How long it is.
    knobs : {"measured", "commanded"}
        Where the knob angles come from.
    tracker_hz, tracker_age_s : float
        Points a second, and how old they were when they came: the least, which holds the clocks' difference.
    joint_age_s : float
        The same of the joint states; NaN without any.
    following : float
        Root mean square difference of measured and commanded knob angles [rad]; NaN where not measured.
    lag_s : float
        By how much the measured angles lag behind the commanded ones [s]; NaN where not measured.
    stop : str
        Why the run was stopped, empty where it was not.
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

    The position of a row is interpolated between the tracker's points on both sides of the moment at which
    the row was issued, and left empty where points are missing there. Its knob angle is the mean over it,
    so that a command which arms take some time to follow is told as what it was on average.

    Parameters
    ----------
    bags : sequence of path
        What `rig play` recorded.
    folder : path
        The rig's folder; recordings of other bags may be in it.
    knobs : {"measured", "commanded"}, optional
        Where knob angles come from; the default is from the joints where they were heard.
    period : float, optional
        Length of a row [s]; the default is the rows of the file that was played.

    Raises
    ------
    IrtError
        If a bag cannot be read, has no points of the marble, or a recording is there already.
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
        edge = read[0].config.get("tracker", {}).get("edge_x_m", 0.276)
        board = "" if edge == 0.276 else f"[board]\nedge_x_m = {edge!r}\n\n"
        write_atomic(target / "rig.toml", f'{board}[recordings]\nstart = "rest"\n')
    return found


def _names(name: str, most: int) -> list[str]:
    return [name, *(f"{name}-{number}" for number in range(2, most + 3))]


def _import(bag: Bag, play: Play, path: Path, asked: Knobs | None, period: float | None) -> Imported:
    stamps = play.stamps
    if period is not None:
        stamps = stamps[0] + period * np.arange(np.ceil((play.end - stamps[0]) / period))
    # What the stamps' own digits leave of a row is none.
    stamps = stamps[stamps < play.end - 1e-4]
    if stamps.size < 2:
        raise IrtError(f"{bag.path}, {play.name}: fewer than two rows were played before it was stopped")
    measured = bag.measured if bag.measured is not None and _covers(bag.measured, stamps) else None
    if asked == "measured" and measured is None:
        raise IrtError(f"{bag.path}, {play.name}: no joint states throughout; use --knobs commanded")
    if bag.marble.stamps.size < 2:
        raise IrtError(f"{bag.path}: the tracker sent no points; nothing can be learned from it")
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
    """Return the mean of a series over each row, (n, 2): held from stamp to stamp, or straight between."""
    parts = (np.arange(_PARTS) + 0.5) / _PARTS
    times = begins[:, None] + parts * (ends - begins)[:, None]
    if held:
        last = np.clip(np.searchsorted(series.stamps, times, side="right") - 1, 0, None)
        return np.asarray(series.values[last].mean(axis=1))
    columns = [np.interp(times, series.stamps, values).mean(axis=1) for values in series.values.T]
    return np.column_stack(columns)


def _positions(marble: Series, stamps: Array) -> Array:
    """Return where the marble was at these moments, (n, 2), NaN where points are missing around them."""
    after = np.searchsorted(marble.stamps, stamps)
    inside = (after > 0) & (after < marble.stamps.size)
    after = np.clip(after, 1, marble.stamps.size - 1)
    apart = marble.stamps[after] - marble.stamps[after - 1]
    known = inside & (apart <= _GAP * np.median(np.diff(marble.stamps)))
    columns = [np.interp(stamps, marble.stamps, values) for values in marble.values.T]
    return np.where(known[:, None], np.column_stack(columns), np.nan)


def _at_rest(bag: Bag, play: Play, begin: float) -> Array:
    """Return where the marble lay before its run: the last point, if that is not long ago."""
    before = np.flatnonzero((bag.marble.stamps <= begin) & (bag.marble.stamps >= begin - _BEFORE_S))
    if before.size == 0:
        raise IrtError(f"{bag.path}, {play.name}: the tracker did not see the marble as the run began")
    return np.asarray(bag.marble.values[before[-1]])


def _following(set_points: Series, measured: Series | None, begin: float, end: float) -> tuple[float, float]:
    """Return how far measured knobs are from commanded ones [rad, rms], and how much they lag [s]."""
    if measured is None:
        return float("nan"), float("nan")
    inside = (measured.stamps >= begin) & (measured.stamps <= end)
    stamps, values = measured.stamps[inside], measured.values[inside]

    def apart(lag: float) -> float:
        asked = [np.interp(stamps - lag, set_points.stamps, column) for column in set_points.values.T]
        return float(np.sqrt(np.mean((values - np.column_stack(asked)) ** 2)))

    lags = np.arange(-0.1, 0.4, 0.005)
    return apart(0.0), float(min(lags, key=apart))
