"""Errors of a tracker's calibration, which look like small effects of the camera.

A tracker lays the board's four corners into the picture, and finds each about as well as it finds the marble.
Errors of the corners are a plane projective map (Hartley and Zisserman, "Multiple View Geometry", 2nd ed.,
sect. 4.1): a shift, a rotation and a tilt of the picture. They are in the recordings, and long recordings
show a tenth of the tracker's noise, but they are no missing physics. What they do to the picture's scale no
recording shows (`irt.fitting.picture_error`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, expit

from irt.diagnosis import config
from irt.engine import HasBoardAndMarble, seen

Array = NDArray[np.float64]

#: The corners, then the middles of the sides and of the board, in widths and heights from the centre.
_PLACES = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0), (0, 0)]) / 2.0
_CORNERS = 4


def is_within_error(name: str, values: Mapping[str, float], rig: HasBoardAndMarble, noise: float) -> bool:
    """Whether corners in error by the tracker's noise could do to the picture what an effect does.

    The effect must be a projective map, and its displacements of the corners must be within what is expected
    of errors with the tracker's standard deviation: the sum of squares has a chi-squared distribution.

    Parameters
    ----------
    name : str
        The effect.
    values : mapping
        Its parameters.
    rig : Rig
        The board.
    noise : float
        Standard deviation of the tracker [board edges along x].
    """
    places = _places(rig)
    moved = seen(places, rig, [{"name": name, **values}])
    shifts = (moved - places)[:_CORNERS]
    size = float(np.sum(shifts**2))
    most = float(chdtri(shifts.size, expit(-config.SURE)))
    if not 0.0 < size <= most * noise**2:
        return False
    by_corners = _projected(places, _projective(places[:_CORNERS], moved[:_CORNERS]))
    difference = float(np.sqrt(np.mean(np.sum((by_corners - moved) ** 2, axis=1))))
    return difference < config.SAME * float(np.sqrt(size / _CORNERS))


def _places(rig: HasBoardAndMarble) -> Array:
    """Return the places (9, 2) on a board, the corners first [board edges along x]."""
    return _PLACES * (1.0, rig.board.edge_y_m / rig.board.edge_x_m)


def _projective(places: Array, moved: Array) -> Array:
    """Return the matrix (3, 3) of the projective map that moves four places (4, 2) as given."""
    (x, y), (u, v), one, zero = places.T, moved.T, np.ones(_CORNERS), np.zeros(_CORNERS)
    rows = np.concatenate(
        [
            np.column_stack([x, y, one, zero, zero, zero, -u * x, -u * y]),
            np.column_stack([zero, zero, zero, x, y, one, -v * x, -v * y]),
        ]
    )
    return np.append(np.linalg.solve(rows, np.concatenate([u, v])), 1.0).reshape(3, 3)


def _projected(places: Array, matrix: Array) -> Array:
    """Return places (n, 2) moved by a projective map."""
    found = np.column_stack([places, np.ones(len(places))]) @ matrix.T
    return np.asarray(found[:, :2] / found[:, 2:])
