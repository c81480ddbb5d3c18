"""A rim with restitution.

Bullet slows a marble down over the steps in which it approaches a wall, so that at a labyrinth's speeds of
centimetres per second hardly any speed remains for its own restitution: with 0.9 the measured restitution was
0 to 0.2, depending on the timing of the steps. Therefore Bullet computes an inelastic contact, and this
module applies the impulse of the rebound.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from .physics import EDGE_X_M, EDGE_Y_M, RADIUS_M, Array

LATERAL_FRICTION = 0.5  # two bodies multiply to 0.25

#: Distance from the rim [m] above which the marble is free, and speed [m/s] below which it leans on the rim.
FREE_M, LEANS_M_PER_S = 2.5e-4, 1e-3


class Moving(Protocol):
    """A marble in an engine, in the board's frame."""

    def velocity(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return velocity [m/s] and spin [rad/s]."""

    def set_velocity(self, moves: Sequence[float], turns: Sequence[float]) -> None:
        """Set velocity [m/s] and spin [rad/s]."""


class Rim:
    """The rim's restitution, with the friction of its impulse."""

    def __init__(self, body: Moving, restitution: float) -> None:
        self.body, self.restitution = body, restitution
        self.acts = restitution > 0.0
        self.approach = [0.0, 0.0]

    def apply(self, place: Sequence[float]) -> None:
        """Rebound a marble at `place` [m] that the last step has stopped at the rim."""
        moves, turns = self.body.velocity()
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
                self.body.set_velocity(moves, turns)


def _kicked(
    moves: Array, turns: Array, axis: int, side: float, speed: float
) -> tuple[list[float], list[float]]:
    """Return velocity [m/s] and spin [rad/s] after the impulse of a rebound at that speed."""
    arm = np.zeros(3)
    arm[axis] = side * RADIUS_M
    slip = moves + np.cross(turns, arm)
    slip[axis] = 0.0
    size = float(np.hypot(*np.delete(slip, axis)))
    moves[axis] = -side * speed
    if size > 0.0:
        # The smaller of Coulomb's limit and two sevenths of the slip, which stops a sphere's slip.
        rubbed = -slip / size * min(LATERAL_FRICTION**2 * speed, 2.0 / 7.0 * size)
        moves = moves + rubbed
        turns = turns + np.cross(arm, rubbed) / (0.4 * RADIUS_M**2)
    return moves.tolist(), turns.tolist()
