"""The common form of all sources before their conventions are known: streams of states and commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.recording import CMD

Array = NDArray[np.float64]

#: Fits evaluate the same lag at many delays in succession.
_LAGS_KEPT = 4


@dataclass(frozen=True, eq=False)
class Log:
    """A log in the declared convention of its format.

    Attributes
    ----------
    name : str
        Prefix of its recordings' names.
    path : Path
        Its source.
    stamps : (n,) array
        Time of each state [s].
    marble : (n, 2) array
        Positions [board edges], NaN in lost rows.
    tilt : (n, 2) array or None
        Measured tilt about x and y [rad], NaN without a measurement.
    tilt_stamps : (n,) array or None
        Time of each tilt [s], if it has a separate clock.
    command_stamps : (m,) array
        Time of each command [s].
    commands : (m, 2) array
        The commands in their own unit.
    episodes : (n,) array
        A number that changes at the start of each run.
    columns : (str, str)
        Columns of a recording that hold the commands.
    tilt_names, command_names, marble_names : (str, str)
        Names in the source.
    stamped : bool
        Whether the stamps were logged; otherwise they are row numbers at a nominal rate.
    notes : tuple of str
        Assumptions and facts from reading, one sentence each.

    Raises
    ------
    IrtError
        If the arrays differ in length.
    """

    name: str
    path: Path
    stamps: Array
    marble: Array
    tilt: Array | None
    command_stamps: Array
    commands: Array
    episodes: Array
    tilt_stamps: Array | None = None
    columns: tuple[str, str] = CMD
    marble_names: tuple[str, str] = ("x", "y")
    tilt_names: tuple[str, str] = ("tilt_x", "tilt_y")
    command_names: tuple[str, str] = ("cmd_x", "cmd_y")
    stamped: bool = True
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        rows = len(self.stamps)
        for what, array in (("marble", self.marble), ("tilt", self.tilt), ("episodes", self.episodes)):
            if array is not None and len(array) != rows:
                raise IrtError(
                    f"{self.path}: {len(array)} rows of {what}, but {rows} stamps; they must be of one length"
                )
        if len(self.commands) != len(self.command_stamps):
            raise IrtError(
                f"{self.path}: {len(self.commands)} commands, but {len(self.command_stamps)} stamps of them"
            )

    @property
    def period(self) -> float:
        """Median time from state to state [s]; NaN for a single one."""
        return float(np.median(np.diff(self.stamps))) if len(self.stamps) > 1 else math.nan


@dataclass(frozen=True, eq=False)
class Held:
    """Commands that hold from their time to the next.

    Attributes
    ----------
    stamps : (m,) array
        Times [s], increasing.
    values : (m, 2) array
        The commands from each time on.
    """

    stamps: Array
    values: Array
    _states: dict[float, Array] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, log: Log, home_after: float | None = None) -> Held:
        """Return the commands of a log; the driver returns to 0 after ``home_after`` seconds of silence."""
        known = np.isfinite(log.commands).all(axis=1) & np.isfinite(log.command_stamps)
        stamps, first = np.unique(log.command_stamps[known][::-1], return_index=True)
        values = log.commands[known][::-1][first]  # of two at one time the later counts
        if home_after is not None and stamps.size:
            silent = np.append(np.diff(stamps), np.inf) > home_after
            stamps = np.concatenate([stamps, stamps[silent] + home_after])
            values = np.concatenate([values, np.zeros((int(silent.sum()), 2))])
            order = np.argsort(stamps, kind="stable")
            stamps, values = stamps[order], values[order]
        return cls(stamps, values)

    def shifted(self, seconds: float) -> Held:
        """Return the same commands, delayed by some seconds."""
        return Held(self.stamps + seconds, self.values)

    def lagged(self, times: Array, lag: float) -> Array:
        """Return the commands after a first-order lag [s] at some times, (k, 2); NaN before the first."""
        last = np.searchsorted(self.stamps, times, side="right") - 1
        if not self.stamps.size:
            return np.full((len(times), 2), np.nan)
        values = self.values[np.clip(last, 0, None)].copy()
        if lag > 0.0:
            state = self._state(lag)
            row = np.clip(last, 0, None)
            values += (state[row] - values) * np.exp(-np.clip(times - self.stamps[row], 0.0, None) / lag)[
                :, None
            ]
        values[last < 0] = np.nan
        return values

    def _state(self, lag: float) -> Array:
        """Return the lagged value at each command, (m, 2); the last few lags are cached."""
        if lag not in self._states:
            if len(self._states) >= _LAGS_KEPT:
                self._states.clear()
            self._states[lag] = _filtered(self.values, np.exp(-np.diff(self.stamps) / lag))
        return self._states[lag]

    def mean(self, begins: Array, ends: Array) -> Array:
        """Return the mean over each row, (k, 2); NaN where a row begins before the first command."""
        first = np.searchsorted(self.stamps, begins, side="right") - 1
        final = np.searchsorted(self.stamps, ends, side="left") - 1
        if not self.stamps.size:
            return np.full((len(begins), 2), np.nan)
        durations = np.diff(self.stamps)[:, None]
        integral = np.concatenate([np.zeros((1, 2)), np.cumsum(self.values[:-1] * durations, axis=0)])

        def up_to(times: Array, row: NDArray[np.intp]) -> Array:
            row = np.clip(row, 0, None)
            total: Array = integral[row] + self.values[row] * (times - self.stamps[row])[:, None]
            return total

        means = (up_to(ends, final) - up_to(begins, first)) / (ends - begins)[:, None]
        # A command that holds over a whole row is copied, not integrated, to keep its digits.
        whole = final <= first
        means[whole] = self.values[np.clip(first[whole], 0, None)]
        means[first < 0] = np.nan
        return means


def _filtered(values: Array, decays: Array) -> Array:
    """Return ``s[i + 1] = v[i] + d[i] (s[i] - v[i])`` from ``s[0] = v[0]`` on, (m, 2).

    In parallel blocks, because an hour has a hundred thousand commands.
    """
    steps = len(decays)
    if steps == 0:
        return values.copy()
    size = int(np.ceil(np.sqrt(steps)))
    count = -(-steps // size)
    padded = np.ones(count * size)
    padded[:steps] = decays
    pushes = np.zeros((count * size, 2))
    pushes[:steps] = (1.0 - decays[:, None]) * values[:-1]
    blocks, pushes_by_block = padded.reshape(count, size), pushes.reshape(count, size, 2)
    # Within each block from a state of zero, plus the decay of the block's initial state.
    own, kept = np.empty((count, size, 2)), np.cumprod(blocks, axis=1)
    state = np.zeros((count, 2))
    for step in range(size):
        state = blocks[:, step, None] * state + pushes_by_block[:, step]
        own[:, step] = state
    begin = values[0]
    for block in range(count):
        own[block] += kept[block, :, None] * begin
        begin = own[block, -1]
    return np.concatenate([values[:1], own.reshape(-1, 2)[:steps]])
