"""The camera: observed positions of marbles."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from irt.rig import Board

Array = NDArray[np.float64]
Values = Mapping[str, float]
Hidden = Mapping[str, Values]

#: Square of the distance beyond which a lens bends no more [edges²], and the nearest that a camera comes.
OUTSIDE, NEAREST = 0.5, 0.05
#: Iterations from a picture to a position; each halves the error at least.
ROUNDS = 60


def see(places: Array, tilt: Array, edges_per_m: float, hidden: Hidden) -> Array:
    """Return observed positions [board edges] of marbles at (..., 2) [m] on a tilted board (..., 2) [rad]."""
    seen = places * edges_per_m
    for name, change in SEEN.items():
        if name in hidden:
            seen = change(hidden[name], seen, tilt)
    return seen


def place_of(seen: Array, tilt: Array, edges_per_m: float, hidden: Hidden) -> Array:
    """Return the positions (..., 2) [m] of marbles with these observed positions [board edges]."""
    places = seen / edges_per_m
    for _ in range(ROUNDS):
        places = places + (seen - see(places, tilt, edges_per_m, hidden)) / edges_per_m
    return places


def _beside(values: Values, seen: Array, tilt: Array) -> Array:
    height = values["height_m_per_rad"] / Board().edge_x_m
    return seen + height * np.stack([tilt[..., 1], -tilt[..., 0]], axis=-1)


def _inclined(values: Values, seen: Array, _: Array) -> Array:
    slopes, square = np.array([values["slope_x"], values["slope_y"]]), values.get("distance_edges", 0.0) ** 2
    along = (seen @ slopes)[..., None]
    shorter = square / (1.0 + np.sqrt(1.0 - square * (slopes @ slopes))) * along * slopes
    return np.asarray((seen - shorter) / np.maximum(1.0 + along, NEAREST))


def _through_lens(values: Values, seen: Array, _: Array) -> Array:
    square = np.minimum((seen**2).sum(axis=-1, keepdims=True), OUTSIDE)
    return np.asarray(seen * (1.0 + values["k_per_edge2"] * square))


def _rotated(values: Values, seen: Array, _: Array) -> Array:
    sin, cos = np.sin(values["angle_rad"]), np.cos(values["angle_rad"])
    return np.asarray(seen @ np.array([[cos, sin], [-sin, cos]]))


def _shifted(values: Values, seen: Array, _: Array) -> Array:
    return np.asarray(seen + np.array([values["x_edges"], values["y_edges"]]))


#: Effects of the camera, in the order of the light path.
SEEN: dict[str, Callable[[Values, Array, Array], Array]] = {
    "parallax": _beside,
    "perspective": _inclined,
    "lens_distortion": _through_lens,
    "camera_rotation": _rotated,
    "camera_offset": _shifted,
}
