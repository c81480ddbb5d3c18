"""Evaluate models on recordings: free runs, windows, the measured tilt, and their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from irt import arguments, display
from irt.engine import SUBSTEP_S
from irt.errors import IrtError
from irt.files import PathLike
from irt.measured_tilt import as_played, begun_at_tilt
from irt.model import LEAN, Model, as_model
from irt.recording import Recording
from irt.rig import Rig, as_recordings
from irt.segments import (
    LEAD_ROWS,
    Segment,
    check_length,
    guess,
    inputs_of,
    row_seconds,
    rows_of,
    segment_of,
    windows_of,
)
from irt.start_state import estimate_start_states, simulate, simulate_tilt

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

#: Finite-difference step of the lean of a run [rad].
_LEAN_STEP_RAD = 1e-4


@dataclass(frozen=True)
class Errors:
    """Errors of predicted positions over the observed rows and both axes.

    An idle axis, along which the marble never moves, is not counted.

    Attributes
    ----------
    mae, rmse, max : float
        Mean absolute, root mean square and largest absolute error of a coordinate [board edges].
    rows : int
        Number of rows compared.
    lost : int
        Number of rows skipped because the tracker lost the marble.
    """

    mae: float
    rmse: float
    max: float
    rows: int
    lost: int


@dataclass(frozen=True)
class TiltErrors:
    """Errors of the predicted tilt, by axis.

    Attributes
    ----------
    mae_x_rad, mae_y_rad : float or None
        Mean absolute error of the tilt about x and about y [rad]; None if it was not measured.
    rows : int
        Number of rows with a measured tilt about either axis.
    """

    mae_x_rad: float | None
    mae_y_rad: float | None
    rows: int


@dataclass(frozen=True, eq=False)
class RunEvaluation:
    """Errors of a model on one recording of n rows.

    Attributes
    ----------
    recording : str
        Name of the recording.
    free_run : Errors or None
        Errors of a simulation from row 0 to the end; None for a run without a marble.
    free_prediction : (n, 2) array
        The simulation from row 0 to the end [board edges]; NaN for a run without a marble.
    windowed : Errors or None
        Errors of windows, each started from the state estimated on the rows before it; None if no window
        fits.
    windowed_prediction : (n, 2) array
        Predictions of all windows [board edges], NaN in rows outside the windows.
    window_rows : (w,) int array
        First row of each window.
    tilt : TiltErrors or None
        Errors of the tilt, predicted from the commands from row 0 to the end; None if it was not measured.
    tilt_prediction : (n, 2) array or None
        The predicted tilt [rad].
    played : Errors or None
        Errors of the same windows with the measured tilt in place of the commands and the actuation, which
        are those of the marble's model alone. None if the tilt was not measured about both axes.
    """

    recording: str
    free_run: Errors | None
    free_prediction: Array
    windowed: Errors | None
    windowed_prediction: Array
    window_rows: NDArray[np.int64]
    tilt: TiltErrors | None = None
    tilt_prediction: Array | None = None
    played: Errors | None = None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Errors of a model on recordings.

    Attributes
    ----------
    window_s : float
        Length of the windows [s]; simulated time if the recordings have no stamps.
    runs : tuple of RunEvaluation
        One for each recording.
    free_run : Errors or None
        Errors over all free runs; None if no recording has a marble.
    windowed : Errors or None
        Errors over all windows; None if no window fits.
    tilt : TiltErrors or None
        Errors of the tilt over all recordings; None if it was never measured.
    played : Errors or None
        Errors over all windows under the measured tilt.
    window_length_rows : int or None
        Length of a window in rows if the recordings have no stamps, so that its duration is unknown.
    """

    window_s: float
    runs: tuple[RunEvaluation, ...]
    free_run: Errors | None
    windowed: Errors | None
    tilt: TiltErrors | None = None
    played: Errors | None = None
    window_length_rows: int | None = None

    @property
    def mae(self) -> float:
        """Mean absolute error of the free runs [board edges]; NaN if no recording has a marble."""
        return math.nan if self.free_run is None else self.free_run.mae

    def plot(self) -> Figure:
        """Draw the mean errors of each run; return a matplotlib figure."""
        from irt import pictures  # noqa: PLC0415

        kinds = {"free run": "free_run", self.windows: "windowed", "under the measured tilt": "played"}
        groups = {
            label: [
                math.nan if (errors := getattr(run, name)) is None else 100.0 * errors.mae
                for run in self.runs
            ]
            for label, name in kinds.items()
            if getattr(self, name) is not None
        }
        return pictures.bars([run.recording for run in self.runs], groups, "mean error  [% of edge]")

    def _repr_html_(self) -> str:
        runs: list[tuple[str, RunEvaluation | Evaluation]] = [(run.recording, run) for run in self.runs]
        rows = []
        for name, run in (*runs, ("all runs", self)):
            errors = (run.free_run, run.windowed, run.played)
            rows.append((name, *(display.percent(None if one is None else one.mae) for one in errors)))
        head = ("run", "free run", self.windows, "the same, under the measured tilt")
        return display.page("Mean errors, of the board's long edge", display.table(head, rows))

    @property
    def windows(self) -> str:
        """Description of the windows, with their length in seconds, or in rows without stamps."""
        rows = self.window_length_rows
        return f"windows of {self.window_s:g} s" if rows is None else f"windows of {rows} rows"

    def as_dict(self) -> dict[str, Any]:
        """Return the errors without the predictions, for JSON."""

        def shown(errors: RunEvaluation | Evaluation) -> dict[str, Any]:
            parts: dict[str, Errors | TiltErrors | None] = {
                "free_run": errors.free_run,
                "windowed": errors.windowed,
            }
            if errors.tilt is not None:
                parts |= {"tilt": errors.tilt, "played": errors.played}
            return {name: None if part is None else asdict(part) for name, part in parts.items()}

        return {
            "unit": "board edges",
            "window_s": self.window_s if self.window_length_rows is None else None,
            "window_rows": self.window_length_rows,
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
        If the model cannot be simulated, for example because of an unknown effect.
    """
    predicted: dict[int, Array] = {}
    for indices in _batches(stretches):
        batch = [stretches[i] for i in indices]
        paths = simulate(model, inputs_of(batch, whole=bool(model.effects)), _states(batch))
        predicted.update(zip(indices, paths, strict=True))
    return [predicted[i] for i in range(len(stretches))]


def free_run_error(model: Model, recording: Recording) -> float:
    """Return the mean absolute error [board edges] of a simulation from row 0 to the end (paper, Eq. 1).

    Raises
    ------
    IrtError
        If the recording has no marble.
    """
    errors = _errors([_free_run(model, recording)], [recording.marble], _idle_axes([recording]))
    if errors is None:
        raise IrtError(f"{recording.name}: the recording has no marble; there is no free run to compare")
    return errors.mae


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


@arguments.entry
def evaluate(
    model: Model | PathLike, recordings: Rig | PathLike | Sequence[Recording], window_s: float = 2.0
) -> Evaluation:
    """Evaluate a model on recordings, in free runs and in windows.

    A free run starts in row 0, at rest, or for recordings that start in motion from the state estimated on
    the first four rows. A window starts from the state estimated on the four rows before it (with stamps, on
    as many as a camera faster than 30 Hz takes in the time of four), and does not use the rows that it
    predicts. Windows follow one another without gaps, except where the marble was lost in more than a quarter
    of the rows before, and at the end, where no complete window fits.

    Parameters
    ----------
    model : Model or path
        The model, or its file.
    recordings : Rig, path or sequence of Recording
        A rig, its folder, or at least one recording, which may be a table.
    window_s : float
        Length of a window [s]; simulated time if the recordings have no stamps.

    Raises
    ------
    IrtError
        If there is nothing to evaluate, or the model cannot be simulated.
    """
    model = as_model(model)
    check_length(arguments.number("window_s", window_s))
    recordings = as_recordings(recordings)
    idle = _idle_axes(recordings)
    recordings = [begun_at_tilt(model, recording) for recording in recordings]
    observed = [recording.marble for recording in recordings]
    free = [_free_run(model, recording) for recording in recordings]
    windowed, firsts = _windowed(model, recordings, window_s)
    tilts = [_tilt(model, recording) for recording in recordings]
    played = [_played(model, recording, window_s) for recording in recordings]
    step_s = _substeps(model) * SUBSTEP_S
    unstamped = step_s > 0.0 and all(recording.stamps is None for recording in recordings)
    runs = tuple(
        RunEvaluation(
            recording=recording.name,
            free_run=_errors([free[i]], [recording.marble], idle),
            free_prediction=free[i],
            windowed=_errors([windowed[i]], [recording.marble], idle),
            windowed_prediction=windowed[i],
            window_rows=firsts[i],
            tilt=_tilt_errors([tilts[i]], [recording]),
            tilt_prediction=tilts[i],
            played=_errors([played[i]], [recording.marble], idle),
        )
        for i, recording in enumerate(recordings)
    )
    return Evaluation(
        window_s=window_s,
        runs=runs,
        free_run=_errors(free, observed, idle),
        windowed=_errors(windowed, observed, idle),
        tilt=_tilt_errors(tilts, recordings),
        played=_errors(played, observed, idle),
        window_length_rows=rows_of(window_s, step_s) if unstamped else None,
    )


def _free_run(model: Model, recording: Recording) -> Array:
    """Return the (n, 2) prediction from row 0 to the end; NaN without a marble."""
    rows = len(recording.knobs)
    if not recording.has_marble:
        return np.full((rows, 2), np.nan)
    state = np.append(recording.marble[0], [0.0, 0.0])
    if model.start == "moving":
        lead = int(np.flatnonzero(recording.seen)[:LEAD_ROWS][-1]) + 1
        state = guess(recording, slice(0, lead), row_seconds(recording, _substeps(model)), 1)
        state = _head_states(model, [segment_of(recording, slice(0, rows), state)], lead)[0]
    return predict(model, [segment_of(recording, slice(0, rows), state)])[0]


def _windowed(
    model: Model, recordings: Sequence[Recording], window_s: float
) -> tuple[list[Array], list[NDArray[np.int64]]]:
    """Return predictions in windows by recording, (n, 2), NaN outside, and the windows' first rows."""
    step = _substeps(model)
    windows = [windows_of(one, row_seconds(one, step), window_s) for one in recordings]
    flat = [window for of_one in windows for window in of_one]
    predicted = iter(
        _predict_with_lean(model, flat) if flat and _lean_size(model) > 0.0 else _predict_windows(model, flat)
    )
    joined, firsts = [], []
    for recording, of_one in zip(recordings, windows, strict=True):
        rows = np.array([window.first_row + window.lead for window in of_one], dtype=np.int64)
        together = np.full_like(recording.marble, np.nan)
        for first in rows:
            own = next(predicted)
            together[first : first + len(own)] = own
        joined.append(together)
        firsts.append(rows)
    return joined, firsts


def _lean_size(model: Model) -> float:
    """Return the standard deviation of the lean over runs [rad], 0 for a model without lean."""
    return next((one.parameters.get("size_rad", 0.0) for one in model.effects if one.name == LEAN), 0.0)


def _predict_with_lean(model: Model, windows: Sequence[Segment]) -> list[Array]:
    """Return the predictions of windows, each with the lean estimated from earlier windows of its run.

    The lean of a run has a normal prior whose size is a parameter of the model. Its posterior mean, given the
    residuals of earlier windows, is computed to first order. The errors within a window are correlated, so a
    window counts as one observation along each axis.
    """
    plain = _predict_windows(model, windows)
    slopes = []
    for axis in "xy":
        moved = tuple(
            replace(one, parameters={**one.parameters, f"lean_{axis}_rad": _LEAN_STEP_RAD})
            if one.name == LEAN
            else one
            for one in model.effects
        )
        ahead = _predict_windows(replace(model, effects=moved), windows)
        slopes.append([(a - b) / _LEAN_STEP_RAD for a, b in zip(ahead, plain, strict=True)])
    information, pull = np.eye(2), np.zeros(2)
    squares: list[float] = []
    predicted = []
    for i, window in enumerate(windows):
        if i == 0 or windows[i - 1].run is not window.run:
            information, pull, squares = np.zeros((2, 2)), np.zeros(2), []
        slope = np.stack([slopes[0][i], slopes[1][i]], axis=-1)
        variance = float(np.mean(squares)) if squares else np.inf
        prior = np.eye(2) / _lean_size(model) ** 2
        lean = np.linalg.solve(information / variance + prior, pull / variance) if squares else np.zeros(2)
        predicted.append(plain[i] + slope @ lean)
        error = window.observed[window.lead :] - plain[i]
        known = np.isfinite(error[:, 0])
        if known.any():
            information = information + np.einsum("nai,naj->ij", slope[known], slope[known]) / known.sum()
            pull = pull + np.einsum("nai,na->i", slope[known], error[known]) / known.sum()
            squares.append(float((error[known] ** 2).mean()))
    return predicted


def _played(model: Model, recording: Recording, window_s: float) -> Array:
    """Return the predictions in windows under the measured tilt, (n, 2); NaN where it is not available."""
    pair = as_played(model, recording) if recording.has_marble else None
    if pair is None:
        return np.full_like(recording.marble, np.nan)
    ((predicted,), _) = _windowed(pair[0], [pair[1]], window_s)
    return predicted


def _tilt(model: Model, recording: Recording) -> Array | None:
    """Return the tilt predicted from the commands, (n, 2) [rad]; None if none was measured."""
    if not recording.has_tilt:
        return None
    whole = segment_of(recording, slice(0, len(recording.knobs)), np.zeros(4))
    return np.asarray(simulate_tilt(model, inputs_of([whole], whole=True))[0])


def _predict_windows(model: Model, windows: Sequence[Segment]) -> list[Array]:
    """Return the (n, 2) predictions of windows, without the rows from which start states are estimated."""
    refined = list(windows)
    for indices in _batches(windows):
        heads = [windows[i] for i in indices]
        for i, state in zip(indices, _head_states(model, heads, heads[0].lead), strict=True):
            refined[i] = replace(windows[i], start=state[:2], start_velocity=state[2:])
    predictions = zip(windows, predict(model, refined), strict=True)
    return [predicted[window.lead :] for window, predicted in predictions]


def _head_states(model: Model, batch: Sequence[Segment], rows: int) -> Array:
    """Return the (w, 4) start states estimated on the first rows of segments of equal length."""
    inputs = replace(inputs_of(batch, whole=bool(model.effects)), rows=rows)
    observed = np.array([segment.observed[:rows] for segment in batch])
    return estimate_start_states(model, inputs, observed, _states(batch))


def _batches(stretches: Sequence[Segment]) -> list[list[int]]:
    """Group the indices of segments into batches of equal length, lead and kind of stamps."""
    batches: dict[tuple[int, int, bool, bool, str], list[int]] = {}
    for i, segment in enumerate(stretches):
        stamped, begun = segment.durations is not None, segment.run.before is not None
        key = (len(segment.knobs), segment.lead, stamped, begun, segment.run.hold)
        batches.setdefault(key, []).append(i)
    return list(batches.values())


def _states(batch: Sequence[Segment]) -> Array:
    return np.array([[*segment.start, *segment.start_velocity] for segment in batch])


def _substeps(model: Model) -> float:
    scale = model.parameters["time_scale"].value
    return scale if model.time_step == "continuous" else float(round(scale))


def _idle_axes(recordings: Sequence[Recording]) -> NDArray[np.bool_]:
    """Return whether the marble never moves along each axis, (2,)."""
    seen = np.concatenate([recording.marble[recording.seen] for recording in recordings])
    if len(seen) < 2:
        return np.zeros(2, dtype=np.bool_)
    idle = np.ptp(seen, axis=0) == 0.0
    return np.asarray(idle & ~idle.all())


def _errors(predicted: Sequence[Array], observed: Sequence[Array], idle: NDArray[np.bool_]) -> Errors | None:
    """Return the errors over all rows that were both predicted and observed; None if there are none."""
    joined = np.concatenate(predicted)
    error = joined - np.concatenate(observed)
    known = ~np.isnan(error[:, 0])
    rows = int(known.sum())
    if rows == 0:
        return None
    error = np.abs(error[known][:, ~idle])
    return Errors(
        mae=float(error.mean()),
        rmse=float(np.sqrt((error**2).mean())),
        max=float(error.max()),
        rows=rows,
        lost=int((~np.isnan(joined[:, 0])).sum()) - rows,
    )


def _tilt_errors(predicted: Sequence[Array | None], recordings: Sequence[Recording]) -> TiltErrors | None:
    """Return the errors of the tilt over all rows in which it was measured; None if there are none."""
    errors = [
        np.abs(one - recording.tilt)
        for one, recording in zip(predicted, recordings, strict=True)
        if one is not None and recording.tilt is not None
    ]
    if not errors:
        return None
    error = np.concatenate(errors)
    known = np.isfinite(error)
    x, y = (float(error[known[:, axis], axis].mean()) if known[:, axis].any() else None for axis in (0, 1))
    return TiltErrors(x, y, int(known.any(axis=1).sum()))
