"""Prediction against recording: what a fit predicts, free runs, windows, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.model import Model
from irt.recording import Recording
from irt.rig import Rig
from irt.rollouts import SUBSTEP_S
from irt.start_state import Inputs, estimate_start_states, simulate

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
        )


@dataclass(frozen=True)
class Errors:
    """How far predicted positions lie from observed ones, over the rows that the tracker saw and both axes.

    Attributes
    ----------
    mae, rmse, max : float
        Mean absolute, root mean square and largest absolute error of a coordinate [board edges].
    rows : int
        Rows compared.
    lost : int
        Rows left out, because the tracker lost the marble.
    """

    mae: float
    rmse: float
    max: float
    rows: int
    lost: int


@dataclass(frozen=True, eq=False)
class RunEvaluation:
    """Errors of a model on one recording of n rows.

    Attributes
    ----------
    recording : str
        Name of the recording.
    free_run : Errors
        Of one simulation from row 0 to the end.
    free_prediction : (n, 2) array
        That simulation [board edges].
    windowed : Errors or None
        Of windows, each started from the state estimated on the rows before it; None where no window fits.
    windowed_prediction : (n, 2) array
        All windows one after another [board edges], NaN in rows outside of any.
    window_rows : (w,) int array
        First row of each window.
    """

    recording: str
    free_run: Errors
    free_prediction: Array
    windowed: Errors | None
    windowed_prediction: Array
    window_rows: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Errors of a model on recordings.

    Attributes
    ----------
    window_s : float
        Length of the windows [s].
    runs : tuple of RunEvaluation
        One for each recording.
    free_run : Errors
        Of all recordings together.
    windowed : Errors or None
        Of all windows together; None where none fits.
    """

    window_s: float
    runs: tuple[RunEvaluation, ...]
    free_run: Errors
    windowed: Errors | None

    def as_dict(self) -> dict[str, Any]:
        """Return the errors, without the predictions, as JSON takes them."""

        def shown(errors: RunEvaluation | Evaluation) -> dict[str, Any]:
            windowed = None if errors.windowed is None else asdict(errors.windowed)
            return {"free_run": asdict(errors.free_run), "windowed": windowed}

        return {
            "unit": "board edges",
            "window_s": self.window_s,
            "overall": shown(self),
            "runs": [{"recording": run.recording, **shown(run)} for run in self.runs],
        }


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
        _check_length(seconds)
    middle = sum(rig.ranges["time_scale"]) / 2.0
    found: list[Segment] = []
    for recording in rig.recordings:
        rows = len(recording.knobs)
        step = _step_s(recording, middle)
        if seconds is not None or rig.start == "moving":
            rows = _rows(seconds or SEGMENT_S, step)
        for first in range(0, len(recording.knobs), rows):
            stretch = slice(first, first + rows)
            if first == 0 and rig.start == "rest":
                found.append(_segment(recording, stretch, np.append(recording.marble[0], [0.0, 0.0])))
            elif recording.seen[stretch].sum() >= LEAD_ROWS:
                found.append(_segment(recording, stretch, _guess(recording, stretch, step, 2)))
    return found


def predict(model: Model, stretches: Sequence[Segment]) -> list[Array]:
    """Simulate segments from their start states.

    Returns
    -------
    list of (n, 2) arrays
        Predicted positions of each segment [board edges], the start in row 0.

    Raises
    ------
    IrtError
        If the model cannot be simulated, say because the engine does not know one of its effects.
    """
    predicted: dict[int, Array] = {}
    for indices in _batches(stretches):
        batch = [stretches[i] for i in indices]
        paths = simulate(model, inputs_of(batch, whole=bool(model.effects)), _states(batch))
        predicted.update(zip(indices, paths, strict=True))
    return [predicted[i] for i in range(len(stretches))]


def free_run_error(model: Model, recording: Recording) -> float:
    """Return the mean absolute error [board edges] of one simulation from row 0 to the end (paper, Eq. 1)."""
    return _errors([_free_run(model, recording)], [recording.marble]).mae


def windowed_error(model: Model, recording: Recording, seconds: float) -> float:
    """Return the mean absolute error [board edges] of windows of this length [s]; see `evaluate`.

    Raises
    ------
    IrtError
        If the recording is too short for a window, or the marble was lost too often.
    """
    errors = evaluate(model, [recording], seconds).windowed
    if errors is None:
        raise IrtError(f"{recording.name}: no window of {seconds:g} s fits; choose a shorter one")
    return errors.mae


def evaluate(model: Model, recordings: Sequence[Recording], window_s: float = 2.0) -> Evaluation:
    """Measure a model against recordings: in free runs and in windows.

    A free run starts in row 0: at rest, or for a model of recordings that start in motion, from the state
    that the first four rows tell. A window starts from the state estimated on the four rows before it and
    never sees the rows that it predicts. Windows follow one another without a gap, except where the marble
    was lost in more than one of the four rows, or at the end, where no whole one fits.

    Parameters
    ----------
    model : Model
        The simulator.
    recordings : sequence of Recording
        At least one.
    window_s : float
        Length of a window [s], of simulated time where the recordings have no stamps.

    Raises
    ------
    IrtError
        If there is nothing to evaluate, or the model cannot be simulated.
    """
    if not recordings:
        raise IrtError("no recording to evaluate the model on")
    _check_length(window_s)
    free = [_free_run(model, recording) for recording in recordings]
    windows = [_windows(model, recording, window_s) for recording in recordings]
    told = iter(_predict_windows(model, [window for of_one in windows for window in of_one]))
    runs = []
    for recording, free_prediction, of_one in zip(recordings, free, windows, strict=True):
        joined = np.full_like(recording.marble, np.nan)
        first_rows = np.array([window.first_row + LEAD_ROWS for window in of_one], dtype=np.int64)
        for first in first_rows:
            predicted = next(told)
            joined[first : first + len(predicted)] = predicted
        runs.append(
            RunEvaluation(
                recording=recording.name,
                free_run=_errors([free_prediction], [recording.marble]),
                free_prediction=free_prediction,
                windowed=_errors([joined], [recording.marble]) if of_one else None,
                windowed_prediction=joined,
                window_rows=first_rows,
            )
        )
    observed = [recording.marble for recording in recordings]
    return Evaluation(
        window_s=window_s,
        runs=tuple(runs),
        free_run=_errors(free, observed),
        windowed=_errors([run.windowed_prediction for run in runs], observed) if any(windows) else None,
    )


def _check_length(seconds: float) -> None:
    if not 0.0 < seconds < np.inf:
        raise IrtError(f"a window must be longer than 0 s, not {seconds}")


def _free_run(model: Model, recording: Recording) -> Array:
    rows = len(recording.knobs)
    state = np.append(recording.marble[0], [0.0, 0.0])
    if model.start == "moving":
        lead = int(np.flatnonzero(recording.seen)[:LEAD_ROWS][-1]) + 1
        state = _guess(recording, slice(0, lead), _step_s(recording, _substeps(model)), 1)
        state = _head_states(model, [_segment(recording, slice(0, rows), state)], lead)[0]
    return predict(model, [_segment(recording, slice(0, rows), state)])[0]


def _windows(model: Model, recording: Recording, window_s: float) -> list[Segment]:
    """Return the windows of a recording, each with the four rows before it as its head."""
    step = _step_s(recording, _substeps(model))
    if step == 0.0:
        return []
    rows = _rows(window_s, step)
    found = []
    first = 0
    while (end := first + LEAD_ROWS + rows) <= len(recording.knobs):
        head = slice(first, first + LEAD_ROWS)
        if recording.seen[head].sum() < LEAD_ROWS - 1 or not recording.seen[head.stop : end].any():
            first += 1
            continue
        found.append(_segment(recording, slice(first, end), _guess(recording, head, step, 1)))
        first += rows
    return found


def _predict_windows(model: Model, windows: Sequence[Segment]) -> list[Array]:
    """Return the (n, 2) predictions of windows, their heads left out: these tell the start states."""
    refined = list(windows)
    for indices in _batches(windows):
        heads = [windows[i] for i in indices]
        for i, state in zip(indices, _head_states(model, heads, LEAD_ROWS), strict=True):
            refined[i] = replace(windows[i], start=state[:2], start_velocity=state[2:])
    return [predicted[LEAD_ROWS:] for predicted in predict(model, refined)]


def _head_states(model: Model, batch: Sequence[Segment], rows: int) -> Array:
    """Return the (w, 4) start states that the first rows of segments of one length tell."""
    inputs = replace(inputs_of(batch, whole=bool(model.effects)), rows=rows)
    observed = np.array([segment.observed[:rows] for segment in batch])
    return estimate_start_states(model, inputs, observed, _states(batch))


def _batches(stretches: Sequence[Segment]) -> list[list[int]]:
    """Return the indices of segments that one batch can hold: of one length, all stamped or none."""
    batches: dict[tuple[int, bool], list[int]] = {}
    for i, segment in enumerate(stretches):
        batches.setdefault((len(segment.knobs), segment.durations is None), []).append(i)
    return list(batches.values())


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
    return Inputs(knobs, durations, first, issued, len(batch[0].knobs))


def _states(batch: Sequence[Segment]) -> Array:
    return np.array([[*segment.start, *segment.start_velocity] for segment in batch])


def _segment(recording: Recording, stretch: slice, state: Array) -> Segment:
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
    )


def _guess(recording: Recording, head: slice, step_s: float, degree: int) -> Array:
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


def _step_s(recording: Recording, substeps: float) -> float:
    """Return the time between two rows [s]: the median of the stamps', else so many physics updates."""
    if recording.durations is None:
        return substeps * SUBSTEP_S
    return float(np.median(recording.durations))


def _substeps(model: Model) -> float:
    scale = model.parameters["time_scale"].value
    return scale if model.time_step == "continuous" else float(round(scale))


def _rows(seconds: float, step_s: float) -> int:
    """Return how many rows make up a window of this length."""
    return max(1, round(seconds / step_s))


def _errors(predicted: Sequence[Array], observed: Sequence[Array]) -> Errors:
    """Return the errors over all rows that were both predicted and seen; there must be one."""
    told = np.concatenate(predicted)
    error = told - np.concatenate(observed)
    known = ~np.isnan(error[:, 0])
    rows = int(known.sum())
    error = np.abs(error[known])
    return Errors(
        mae=float(error.mean()),
        rmse=float(np.sqrt((error**2).mean())),
        max=float(error.max()),
        rows=rows,
        lost=int((~np.isnan(told[:, 0])).sum()) - rows,
    )
