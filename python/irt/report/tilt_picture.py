"""Picture of a measured tilt beside the one that a diagnosis predicts from the commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from irt.diagnosis.result import RunProof
from irt.report.page import Picture
from irt.report.plots import plot_tilt
from irt.rig import Rig
from irt.tilt_errors import errors, is_comparable, predicted


def tilt_picture(folder: Path, rig: Rig, runs: Sequence[RunProof]) -> Picture | None:
    """Draw the tilt of the recording with the largest error; None without a measured tilt.

    Parameters
    ----------
    folder : Path
        Folder of the picture.
    rig : Rig
        The rig with its recordings.
    runs : sequence of RunProof
        The models fitted to the other recordings, one for each recording.
    """
    models = {run.recording: run.final_model for run in runs}
    recordings = [one for one in rig.recordings if is_comparable(one) and one.name in models]
    if not recordings:
        return None
    worst = max(
        (predicted(models[one.name], one) for one in recordings),
        key=lambda one: sum(axis.zero**2 for axis in errors([one])),
    )
    x, y = errors([worst])
    zero = np.nanmean(worst.measured - worst.tilt, axis=0)
    path = folder / "tilt.svg"
    plot_tilt(path, replace(worst.recording, tilt=worst.measured), worst.tilt + zero)
    return Picture(
        path,
        f"{worst.recording.name}, the recording with the largest error: {1000.0 * x.zero:.2g} mrad about x, "
        f"{1000.0 * y.zero:.2g} mrad about y (root mean square). The line is predicted from the commands "
        f"alone and moved by the sensor's zero of {1000.0 * zero[0]:.2g} and {1000.0 * zero[1]:.2g} mrad.",
    )
