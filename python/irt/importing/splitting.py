"""Cleaning of a log, and its split into runs without gaps."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import garbage_rows, held_rows, mask_spans, repeated_rows, repeats_are_certain, tilt_jumps
from irt.errors import IrtError
from irt.importing.log import Held, Log

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Gap between states [s], and in periods, that ends a run.
_GAP_S, _GAP_PERIODS = 0.25, 5.0
#: Duration of a loss [s] that ends a run: the marble fell into a hole or was taken away.
_LOST_S = 1.0
#: Distance [board edges] and speed [edges/s] from which a marble was put to its new position: a ball that
#: rolls down a board tilted by 8 degrees reaches 3 edges per second.
_PUT, _PUT_SPEED = 0.15, 6.0
#: Minimum length of a run: rows, and seconds.
_FEWEST_ROWS, _SHORTEST_S = 30, 1.0


@dataclass
class Counts:
    """Numbers of removed rows, and of runs and gaps."""

    rows: int = 0
    garbage: int = 0
    held: int = 0
    lost: int = 0
    jumps: int = 0
    uncertain: int = 0
    before_commands: int = 0
    short_runs: int = 0
    short_rows: int = 0
    gaps: int = 0
    episodes: int = 0
    losses: int = 0

    def add(self, other: Counts) -> None:
        """Add the counts of another log."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Rows ``first`` to ``end`` (exclusive) of a cleaned log."""

    log: Log
    commands: Held
    first: int
    end: int

    @property
    def rows(self) -> slice:
        """The rows as a slice."""
        return slice(self.first, self.end)


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A log with gaps for invalid rows, its runs, and the counts."""

    log: Log
    runs: list[Stretch]
    counts: Counts = field(default_factory=Counts)


def clean(log: Log, home_after: float | None = None) -> Cleaned:
    """Turn held positions, jumps of the tilt and invalid first rows into gaps, and split a log into runs.

    Raises
    ------
    IrtError
        If its commands and states do not overlap in time.
    """
    counts = Counts(rows=len(log.stamps))
    commands = Held.of(log, home_after)
    _check_overlap(log, commands)
    counts.garbage = garbage_rows(log.marble, log.tilt) if np.isfinite(log.marble).any() else 0
    rows = slice(counts.garbage, None)
    marble, stamps, episodes = log.marble[rows].copy(), log.stamps[rows], log.episodes[rows]
    held = held_rows(marble)
    if not repeats_are_certain(marble):
        counts.uncertain = int((repeated_rows(marble) & ~held).sum())
    counts.lost = int((~np.isfinite(marble).all(axis=1)).sum())
    counts.held = int(held.sum())
    marble[held] = np.nan
    tilt = None if log.tilt is None else log.tilt[rows].copy()
    if tilt is not None:
        jumps = tilt_jumps(tilt, stamps)
        counts.jumps = int(jumps.any(axis=1).sum())
        tilt[jumps] = np.nan
    cleaned = replace(
        log,
        stamps=stamps,
        marble=marble,
        tilt=tilt,
        tilt_stamps=None if log.tilt_stamps is None else log.tilt_stamps[rows],
        episodes=episodes,
    )
    return Cleaned(cleaned, _split(cleaned, commands, counts), counts)


def _check_overlap(log: Log, commands: Held) -> None:
    if not commands.stamps.size:
        return
    begin, end = commands.stamps[0], commands.stamps[-1]
    if begin > log.stamps[-1] or end < log.stamps[0] - 60.0:
        raise IrtError(
            f"{log.path}: commands and states do not overlap in time: commands from {begin:.3f} to "
            f"{end:.3f} s, states from {log.stamps[0]:.3f} to {log.stamps[-1]:.3f} s; are they of one run "
            "and one clock?"
        )


def _split(log: Log, commands: Held, counts: Counts) -> list[Stretch]:
    stamps = log.stamps
    seen = np.asarray(np.isfinite(log.marble).all(axis=1))
    usable = np.ones(len(stamps), dtype=bool)
    if commands.stamps.size:
        early = stamps < commands.stamps[0]
        counts.before_commands = int(early.sum())
        usable &= ~early
    if seen.any():
        for first, end in mask_spans(~seen):
            if stamps[end - 1] - stamps[first] > _LOST_S:
                counts.losses += 1
                usable[first:end] = False
    begins = np.zeros(len(stamps), dtype=bool)
    gaps = np.diff(stamps) > max(_GAP_S, _GAP_PERIODS * log.period)
    changes = np.diff(log.episodes) != 0.0
    counts.gaps, counts.episodes = int((gaps & ~changes).sum()), int(changes.sum())
    begins[1:] = gaps | changes
    rows = np.flatnonzero(seen)
    if rows.size > 1:
        far = np.linalg.norm(np.diff(log.marble[rows], axis=0), axis=1)
        put = (far > _PUT) & (far > _PUT_SPEED * np.diff(stamps[rows]))
        counts.episodes += int((put & ~begins[rows[1:]]).sum())
        begins[rows[1:][put]] = True
    runs = []
    for first, end in _pieces(usable, begins):
        # A run begins and ends with a tracked marble.
        at = np.flatnonzero(seen[first:end])
        begin, stop = (first + int(at[0]), first + int(at[-1]) + 1) if at.size else (first, end)
        if not at.size and (seen.any() or log.tilt is None):
            begin, stop = first, first
        if stop - begin < _FEWEST_ROWS or stamps[stop - 1] - stamps[begin] < _SHORTEST_S:
            counts.short_runs += 1
            counts.short_rows += end - first
            continue
        runs.append(Stretch(log, commands, begin, stop))
    return runs


def _pieces(usable: Mask, begins: Mask) -> list[tuple[int, int]]:
    pieces: list[tuple[int, int]] = []
    for first, end in mask_spans(usable):
        edges = [first, *(first + 1 + np.flatnonzero(begins[first + 1 : end])).tolist(), end]
        pieces += pairwise(edges)
    return pieces
