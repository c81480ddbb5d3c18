"""Rolling friction for engines that have none: a torque against the roll, up to what stops the marble."""

from __future__ import annotations

import numpy as np

from irt.proof.pybullet_world.engine import STEP_S
from irt.proof.pybullet_world.physics import MASS_KG, RADIUS_M, Array

#: Coulomb friction of board and rim, and friction against spins about the normal [radii].
SLIDING, SPINNING = 0.25, 1e-4
#: Moments of inertia about the contact and about the normal [kg m^2].
_ABOUT_CONTACT, _ABOUT_NORMAL = 1.4 * MASS_KG * RADIUS_M**2, 0.4 * MASS_KG * RADIUS_M**2


def resistance(spin: Array, force: Array, torque: Array, friction: float) -> Array:
    """Return the torque (3,) [N m] of rolling and spinning friction in a step.

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
