"""Iterative residual tuning: simulate a proposal, estimate its parameter error, step, repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.fitting.fit import Progress
from irt.tuning.drive import Drive
from irt.tuning.search import lacking, left_over
from irt.tuning.tunenet import TuneNet

Array = NDArray[np.float64]

#: Factor by which each step is shorter than the one before (paper, section 5.3).
STEP_DECAY = 0.85
#: A row is an outlier of the tracker if its distance from the median of five rows around it exceeds this many
#: typical distances, and this distance [board edges].
_SPIKE, _SPIKE_EDGES = 8.0, 0.02


@dataclass(frozen=True, eq=False)
class Trace:
    """Proposals over the iterations.

    Attributes
    ----------
    scaled : (iterations + 1, k, 5) array
        Parameters scaled to [0, 1]; the first are the start points.
    mae : (iterations + 1, k) array
        Mean absolute error of their observations over the rows seen [board edges].
    """

    scaled: Array
    mae: Array


@dataclass(frozen=True, eq=False)
class Tuner:
    """The iteration, for one drive and one network.

    Attributes
    ----------
    drive : Drive
        The simulated drive.
    network : TuneNet
        A network for this drive if ``joint``, else for each of its runs.
    joint : bool
        Whether the network sees all runs at once; otherwise the mean of its estimates for all runs is used.
    both_orders : bool
        Whether the network is evaluated in both orders (`TuneNet.both_orders`); in the paper it is once.
    """

    drive: Drive
    network: TuneNet
    joint: bool
    both_orders: bool = True

    def iterate(
        self,
        scaled: Array,
        observed: Sequence[Array],
        iterations: int,
        *,
        decay: float = STEP_DECAY,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Trace:
        """Tune k proposals at once (paper, sections 4 and 5.3).

        Parameters
        ----------
        scaled : (k, 5) array
            Start points, scaled to [0, 1].
        observed : sequence of (n, 2) or (k, n, 2) arrays
            Target observations of each run [board edges], NaN in lost rows.
        iterations : int
            Number of steps; each is clipped to the ranges.
        decay : float
            Factor of each step's length relative to the one before.
        threads : int, optional
            Threads of the simulations.
        progress : callable, optional
            Called with (done, total, text).
        """
        path, errors = [np.where(self.drive.open, scaled, 0.0)], []
        for k in range(iterations + 1):
            proposed = self.drive.simulate(self.drive.parameters(path[-1]), threads)
            missing = lacking(proposed, observed)
            errors.append(np.abs(left_over(self.drive, missing, observed)).mean(axis=1))
            if progress:
                progress(k, iterations, f"tuning, error {100 * errors[-1].min():.2f} % of the edge")
            if k < iterations:
                estimated = self._difference(proposed, missing)
                path.append(np.clip(path[-1] + decay**k * estimated, 0.0, 1.0))
        return Trace(np.array(path), np.array(errors))

    def _difference(self, proposed: Sequence[Array], missing: Sequence[Array]) -> Array:
        """Estimated (k, 5) differences of the scaled parameters, target minus proposal."""
        target = [p + m for p, m in zip(proposed, missing, strict=True)]
        if self.joint:
            estimated = self._ask(self.drive.inputs(proposed), self.drive.inputs(target))
        else:
            estimated = np.mean(
                [self._ask(_flat(p), _flat(t)) for p, t in zip(proposed, target, strict=True)], axis=0
            )
        return np.where(self.drive.open, estimated, 0.0)

    def _ask(self, proposed: Array, target: Array) -> Array:
        ask = self.network.both_orders if self.both_orders else self.network
        return ask(proposed, target)


def without_spikes(observed: Array) -> Array:
    """Return an (n, 2) observation with NaN for outliers of the tracker.

    An outlier differs from the rows around it. In fast turns a true row may too, which costs one row of many.
    """
    rows = np.flatnonzero(np.isfinite(observed[:, 0]))
    if len(rows) < 5:
        return observed
    seen = observed[rows]
    around = np.lib.stride_tricks.sliding_window_view(np.pad(seen, ((2, 2), (0, 0)), mode="edge"), 5, axis=0)
    off = np.abs(seen - np.median(around, axis=-1))
    typical = np.median(off[off > 0]) if (off > 0).any() else 0.0
    cleaned = observed.copy()
    cleaned[rows[(off > max(_SPIKE * typical, _SPIKE_EDGES)).any(axis=1)]] = np.nan
    return cleaned


def _flat(observed: Array) -> Array:
    return observed.reshape(len(observed), -1)
