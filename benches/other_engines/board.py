"""What the engines share: the board's boxes, and rolling friction, which none of them has."""

from __future__ import annotations

import numpy as np

from irt.proof.pybullet_world.engine import STEP_S
from irt.proof.pybullet_world.physics import EDGE_X_M, EDGE_Y_M, MASS_KG, RADIUS_M, Array

#: Coulomb friction of board and rim, and friction against spins about the normal [radii].
SLIDING, SPINNING = 0.25, 1e-4
#: Half the thickness of the board and of the walls of its rim [m].
THICK_M = 0.02
#: Moments of inertia about the contact and about the normal [kg m^2].
_ABOUT_CONTACT, _ABOUT_NORMAL = 1.4 * MASS_KG * RADIUS_M**2, 0.4 * MASS_KG * RADIUS_M**2


def boxes() -> list[tuple[Array, Array]]:
    """Return centres and half lengths (3,) [m] of the board, its surface at height 0, and of four walls."""
    x, y, thick = EDGE_X_M / 2.0, EDGE_Y_M / 2.0, THICK_M
    board = np.array([0.0, 0.0, -thick]), np.array([x + 2.0 * thick, y + 2.0 * thick, thick])
    walls = [
        (
            np.array([side_x * (x + thick), side_y * (y + thick), thick]),
            np.array([thick if side_x else x + 2.0 * thick, thick if side_y else y + 2.0 * thick, thick]),
        )
        for side_x, side_y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    return [board, *walls]


def resistance(spin: Array, force: Array, torque: Array, friction: float) -> Array:
    """Return the torque (3,) [N m] of rolling and spinning friction in a step: at most what stops the marble.

    Parameters
    ----------
    spin : (3,) array
        Of the marble [rad/s].
    force, torque : (3,) arrays
        What acts on it otherwise [N], [N m].
    friction : float
        Rolling friction, dimensionless.
    """
    driven = torque[:2] + RADIUS_M * np.array([-force[1], force[0]])
    stops = -(_ABOUT_CONTACT * spin[:2] / STEP_S + driven)
    weight = max(-force[2], 0.0) * RADIUS_M
    rolling = stops * min(1.0, friction * weight / max(float(np.hypot(*stops)), 1e-300))
    spinning = np.clip(-_ABOUT_NORMAL * spin[2] / STEP_S, -SPINNING * weight, SPINNING * weight)
    return np.array([*rolling, spinning])
