"""What errors of the board's corners, as a tracker finds them, leave unknown of the picture's scale."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from scipy.special import ndtri

from irt.engine import HasBoardAndMarble
from irt.fitting.information import CONFIDENCE
from irt.model import Parameter

#: Parameters that are larger or smaller if the picture is.
SCALED = ("gear_x", "gear_y", "rolling_friction", "observation_scale")
#: Half-width of a 95 % interval in standard deviations.
_NORMAL = float(ndtri(0.5 + CONFIDENCE / 2.0))


def scale_error(rig: HasBoardAndMarble, noise: float) -> float:
    """Return the standard deviation of the picture's scale by errors of its corners, as a share of it.

    A tracker finds the board's corners about as well as it finds the marble, and no recording shows their
    errors. The scale that fits four corners best is that of their distances from the centre: of independent
    errors with the tracker's standard deviation `noise` [board edges along x] it has that over the root of
    the sum of their squares.
    """
    return noise / math.hypot(1.0, rig.board.edge_y_m / rig.board.edge_x_m)


def with_scale_error(
    parameters: Mapping[str, Parameter],
    rig: HasBoardAndMarble,
    noise: float,
    names: Collection[str] = SCALED,
) -> dict[str, Parameter]:
    """Return parameters with 95 % intervals that contain the error of the picture's scale.

    Parameters
    ----------
    parameters : mapping
        Parameters by name.
    rig : Rig
        The board.
    noise : float
        The tracker's standard deviation [board edges along x].
    names : collection of str
        Those of the parameters that depend on the picture's scale.
    """
    share = _NORMAL * scale_error(rig, noise)
    return {name: _widened(one, share) if name in names else one for name, one in parameters.items()}


def _widened(one: Parameter, share: float) -> Parameter:
    """Return a parameter with an independent error of this share besides; its sign stays known."""
    if one.low is None or one.high is None:
        return one
    low = one.value - math.hypot(one.value - one.low, share * one.value)
    high = one.value + math.hypot(one.high - one.value, share * one.value)
    return Parameter(
        one.value, max(0.0, low) if one.low >= 0.0 else low, min(0.0, high) if one.high <= 0.0 else high
    )
