"""A library of simulated paths: the parameters of the path nearest to the target are a start point.

A network that predicts parameters is misled by physics that its training did not contain: the path of its
prediction need not be near the target. The nearest path of a library is near it by construction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from irt.rig import PARAMETERS
from irt.tuning.drive import Drive

Array = NDArray[np.float64]

#: Paths of a library: their simulation takes as long as that of two pools of the training.
PATHS = 20_000
#: Paths that are simulated in one call: what is kept of them is smaller.
_AT_ONCE = 2_000
_SEED = 2024


@dataclass(frozen=True, eq=False)
class Library:
    """Paths from all over the ranges of a drive, simulated when one is first asked for.

    Attributes
    ----------
    drive : Drive
        What is simulated.
    threads : int, optional
        Of the engine; no path depends on it.
    """

    drive: Drive
    threads: int | None = None

    def nearest(self, target: Sequence[Array]) -> tuple[Array, float]:
        """Return the parameters (1, 5) of the path nearest to observations (1, n, 2) of each run; how near.

        The distance is the mean absolute one of what a network would see [board edges].
        """
        parameters, paths = self._simulated
        seen = self.drive.inputs(target).astype(np.float32)
        distances = np.abs(paths - seen).mean(axis=1)
        first = int(distances.argmin())
        return parameters[first : first + 1], float(distances[first])

    @cached_property
    def _simulated(self) -> tuple[Array, NDArray[np.float32]]:
        random = np.random.default_rng(_SEED)
        parameters = self.drive.parameters(random.random((PATHS, len(PARAMETERS))))
        paths = [
            self.drive.inputs(self.drive.simulate(parameters[at : at + _AT_ONCE], self.threads))
            for at in range(0, PATHS, _AT_ONCE)
        ]
        return parameters, np.concatenate([each.astype(np.float32) for each in paths])
