"""Direct prediction, a baseline of the paper: the same network estimates parameters from the target alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.tuning.cache import Need
from irt.tuning.search import lacking
from irt.tuning.tunenet import NetworkFile, TuneNet

Array = NDArray[np.float64]


def predicted(needed: Need, file: NetworkFile, observed: Sequence[Array]) -> Array:
    """Return the estimated parameters (1, 5) from observations (n, 2) of each run of a rig."""
    # The difference to zero: the observations, with lost rows interpolated.
    target = lacking([np.zeros((1, *each.shape)) for each in observed], observed)
    drive = needed.rig_drive
    if needed.joint:
        scaled = suggested(file.network, drive.inputs(target))
    else:
        scaled = np.mean([suggested(file.network, run.reshape(1, -1)) for run in target], axis=0)
    return drive.parameters(np.clip(scaled, 0.0, 1.0))


def suggested(network: TuneNet, inputs: Array) -> Array:
    """Return the estimated parameters (k, 5), scaled to [0, 1], from inputs (k, m)."""
    return network(np.zeros_like(inputs), inputs)
