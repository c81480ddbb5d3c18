"""The interface of searches: a search yields proposals to simulate and receives the results.

A search is a generator that yields parameters (k, 5) and receives a `Seen`. Its driver counts the rollouts
and stops it, so that any number of searches share one call of the engine.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.fitting.fit import Progress
from irt.tuning.drive import Drive

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Seen:
    """Simulations of k proposals, compared with the target.

    Attributes
    ----------
    parameters : (k, 5) array
        The proposals, in their own units.
    proposed, missing : list of (k, n, 2) arrays
        Their observations of each run, and the target's minus these [board edges]; rows that the tracker lost
        are interpolated.
    residual : (k, m) array
        The differences in the tracked rows.
    """

    parameters: Array
    proposed: list[Array]
    missing: list[Array]
    residual: Array

    @property
    def mae(self) -> Array:
        """Mean absolute state errors (k,) [board edges]."""
        errors: Array = np.abs(self.residual).mean(axis=1)
        return errors

    def __len__(self) -> int:
        return len(self.parameters)

    def __getitem__(self, chosen: slice | NDArray[np.int64]) -> Seen:
        return Seen(
            self.parameters[chosen],
            [each[chosen] for each in self.proposed],
            [each[chosen] for each in self.missing],
            self.residual[chosen],
        )


Search = Generator[Array, Seen, None]


@dataclass(frozen=True, eq=False)
class Path:
    """The proposals of a search in the order in which they were simulated.

    Attributes
    ----------
    parameters : (r, 5) array
        In their own units.
    mae : (r,) array
        Mean absolute state error of each [board edges].
    """

    parameters: Array
    mae: Array

    @property
    def best(self) -> Path:
        """The best proposal after each rollout."""
        leaders = np.maximum.accumulate(
            np.where(self.mae <= np.minimum.accumulate(self.mae), np.arange(len(self.mae)), 0)
        )
        return Path(self.parameters[leaders], self.mae[leaders])

    def padded(self, rollouts: int) -> Path:
        """Return the path padded with its last row to this number of rollouts, or cut there."""
        rows = np.minimum(np.arange(rollouts), len(self.mae) - 1)
        return Path(self.parameters[rows], self.mae[rows])


def compare(drive: Drive, parameters: Array, observed: Sequence[Array], threads: int | None = None) -> Seen:
    """Simulate (k, 5) parameters and compare them with observations of each run, (n, 2) or (k, n, 2)."""
    return seen(drive, parameters, drive.simulate(parameters, threads), observed)


def seen(drive: Drive, parameters: Array, proposed: Sequence[Array], observed: Sequence[Array]) -> Seen:
    """Compare simulated (k, n, 2) observations of each run with those of the target."""
    missing = lacking(proposed, observed)
    return Seen(parameters, list(proposed), missing, left_over(drive, missing, observed))


def run(
    drive: Drive,
    targets: Sequence[Sequence[Array]],
    searches: Sequence[Search],
    rollouts: int,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    text: str = "tuning",
) -> list[Path]:
    """Run one search for each target until it ends or its budget is used up.

    Parameters
    ----------
    drive : Drive
        The simulated drive.
    targets : sequence of sequences of (n, 2) arrays
        Observations of each run of the drive, for each search.
    searches : sequence of generators
        Unstarted generators.
    rollouts : int
        Budget of each search; a batch that exceeds it is cut and is the last one.
    threads, progress
        Threads of the engine, and a callback, which is called with `text`.
    """
    found: list[tuple[list[Array], list[Array]]] = [([], []) for _ in searches]
    asked = {i: batch for i, search in enumerate(searches) if (batch := next(search, None)) is not None}
    while asked:
        proposed = drive.simulate(np.concatenate(list(asked.values())), threads)
        first, onward = 0, {}
        for i, batch in asked.items():
            own = [each[first : first + len(batch)] for each in proposed]
            first += len(batch)
            result = seen(drive, batch, own, targets[i])
            left = rollouts - sum(map(len, found[i][1]))
            found[i][0].append(batch[:left])
            found[i][1].append(result.mae[:left])
            if len(batch) < left:
                with suppress(StopIteration):
                    onward[i] = searches[i].send(result)
        asked = onward
        if progress:
            done = [sum(map(len, errors)) if i in asked else rollouts for i, (_, errors) in enumerate(found)]
            best = min(float(min(map(np.min, errors))) for _, errors in found)
            progress(sum(done), rollouts * len(searches), f"{text}, error {100 * best:.2f} % of the edge")
    for search in searches:
        search.close()
    return [Path(np.concatenate(batches), np.concatenate(errors)) for batches, errors in found]


def lacking(proposed: Sequence[Array], observed: Sequence[Array]) -> list[Array]:
    """Return the observations of each run minus those of (k, n, 2) proposals.

    The difference is interpolated in lost rows, because it is smooth even where the marble turned.
    """
    return [_interpolated(o - p) for p, o in zip(proposed, observed, strict=True)]


def left_over(drive: Drive, missing: Sequence[Array], observed: Sequence[Array]) -> Array:
    """Return the differences of k proposals in the tracked rows [board edges], (k, 2 tracked rows)."""
    rows = [np.isfinite(each).reshape(-1, *each.shape[-2:])[0] for each in observed]
    return np.concatenate(
        [values[:, s] for values, s in zip(drive.residual(missing), rows, strict=True)], axis=1
    )


def _interpolated(difference: Array) -> Array:
    """Return (k, n, 2) differences with their NaN rows, the same for every k, interpolated."""
    known = np.isfinite(difference[0, :, 0])
    if known.all():
        return difference
    rows = np.arange(len(known))
    columns = np.moveaxis(difference, 1, -1).reshape(-1, len(rows))
    filled = np.array([np.interp(rows, rows[known], column[known]) for column in columns])
    return np.moveaxis(filled.reshape(len(difference), 2, len(rows)), -1, 1)
