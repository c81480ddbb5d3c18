"""What is predicted in one go: stretches of recordings, and the commands that go with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.recording import Recording
from irt.rig import Rig
from irt.rollouts import SUBSTEP_S
from irt.start_state import Inputs

Array = NDArray[np.float64]

#: Length of the windows that a fit predicts of a marble in motion (s).
SEGMENT_S = 2.5
#: Rows from which the start state of a window is estimated.
LEAD_ROWS = 4
#: Rows through which the first guess of a segment's start state is laid.
_GUESS_ROWS = 6


@dataclass(frozen=True, eq=False)
class Segment:
    """A stretch of a recording that is predicted in one go.

    Attributes
    ----------
    recording : str
        Name of the recording.
    first_row : int
        The recording's row where the segment begins.
    knobs : (n, 2) array
        Commanded knob angles [rad].
    durations : (n,) array or None
        How long each command holds [s], where the recording is stamped.
    observed : (n, 2) array
        Positions [board edges], NaN rows where the tracker lost the marble.
    start : (2,) array
        Position at the first row [board edges].
    start_velocity : (2,) array
        Velocity at the first row [board edges per second of simulated time].
    run_knobs : (m, 2) array or None
        Commands of the whole recording [rad], which effects may remember; by default there is no more of it.
    run_durations : (m,) array or None
        How long those hold [s].
    way : (n,) array or None
        How far the marble has rolled from the recording's row 0 to each row [board edges].
    run_path : (m, 2) array or None
        Where it has rolled in the whole recording, a place a row [board edges].
    """

    recording: str
    first_row: int
    knobs: Array
    durations: Array | None
    observed: Array
    start: Array
    start_velocity: Array
    run_knobs: Array | None = None
    run_durations: Array | None = None
    way: Array | None = None
    run_path: Array | None = None

    def cut(self, first: int, stop: int) -> Segment:
        """Return some of its rows, with the commands before them; how the marble begins is not known."""
        own, whole = slice(first, stop), self.run_knobs is None
        return Segment(
            recording=self.recording,
            first_row=self.first_row + first,
            knobs=self.knobs[own],
            durations=None if self.durations is None else self.durations[own],
            observed=self.observed[own],
            start=np.full(2, np.nan),
            start_velocity=np.full(2, np.nan),
            run_knobs=self.knobs if whole else self.run_knobs,
            run_durations=self.durations if whole else self.run_durations,
            way=None if self.way is None else self.way[own],
            run_path=self.run_path,
        )


def segments(rig: Rig, seconds: float | None = None) -> list[Segment]:
    """Return what a fit predicts: whole recordings that start at rest, or windows of them.

    Parameters
    ----------
    rig : Rig
        Where the recordings come from.
    seconds : float, optional
        Length of a window [s]; without stamps the middle of the range of ``time_scale`` gives the time. By
        default there are windows, of 2.5 s, only where the rig's marble starts in motion.

    Returns
    -------
    list of Segment
        In the order of recordings and rows. Start states are first guesses, which a fit refines: at rest in
        the place of row 0, or from a parabola through the first rows of a window. Stretches with less than
        four rows that the tracker saw say no more than their own start state takes, and are left out.

    Raises
    ------
    IrtError
        If the length is none.
    """
    if seconds is not None:
        check_length(seconds)
    middle = sum(rig.ranges["time_scale"]) / 2.0
    found: list[Segment] = []
    for recording in rig.recordings:
        rows = len(recording.knobs)
        step = row_seconds(recording, middle)
        if seconds is not None or rig.start == "moving":
            rows = rows_of(seconds or SEGMENT_S, step)
        for first in range(0, len(recording.knobs), rows):
            stretch = slice(first, first + rows)
            if first == 0 and rig.start == "rest":
                found.append(segment_of(recording, stretch, np.append(recording.marble[0], [0.0, 0.0])))
            elif recording.seen[stretch].sum() >= LEAD_ROWS:
                found.append(segment_of(recording, stretch, guess(recording, stretch, step, 2)))
    return found


def inputs_of(batch: Sequence[Segment], *, whole: bool) -> Inputs:
    """Return the commands of segments of one length, with those of their whole recordings or alone."""
    runs = [
        (segment.run_knobs, segment.run_durations, segment.first_row)
        if whole and segment.run_knobs is not None
        else (segment.knobs, segment.durations, 0)
        for segment in batch
    ]
    issued = np.array([len(knobs) for knobs, _, _ in runs])
    knobs = np.zeros((len(batch), int(issued.max()), 2))
    durations = None if batch[0].durations is None else np.zeros(knobs.shape[:2])
    for i, (run_knobs, run_durations, _) in enumerate(runs):
        knobs[i, : issued[i]] = run_knobs
        if durations is not None and run_durations is not None:
            durations[i, : issued[i]] = run_durations
    first = np.array([first for _, _, first in runs])
    rolled = np.array([0.0 if segment.way is None else segment.way[0] for segment in batch])
    return Inputs(knobs, durations, first, issued, len(batch[0].knobs), rolled, *_paths_of(batch))


def _paths_of(batch: Sequence[Segment]) -> tuple[tuple[Array, ...], NDArray[np.int64]]:
    """Return the paths of the recordings that segments are of, each once, and which each segment is of."""
    # By the arrays themselves: recordings of several folders may share a name.
    known: dict[int, int] = {}
    paths: list[Array] = []
    for segment in batch:
        if id(segment.run_path) not in known:
            known[id(segment.run_path)] = len(paths)
            paths.append(np.zeros((1, 2)) if segment.run_path is None else segment.run_path)
    return tuple(paths), np.array([known[id(segment.run_path)] for segment in batch])


def segment_of(recording: Recording, stretch: slice, state: Array) -> Segment:
    """Return rows of a recording that begin in a state (4,): place, and rate a second."""
    durations = recording.durations
    return Segment(
        recording=recording.name,
        first_row=stretch.start,
        knobs=recording.knobs[stretch],
        durations=None if durations is None else durations[stretch],
        observed=recording.marble[stretch],
        start=state[:2],
        start_velocity=state[2:],
        run_knobs=recording.knobs,
        run_durations=durations,
        way=recording.way[stretch],
        run_path=recording.rolled_path,
    )


def guess(recording: Recording, head: slice, step_s: float, degree: int) -> Array:
    """Return position and velocity, (4,), at the first row of a polynomial through the first rows seen."""
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
    """Return the time between two rows [s]: the median of the stamps', else so many physics updates."""
    if recording.durations is None:
        return substeps * SUBSTEP_S
    return float(np.median(recording.durations))


def rows_of(seconds: float, step_s: float) -> int:
    """Return how many rows make up a window of this length."""
    return max(1, round(seconds / step_s))


def check_length(seconds: float) -> None:
    """Raise an error where a window has no length [s]."""
    if not 0.0 < seconds < np.inf:
        raise IrtError(f"a window must be longer than 0 s, not {seconds}")
