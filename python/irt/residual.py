"""Prediction against recording: free runs, windows, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.model import Model
from irt.recording import Recording
from irt.segments import LEAD_ROWS, Segment, check_length, guess, inputs_of, row_seconds, rows_of, segment_of
from irt.start_state import estimate_start_states, simulate

Array = NDArray[np.float64]


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
    check_length(window_s)
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


def _free_run(model: Model, recording: Recording) -> Array:
    rows = len(recording.knobs)
    state = np.append(recording.marble[0], [0.0, 0.0])
    if model.start == "moving":
        lead = int(np.flatnonzero(recording.seen)[:LEAD_ROWS][-1]) + 1
        state = guess(recording, slice(0, lead), row_seconds(recording, _substeps(model)), 1)
        state = _head_states(model, [segment_of(recording, slice(0, rows), state)], lead)[0]
    return predict(model, [segment_of(recording, slice(0, rows), state)])[0]


def _windows(model: Model, recording: Recording, window_s: float) -> list[Segment]:
    """Return the windows of a recording, each with the four rows before it as its head."""
    step = row_seconds(recording, _substeps(model))
    if step == 0.0:
        return []
    rows = rows_of(window_s, step)
    found = []
    first = 0
    while (end := first + LEAD_ROWS + rows) <= len(recording.knobs):
        head = slice(first, first + LEAD_ROWS)
        if recording.seen[head].sum() < LEAD_ROWS - 1 or not recording.seen[head.stop : end].any():
            first += 1
            continue
        found.append(segment_of(recording, slice(first, end), guess(recording, head, step, 1)))
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


def _states(batch: Sequence[Segment]) -> Array:
    return np.array([[*segment.start, *segment.start_velocity] for segment in batch])


def _substeps(model: Model) -> float:
    scale = model.parameters["time_scale"].value
    return scale if model.time_step == "continuous" else float(round(scale))


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
