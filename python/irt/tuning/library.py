"""A library of simulated paths: the parameters of the path nearest to the target are a start point.

A network that predicts parameters may fail for physics outside its training: the path of its prediction may
be far from the target. The nearest path of a library is close by construction.
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

#: Number of paths in a library; their simulation takes as long as that of two pools of the training.
PATHS = 20_000
#: Number of paths per call; only their inputs to the network are kept.
_AT_ONCE = 2_000
_SEED = 2024


@dataclass(frozen=True, eq=False)
class Library:
    """Paths from the whole ranges of a drive, simulated on first use.

    Attributes
    ----------
    drive : Drive
        The simulated drive.
    threads : int, optional
        Threads of the engine; paths do not depend on them.
    """

    drive: Drive
    threads: int | None = None

    def nearest(self, target: Sequence[Array]) -> tuple[Array, float]:
        """Return parameters (1, 5) and distance of the path nearest to observations (1, n, 2) of each run.

        The distance is the mean absolute difference of the network's inputs [board edges].
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
