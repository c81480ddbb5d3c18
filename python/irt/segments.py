"""Segments of recordings that are predicted without restart, and their commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.engine import SUBSTEP_S
from irt.errors import IrtError
from irt.recording import Recording
from irt.rig import Rig
from irt.start_state import Inputs

Array = NDArray[np.float64]

#: Length of the windows of a fit to recordings in motion [s].
SEGMENT_S = 2.5
#: Start of a recording in motion that is not fitted [s], and its largest share of the recording: unknown
#: commands from before still act there. Delays and lags of labyrinth actuators are 0.05 to 0.15 s.
SETTLING_S, SETTLING = 0.5, 0.1
#: Fewest rows from which the start state of a window is estimated, and their duration [s]: four rows of a
#: camera of 30 Hz. From four rows of a faster camera the velocity would be less certain, not more.
LEAD_ROWS, LEAD_S = 4, 4.0 / 30.0
#: Most rows of the polynomial for the initial guess of a start state.
_GUESS_ROWS = 6


@dataclass(frozen=True, eq=False)
class Segment:
    """A part of a recording that is predicted without restart.

    Attributes
    ----------
    run : Recording
        The complete recording, because effects may depend on earlier commands.
    rows : slice
        Rows of the recording.
    start : (2,) array
        Position at the first row [board edges].
    start_velocity : (2,) array
        Velocity at the first row [board edges per second of simulated time].
    lead : int
        Number of first rows from which the start state is estimated, and which are not predicted.
    """

    run: Recording
    rows: slice
    start: Array
    start_velocity: Array
    lead: int = 0

    @property
    def recording(self) -> str:
        """Name of the recording."""
        return self.run.name

    @property
    def first_row(self) -> int:
        """First row of the segment in the recording."""
        return int(self.rows.start)

    @property
    def knobs(self) -> Array:
        """Commanded knob angles, (n, 2) [rad]."""
        return self.run.knobs[self.rows]

    @property
    def durations(self) -> Array | None:
        """Duration of each command, (n,) [s]; None without stamps."""
        return None if self.run.durations is None else self.run.durations[self.rows]

    @property
    def observed(self) -> Array:
        """Observed positions, (n, 2) [board edges], NaN in rows where the tracker lost the marble."""
        return self.run.marble[self.rows]

    @property
    def tilt(self) -> Array | None:
        """Measured tilt, (n, 2) [rad], NaN in rows without; None if it was not measured."""
        return None if self.run.tilt is None else self.run.tilt[self.rows]

    def cut(self, first: int, stop: int) -> Segment:
        """Return a part of the segment; its start state is unknown."""
        unknown = np.full(2, np.nan)
        return Segment(self.run, slice(self.first_row + first, self.first_row + stop), unknown, unknown)


def segments(rig: Rig, seconds: float | None = None, *, whole: bool = False) -> list[Segment]:
    """Return the segments of a fit: complete recordings that start at rest, or windows.

    Parameters
    ----------
    rig : Rig
        The rig with its recordings.
    seconds : float, optional
        Length of a window [s]; without stamps, time is computed with the middle of the range of
        ``time_scale``. By default recordings in motion are cut into windows of 2.5 s, and recordings from
        rest are not cut.
    whole : bool
        Do not cut recordings in motion. Their first rows are left out in either case.

    Returns
    -------
    list of Segment
        In the order of recordings and rows. Start states are initial guesses that a fit refines: at rest at
        the position of row 0, or from a parabola through the first rows of a window. Segments with fewer than
        four observed rows do not determine more than their start state; they are dropped unless they have a
        measured tilt.

    Raises
    ------
    IrtError
        If the length is not positive.
    """
    if seconds is not None:
        check_length(seconds)
    middle = sum(rig.ranges["time_scale"]) / 2.0
    found: list[Segment] = []
    for recording in rig.recordings:
        step = row_seconds(recording, middle)
        begin = _settling_rows(recording, step) if rig.start == "moving" else 0
        rows = len(recording.knobs) - begin
        if seconds is not None or (rig.start == "moving" and not whole):
            rows = rows_of(seconds or SEGMENT_S, step)
        for first in range(begin, len(recording.knobs), rows):
            stretch = slice(first, first + rows)
            if first == 0 and rig.start == "rest" and recording.has_marble:
                found.append(segment_of(recording, stretch, np.append(recording.marble[0], [0.0, 0.0])))
            elif recording.seen[stretch].sum() >= LEAD_ROWS:
                found.append(segment_of(recording, stretch, guess(recording, stretch, step, 2)))
            elif recording.tilt is not None and np.isfinite(recording.tilt[stretch]).any():
                found.append(segment_of(recording, stretch, np.zeros(4)))
    return found


def windows_of(recording: Recording, step_s: float, window_s: float) -> list[Segment]:
    """Return the windows of a recording, each preceded by the rows of its start state.

    Parameters
    ----------
    recording : Recording
        The recording.
    step_s : float
        Duration of a row [s]; without a duration there are no windows.
    window_s : float
        Length of a window [s].
    """
    if step_s == 0.0:
        return []
    rows, lead = rows_of(window_s, step_s), LEAD_ROWS
    if recording.durations is not None:
        lead = max(LEAD_ROWS, round(LEAD_S / step_s))
    found = []
    first = 0
    while (end := first + lead + rows) <= len(recording.knobs):
        head = slice(first, first + lead)
        if recording.seen[head].sum() < 0.75 * lead or not recording.seen[head.stop : end].any():
            first += 1
            continue
        window = segment_of(recording, slice(first, end), guess(recording, head, step_s, 1))
        found.append(replace(window, lead=lead))
        first += rows
    return found


def _settling_rows(recording: Recording, step_s: float) -> int:
    """Return the number of first rows in which unknown commands from before a recording in motion act."""
    return min(rows_of(SETTLING_S, step_s), int(SETTLING * len(recording.knobs)))


def inputs_of(batch: Sequence[Segment], *, whole: bool) -> Inputs:
    """Return the inputs of segments of equal length; `whole` includes the complete recordings' commands."""
    runs = [
        (one.run.knobs, one.run.durations, one.first_row) if whole else (one.knobs, one.durations, 0)
        for one in batch
    ]
    issued = np.array([len(knobs) for knobs, _, _ in runs])
    knobs = np.zeros((len(batch), int(issued.max()), 2))
    durations = None if batch[0].durations is None else np.zeros(knobs.shape[:2])
    for i, (run_knobs, run_durations, _) in enumerate(runs):
        knobs[i, : issued[i]] = run_knobs
        if durations is not None and run_durations is not None:
            durations[i, : issued[i]] = run_durations
    first = np.array([first for _, _, first in runs])
    rolled = np.array([one.run.way[one.first_row] for one in batch])
    recordings = list(dict.fromkeys(one.run for one in batch))
    paths = tuple(recording.rolled_path for recording in recordings)
    path = np.array([recordings.index(one.run) for one in batch])
    hold = batch[0].run.hold
    known = [one.run.before for one in batch if one.run.before is not None]
    before = np.array(known) if len(known) == len(batch) else None
    return Inputs(knobs, durations, first, issued, len(batch[0].knobs), rolled, paths, path, hold, before)


def segment_of(recording: Recording, stretch: slice, state: Array) -> Segment:
    """Return a segment with a start state (4,): position, and velocity per second."""
    return Segment(recording, stretch, state[:2], state[2:])


def guess(recording: Recording, head: slice, step_s: float, degree: int) -> Array:
    """Return position and velocity (4,) at the first row, from a polynomial through observed rows."""
    rows = np.flatnonzero(recording.seen[head])[:_GUESS_ROWS]
    if recording.stamps is None:
        times = rows * step_s
    else:
        times = recording.stamps[head][rows] - recording.stamps[head.start]
    powers = np.vander(times, min(degree + 1, len(rows)), increasing=True)
    coefficients = np.linalg.lstsq(powers, recording.marble[head][rows])[0]
    state = np.zeros((2, 2))
    state[: len(coefficients)] = coefficients[:2]
    return state.ravel()


def row_seconds(recording: Recording, substeps: float) -> float:
    """Return the duration of a row [s]: the median of the stamps, or else `substeps` physics updates."""
    if recording.durations is None:
        return substeps * SUBSTEP_S
    return float(np.median(recording.durations))


def rows_of(seconds: float, step_s: float) -> int:
    """Return the number of rows of a window of this length [s]."""
    return max(1, round(seconds / step_s))


def check_length(seconds: float) -> None:
    """Raise an error unless the length of a window [s] is positive and finite."""
    if not 0.0 < seconds < np.inf:
        raise IrtError(f"a window must be longer than 0 s, not {seconds}")
