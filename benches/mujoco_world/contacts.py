"""Forces on a marble by position and velocity, and factors of its rolling resistance."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from irt.rig import Board, Marble

Array = NDArray[np.float64]
Values = Mapping[str, float]
Hidden = Mapping[str, Values]
#: A force per mass (n, 2) [m/s²] from positions (n, 2) [m] and velocities along the board (n, 2) [m/s].
Force = Callable[[Array, Array], Array]
#: A factor (n,) by these and by the push along the board (n,) [rolling resistances].
Factor = Callable[[Array, Array, Array], Array]

GRAVITY = 9.81
#: Ratio of a force per mass at the centre of a rolling sphere to its acceleration.
ROLLING = 7.0 / 5.0
#: Depth of an attracting point below the board [m].
DEPTH_M = 0.03
#: Half width of a patch's edge [m].
HALF_RIM_M = 1e-3
#: Speed below which a marble is at rest [m/s]; contacts creep.
REST_M_PER_S = 3e-4
#: Half waves along x and along y of a map of slopes, by the names of its parameters.
MODES = {f"slope_{i}{j}": (i, j) for i in range(5) for j in range(5) if 0 < i + j < 5}


def _bowl(values: Values) -> Force:
    xx, xy, yy = (values[f"curvature_{axes}_per_m"] for axes in ("xx", "xy", "yy"))
    return lambda place, _: -GRAVITY * place @ np.array([[xx, xy], [xy, yy]])


def _bump(values: Values) -> Force:
    middle, width = np.array([values["x_m"], values["y_m"]]), values["width_m"]

    def law(place: Array, _: Array) -> Array:
        away = place - middle
        height = values["height_m"] * np.exp(-0.5 * (away**2).sum(axis=1) / width**2)
        return np.asarray(GRAVITY * (height / width**2)[:, None] * away)

    return law


def _uneven(values: Values) -> Force:
    waves = np.pi / np.array([Board().edge_x_m, Board().edge_y_m])
    modes = np.array([MODES[name] for name in values])
    by_axis = modes * waves
    # The slope of a mode is what it is on average over the board, of both axes.
    mean = np.where(modes[:, ::-1] == 0, 1.0, 0.5)
    height = np.array(list(values.values())) / np.sqrt(0.5 * (by_axis**2 * mean).sum(axis=1))

    def law(place: Array, _: Array) -> Array:
        phase = place[:, None, :] * by_axis + 0.5 * np.pi * modes
        sin, cos = by_axis * np.sin(phase), np.cos(phase)
        return np.asarray(
            GRAVITY
            * np.stack([(sin[..., 0] * cos[..., 1]) @ height, (cos[..., 0] * sin[..., 1]) @ height], axis=1)
        )

    return law


def _attracted(values: Values) -> Force:
    point, strength = np.array([values["x_m"], values["y_m"]]), values["strength_m3_per_s2"]

    def law(place: Array, _: Array) -> Array:
        way = point - place
        return np.asarray(strength * way / ((way**2).sum(axis=1, keepdims=True) + DEPTH_M**2) ** 1.5)

    return law


def _aside(values: Values) -> Force:
    turn = ROLLING * values["rate_per_s"] * np.array([[0.0, 1.0], [-1.0, 0.0]])
    return lambda _, velocity: velocity @ turn


def _dragged(values: Values) -> Force:
    drag = ROLLING * values["coefficient_per_m"]
    return lambda _, velocity: -drag * np.linalg.norm(velocity, axis=1, keepdims=True) * velocity


def heavy_side(values: Values) -> Array:
    """Return the constant centre of mass of a marble (3,) [radii]."""
    if values.get("follows_path", 1.0) > 0.0:
        raise ValueError("eccentric_marble: a heavy side that follows the path is not simulated here")
    phase, lean = values["phase_rad"], values["lean_rad"]
    upright = np.array([np.sin(phase) * np.cos(lean), np.sin(lean), np.cos(phase) * np.cos(lean)])
    return np.asarray(values["offset"] * upright)


#: Forces on the marble, over its mass [m/s²].
FORCES: dict[str, Callable[[Values], Force]] = {
    "board_warp": _bowl,
    "slope_map": _uneven,
    "bump": _bump,
    "point_field": _attracted,
    "side_force": _aside,
    "quadratic_drag": _dragged,
}


def _slow(values: Values) -> Factor:
    def law(_: Array, velocity: Array, __: Array) -> Array:
        speed = np.linalg.norm(velocity, axis=1)
        return np.asarray(1.0 + values["strength"] * np.exp(-speed / values["speed_m_per_s"]))

    return law


def _between(factor: float, inside: Array) -> Array:
    """Return a factor for positive distances inside a border [m], with a soft edge."""
    return 1.0 + (factor - 1.0) * np.clip(0.5 + 0.5 * inside / HALF_RIM_M, 0.0, 1.0)


def _patch(values: Values) -> Factor:
    middle, radius = np.array([values["x_m"], values["y_m"]]), values["radius_m"]
    return lambda place, _, __: _between(values["factor"], radius - np.linalg.norm(place - middle, axis=1))


def _strip(values: Values) -> Factor:
    across = np.array([-np.sin(values["angle_rad"]), np.cos(values["angle_rad"])])

    def law(place: Array, _: Array, __: Array) -> Array:
        beside = np.abs(place @ across - values["offset_m"])
        return _between(values["factor"], 0.5 * values["width_m"] - beside)

    return law


def _frame(values: Values) -> Factor:
    reach = 0.5 * np.array([Board().edge_x_m, Board().edge_y_m]) - Marble().radius_m
    return lambda place, _, __: _between(
        values["factor"], values["width_m"] - (reach - np.abs(place)).min(axis=1)
    )


def _sticking(values: Values) -> Factor:
    ratio, time = values["ratio"], values.get("rest_time_s", 0.0)
    if time > 0.0:
        raise ValueError("static_friction: rest_time_s is not simulated here")

    def law(_: Array, velocity: Array, push: Array) -> Array:
        # Contacts creep: a speed by itself would hold back a marble that has broken away.
        rests = np.linalg.norm(velocity, axis=1) < REST_M_PER_S
        return np.where(rests & (push < ratio), ratio, 1.0)

    return law


def _grained(values: Values) -> Factor:
    grain = values["grain_rad"]
    axes = np.array([[np.cos(grain), -np.sin(grain)], [np.sin(grain), np.cos(grain)]])

    def law(_: Array, velocity: Array, __: Array) -> Array:
        along, across = (velocity @ axes).T
        speed = np.maximum(np.hypot(along, across), 1e-12)
        return np.asarray(np.hypot(along, values["ratio"] * across) / speed)

    return law


#: Factors of the rolling resistance.
FACTORS: dict[str, Callable[[Values], Factor]] = {
    "stribeck": _slow,
    "friction_patch": _patch,
    "friction_strip": _strip,
    "frame_friction": _frame,
    "static_friction": _sticking,
    "anisotropic_friction": _grained,
}

#: Effects that are properties of the marble, and of the rims.
OF_MARBLE = ("viscous_drag", "eccentric_marble")
OF_RIMS = ("wall_restitution",)
