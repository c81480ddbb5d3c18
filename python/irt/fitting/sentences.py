"""Sentences on parameter combinations that are not identifiable from recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from irt.rig import PARAMETERS

if TYPE_CHECKING:
    from irt.fitting.information import Information

Array = NDArray[np.float64]

TIME, SCALE = PARAMETERS.index("time_scale"), PARAMETERS.index("observation_scale")

#: Relative changes, in the order of `PARAMETERS`, under which a recording is invariant.
SYMMETRIES = {
    "time": np.array([1.0, 1.0, 1.0, -0.5, 0.0]),
    "scale": np.array([-1.0, -1.0, -1.0, 0.0, 1.0]),
}
#: Smallest reference value of relative changes, as a share of the largest value of a range.
SMALL = 0.02
#: A direction lies within a subspace above this share of its square, outside below this share of its length.
WITHIN, OUTSIDE = 0.98, 0.1
#: Smallest component of a direction whose parameter is named.
SHARE = 0.15


def unidentifiable(information: Information, low: Array, high: Array) -> tuple[str, ...]:
    """Return a sentence for each unidentifiable combination.

    Parameters
    ----------
    information : Information
        Information of the recordings about the parameters.
    low, high : (n,) arrays
        Ends of the intervals.
    """
    if information.flat.sum() == information.free.sum():
        return ("These recordings contain next to no information on any parameter; did the marble move?",)
    # From here on in relative changes, in which the symmetries are the same for every rig.
    size = np.maximum(np.abs(information.values), SMALL * np.abs(information.ranges).max(axis=1))
    flat = information.directions[information.flat] * information.widths / size
    flat = np.linalg.qr(flat.T)[0].T
    relative = information.values / size
    of_effects = np.zeros(len(relative) - len(PARAMETERS))
    symmetries = {name: np.concatenate([five, of_effects]) for name, five in SYMMETRIES.items()}
    found = {
        name: bool(np.all(information.free[symmetry != 0.0])) and _lies_within(symmetry * relative, flat)
        for name, symmetry in symmetries.items()
    }
    symmetric = [symmetries[name] * relative for name, is_flat in found.items() if is_flat]
    sentences = [_symmetries(information, flat, **found)] if symmetric else []
    for direction in _remainder(flat, symmetric):
        change = direction * size / information.widths
        sentences.append(_direction(information, change / np.linalg.norm(change), low, high))
    return tuple(sentences)


def _symmetries(information: Information, flat: Array, *, time: bool, scale: bool) -> str:
    """Return a sentence on the unbroken symmetries of the motion, and on the combinations that are known."""
    changes = "time_scale is divided by its square root" * time, "observation_scale is divided by it" * scale
    remedies = (
        "stamps (a column t_s) would fix the time scale" * time,
        "a run that meets a wall would fix the observation scale" * scale,
    )
    exponents = np.zeros(len(information.values))
    exponents[[TIME, SCALE]] = 2.0 * time, 1.0 * scale
    factors = "time_scale^2 * " * time + "observation_scale * " * scale
    known = []
    for index, name in enumerate(PARAMETERS[:3]):
        powers = exponents + np.eye(len(exponents))[index]
        value = information.values[index]
        if value != 0.0 and np.linalg.norm(flat @ powers) < OUTSIDE * np.linalg.norm(powers):
            product = float(np.prod(information.values**powers))
            gradient = np.zeros(len(exponents))
            np.divide(powers * information.widths, information.values, where=powers != 0.0, out=gradient)
            margin = abs(product) * information.margin(gradient)
            known.append(f"{factors}{name} = {product:.4g} +- {margin:.2g}")
    fixed = f"these recordings fix only {_listed(known)}" if known else "these recordings fix none of them"
    return (
        "gear_x, gear_y and rolling_friction can all be multiplied by any factor if "
        f"{' or '.join(filter(None, changes))}: {fixed}; {' and '.join(filter(None, remedies))}."
    )


def _direction(information: Information, direction: Array, low: Array, high: Array) -> str:
    """Return a sentence on a flat direction."""
    taking_part = np.flatnonzero(np.abs(direction) >= SHARE)
    if len(taking_part) == 1:
        index = taking_part[0]
        return (
            f"These recordings do not identify {information.names[index]}: any value from "
            f"{low[index]:.3g} to {high[index]:.3g} fits equally well."
        )
    changes = [
        f"{information.names[i]} by {0.1 * direction[i] * information.widths[i]:+.2g}" for i in taking_part
    ]
    names = _listed([information.names[i] for i in taking_part])
    return (
        f"These recordings do not separate {names}: changing "
        f"{_listed(changes)} together makes no difference above the tracker's noise."
    )


def _lies_within(direction: Array, flat: Array) -> bool:
    return bool(((flat @ direction) ** 2).sum() >= WITHIN * (direction**2).sum() > 0.0)


def _remainder(flat: Array, symmetric: list[Array]) -> Array:
    """Return the flat directions orthogonal to the symmetries."""
    if not symmetric:
        return flat
    axes = np.linalg.qr(np.array(symmetric).T)[0].T
    _, length, left = np.linalg.svd(flat - flat @ axes.T @ axes)
    return left[: len(length)][length > 0.5]


def _listed(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
