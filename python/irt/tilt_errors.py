"""Errors of the predicted tilt: as they are, and without what a zero and a gain would explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import tilt_jumps
from irt.model import Model
from irt.recording import Recording
from irt.segments import SETTLING_S, inputs_of, segment_of
from irt.start_state import simulate_tilt

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AxisErrors:
    """Root mean square of the measured minus the predicted tilt about one axis [rad].

    Attributes
    ----------
    raw : float
        As it is; a sensor's own zero counts as an error.
    zero : float
        After the mean over all rows is taken away.
    gain : float
        After the best gain and zero, which leaves errors of shape and time.
    rows : int
        Number of rows compared.
    """

    raw: float
    zero: float
    gain: float
    rows: int

    def as_dict(self) -> dict[str, float | int]:
        """Return them as JSON content."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Predicted:
    """The tilt of one recording as a model predicts it.

    Attributes
    ----------
    recording : Recording
        The recording with its measured tilt.
    tilt : (n, 2) array
        The predicted tilt [rad].
    """

    recording: Recording
    tilt: Array

    @property
    def measured(self) -> Array:
        """The measured tilt, (n, 2) [rad]; NaN in rows that are not compared."""
        return comparable(self.recording)


def is_comparable(recording: Recording) -> bool:
    """Whether a recording has stamps and, in rows that are compared, a tilt about both axes."""
    if recording.tilt is None or recording.stamps is None:
        return False
    return bool(np.isfinite(comparable(recording)).any(axis=0).all())


def compared_tilt(recording: Recording) -> Array | None:
    """Return what `comparable` does, or None without stamps or without a tilt that changes."""
    if not is_comparable(recording):
        return None
    tilt = comparable(recording)
    return tilt if (np.nanmax(tilt, axis=0) > np.nanmin(tilt, axis=0)).any() else None


def comparable(recording: Recording) -> Array:
    """Return the measured tilt, (n, 2) [rad], NaN in the first rows and while a marker was hidden."""
    assert recording.tilt is not None, recording.name
    assert recording.stamps is not None, recording.name
    tilt = recording.tilt.copy()
    tilt[recording.stamps - recording.stamps[0] < SETTLING_S] = np.nan
    tilt[tilt_jumps(recording.tilt, recording.stamps)] = np.nan
    return tilt


def predicted(model: Model, recording: Recording) -> Predicted:
    """Return the tilt that a model predicts from the commands of a recording alone."""
    whole = segment_of(recording, slice(0, len(recording.knobs)), np.zeros(4))
    return Predicted(recording, np.asarray(simulate_tilt(model, inputs_of([whole], whole=True))[0]))


def errors(runs: Sequence[Predicted]) -> tuple[AxisErrors, AxisErrors]:
    """Return the errors about x and about y over all rows of some recordings."""
    measured = np.concatenate([one.measured for one in runs])
    tilt = np.concatenate([one.tilt for one in runs])
    x, y = (_of_axis(measured[:, axis], tilt[:, axis]) for axis in range(2))
    return x, y


def _of_axis(measured: Array, tilt: Array) -> AxisErrors:
    known = np.isfinite(measured)
    off = measured[known] - tilt[known]
    terms = np.stack([tilt[known], np.ones(known.sum())], axis=1)
    best = np.linalg.lstsq(terms, measured[known])[0]
    return AxisErrors(
        _rms(off), _rms(off - off.mean()), _rms(measured[known] - terms @ best), int(known.sum())
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
