"""A rim that gives back speed.

Bullet stops a marble in the steps in which it comes near a wall, each by what is left of the gap, so that at
a labyrinth's speeds of centimetres a second little is left for its own restitution: of 0.9 it returned 0 to
0.2, as the steps fell. So the dead contact is Bullet's, and the impulse that follows it is given here.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import numpy as np

from .physics import EDGE_X_M, EDGE_Y_M, RADIUS_M, Array

LATERAL_FRICTION = 0.5  # two bodies multiply to 0.25

#: Farther from the rim [m] than this the marble is free, and slower [m/s] than this it leans on the rim.
FREE_M, LEANS_M_PER_S = 2.5e-4, 1e-3


class Rim:
    """The rim's restitution, and the friction that goes with its impulse."""

    def __init__(self, p: ModuleType, client: int, body: int, restitution: float) -> None:
        self.p, self.client, self.body = p, client, body
        self.restitution = restitution
        self.acts = restitution > 0.0
        self.approach = [0.0, 0.0]

    def apply(self, place: Sequence[float]) -> None:
        """Send a marble at `place` [m] back that the last step has stopped at the rim."""
        moves, turns = self.p.getBaseVelocity(self.body, physicsClientId=self.client)
        for axis, edge in enumerate((EDGE_X_M, EDGE_Y_M)):
            side = 1.0 if place[axis] > 0.0 else -1.0
            gap = edge / 2.0 - RADIUS_M - abs(place[axis])
            towards = side * moves[axis]
            if gap > FREE_M:
                self.approach[axis] = towards
            elif towards < 0.1 * self.approach[axis] and self.approach[axis] > LEANS_M_PER_S:
                speed = self.restitution * self.approach[axis]
                self.approach[axis] = 0.0
                moves, turns = _kicked(np.array(moves), np.array(turns), axis, side, speed)
                self.p.resetBaseVelocity(self.body, moves, turns, physicsClientId=self.client)


def _kicked(
    moves: Array, turns: Array, axis: int, side: float, speed: float
) -> tuple[list[float], list[float]]:
    """Return velocity [m/s] and spin [rad/s] after an impulse that sends the marble off at that speed."""
    arm = np.zeros(3)
    arm[axis] = side * RADIUS_M
    slip = moves + np.cross(turns, arm)
    slip[axis] = 0.0
    size = float(np.hypot(*np.delete(slip, axis)))
    moves[axis] = -side * speed
    if size > 0.0:
        # Coulomb's limit, or what stops the slip of a sphere: two sevenths of it.
        rubbed = -slip / size * min(LATERAL_FRICTION**2 * speed, 2.0 / 7.0 * size)
        moves = moves + rubbed
        turns = turns + np.cross(arm, rubbed) / (0.4 * RADIUS_M**2)
    return moves.tolist(), turns.tolist()
