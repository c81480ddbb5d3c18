"""Use a measured tilt in predictions: as initial tilt, and in place of the commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt import catalogue
from irt.model import TILT_SENSOR, Model, Parameter
from irt.recording import KNOBS, Recording
from irt.start_state import Inputs, simulate_tilt

Array = NDArray[np.float64]


def as_played(model: Model, recording: Recording) -> tuple[Model, Recording] | None:
    """Return a model and a recording in which the measured tilt replaces the commands.

    Effects between command and tilt are removed from the model. The tilt is interpolated linearly between
    rows, and across rows without a measurement. Returns None unless the tilt was measured about both axes.
    """
    if not has_both_tilts(recording):
        return None
    sensor = next((one.parameters for one in model.effects if one.name == TILT_SENSOR), {})
    zero = np.array([sensor.get("zero_x_rad", 0.0), sensor.get("zero_y_rad", 0.0)])
    gain = np.array([sensor.get("gain_x", 1.0), sensor.get("gain_y", 1.0)])
    parameters = {**model.parameters, "gear_x": Parameter(1.0), "gear_y": Parameter(1.0)}
    kept = tuple(one for one in model.effects if not catalogue.effect(one.name).moves_board)
    return replace(model, parameters=parameters, effects=kept), play_tilt(recording, zero, gain)


def has_both_tilts(recording: Recording) -> bool:
    """Whether the tilt was measured about both axes, at least in some rows."""
    return recording.tilt is not None and bool(np.isfinite(recording.tilt).any(axis=0).all())


def play_tilt(recording: Recording, zero: Array, gain: Array) -> Recording:
    """Return a recording whose commands are its measured tilt minus (2,) zeros, divided by (2,) gains [rad].

    The tilt is interpolated linearly between rows, and across rows without a measurement. A command holds
    over its row and is the mean over it: the tilt at its beginning would come half a row late.
    """
    assert recording.tilt is not None, recording.name
    rows = np.arange(len(recording.tilt))
    columns = [np.interp(rows, rows[np.isfinite(tilt)], tilt[np.isfinite(tilt)]) for tilt in recording.tilt.T]
    tilt = np.stack(columns, axis=1)
    over_rows = 0.5 * (tilt + np.concatenate([tilt[1:], tilt[-1:]]))
    return replace(
        recording,
        knobs=(over_rows - zero) / gain,
        tilt=None,
        hold="first",
        before=None,
        columns=KNOBS,
    )


def begun_at_tilt(model: Model, recording: Recording) -> Recording:
    """Return a recording in motion with commands before row 0 that give the tilt measured in row 0.

    Like the marble's position in row 0, this sets the initial state of a prediction: the actuator's delay and
    lag depend on commands before the recording, which are unknown.
    """
    if model.start != "moving" or recording.tilt is None or not np.isfinite(recording.tilt[0]).all():
        return recording
    rest = Inputs.of_whole(np.zeros((1, 1, 2)))
    slope = np.array([model.parameters[name].value for name in ("gear_x", "gear_y")])
    sensor = next((one.parameters for one in model.effects if one.name == TILT_SENSOR), {})
    slope *= [sensor.get("gain_x", 1.0), sensor.get("gain_y", 1.0)]
    level = simulate_tilt(model, replace(rest, before=np.zeros((1, 2))))[0, 0]
    if not slope.all():
        return recording
    return replace(recording, before=(recording.tilt[0] - level) / slope)
