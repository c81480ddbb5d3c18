"""Lower bound of every method's parameter error: other parameters with the same path."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.paper import errors
from irt.paper.setting import Setting
from irt.rig import PARAMETERS
from irt.tuning.drive import Drive

Array = NDArray[np.float64]

#: Number of draws along the symmetries of a target, and of equivalent parameters that are kept.
_DRAWS = 20_000
_TIME, _SCALE = PARAMETERS.index("time_scale"), PARAMETERS.index("observation_scale")
#: Number of targets that are moved along the symmetry.
_TARGETS = 200
#: Edges of a board large enough that no marble meets the rim [m].
_WIDE_M = 10.0


@dataclass(frozen=True, eq=False)
class Symmetry:
    """Change of observations along the first symmetry: time_scale times f, gears and friction over f^2.

    Attributes
    ----------
    factors : (k,) array
        f.
    change : dict of (k, 3) arrays
        Mean absolute change of the observation [board edges] by setting: quartiles over targets.
    parameter_error : (k,) array
        The mean parameter error, in shares of the ranges.
    """

    factors: Array
    change: dict[str, Array]
    parameter_error: Array


@dataclass(frozen=True)
class Floor:
    """Mean errors, in shares of the ranges, of the best estimate from the targets' paths.

    The estimate is the median of each parameter over equivalent ones: parameters in the ranges, distributed
    like targets, with the same products, and with the same scale if the rim identifies it.
    """

    parameters: float
    combinations: float


def symmetry(setting: Setting, factors: Array | None = None) -> Symmetry:
    """Move targets along the symmetry, with and without rim and damping."""
    factors = np.linspace(0.6, 1.0, 9) if factors is None else factors
    random = np.random.default_rng([setting.seed, 31])
    truth = setting.drive.parameters(random.random((_TARGETS, len(PARAMETERS))))
    truth[:, _TIME] = random.integers(20, 41, _TARGETS)
    # Moved targets stay within the ranges.
    truth[:, :3] *= factors.min() ** 2
    drive = setting.drive
    wide = replace(drive.board, edge_x_m=_WIDE_M, edge_y_m=_WIDE_M)
    worlds = {
        "no rim, no damping": replace(drive, board=wide),
        "rim, no damping": replace(drive, marble=replace(drive.marble, damping_per_s=0.0)),
        "rim, damping 0.04/s": replace(drive, marble=replace(drive.marble, damping_per_s=0.04)),
        "rim, damping 0.4/s": replace(drive, marble=replace(drive.marble, damping_per_s=0.4)),
    }
    change: dict[str, list[Array]] = {name: [] for name in worlds}
    raw: list[float] = []
    for factor in factors:
        moved = truth.copy()
        moved[:, _TIME] *= factor
        moved[:, :3] /= factor**2
        for name, world in worlds.items():
            # Rounding to whole updates would hide a small change.
            before, after = (
                world.simulate(each, setting.threads, time_step="continuous")[0] for each in (truth, moved)
            )
            unit = world.board.edge_x_m / drive.board.edge_x_m
            change[name].append(np.percentile(unit * np.abs(after - before).mean(axis=(1, 2)), [25, 50, 75]))
        raw.append(float(errors.parameter_error(drive, moved, truth).mean()))
    return Symmetry(factors, {name: np.array(each) for name, each in change.items()}, np.array(raw))


def floor(drive: Drive, truth: Array, seed: int) -> Floor:
    """Return the lower bound of the mean errors of any method on (n, 5) targets."""
    random = np.random.default_rng([seed, 32])
    raw, combined = [], []
    way = errors.share_of_the_way(drive, drive.simulate(truth)[0])
    for target, furthest in zip(truth, way, strict=True):
        alike, weight = _alike(drive, target, furthest, random)
        guess = _weighted_median(alike, weight)
        raw.append(errors.parameter_error(drive, guess, target))
        of_alike = errors.combinations(alike)
        best = _weighted_median(of_alike, weight)
        low, high = (
            errors.combinations(np.array([drive.ranges[name][k] for name in PARAMETERS])) for k in (0, 1)
        )
        combined.append((np.abs(best - errors.combinations(target)) / (high - low)).mean())
    return Floor(float(np.mean(raw)), float(np.mean(combined)))


def _alike(drive: Drive, target: Array, furthest: float, random: np.random.Generator) -> tuple[Array, Array]:
    """Return parameters (k, 5) with the path of a target, and weights by their density among targets.

    `furthest` is the largest observed distance of the target as a share of that to the rim.
    """
    rim = furthest > errors.AT_RIM * target[_SCALE]
    low, high = np.array([drive.ranges[name] for name in PARAMETERS]).T
    steps = np.maximum(np.rint(target[_TIME]), 1.0)
    others = np.maximum(np.rint(random.uniform(low[_TIME], high[_TIME], _DRAWS)), 1.0)
    scale = np.full(_DRAWS, target[_SCALE]) if rim else random.uniform(low[_SCALE], high[_SCALE], _DRAWS)
    factor = target[_SCALE] * steps**2 / (scale * others**2)
    alike = np.column_stack([factor[:, None] * target[:3], others, scale])
    inside = ((alike >= low) & (alike <= high)).all(axis=1)
    if not rim:
        inside &= scale * errors.AT_RIM >= furthest
    if not inside.any():
        return target[None], np.ones(1)
    # The density of three products at one place grows as three factors shrink.
    return alike[inside], factor[inside] ** 3


def _weighted_median(values: Array, weight: Array) -> Array:
    """Return the weighted medians (c,) of the columns of (k, c) values."""
    order = np.argsort(values, axis=0)
    shares = np.cumsum(weight[order], axis=0) / weight.sum()
    rows = (shares < 0.5).sum(axis=0)
    return np.array([values[order[row, column], column] for column, row in enumerate(rows)])
