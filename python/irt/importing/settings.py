"""The rig.toml of an imported log: sizes of the lab, and ranges around the detected values."""

from __future__ import annotations

import numpy as np
import tomli_w
from numpy.typing import NDArray

from irt.engine import SUBSTEP_S
from irt.importing.axes import Axes, is_matrix
from irt.importing.rates import Rates
from irt.rig import Board, Commands, Marble

Array = NDArray[np.float64]

#: Half width of a gear's range around the detected gain, as a factor.
_GEAR_FACTOR = 5.0
#: Factors on the duration of rows: with stamps, and at a nominal rate.
_TIME_FACTOR, _NOMINAL_FACTOR = 1.25, 2.0
#: Largest rolling friction of real boards.
_FRICTION = [0.0, 0.02]


def rig_toml(
    board: Board,
    marble: Marble,
    commands: Commands,
    axes: Axes,
    noise: Array,
    *,
    period: float,
    stamped: bool,
) -> str:
    """Return the text of rig.toml.

    Parameters
    ----------
    board, marble : Board, Marble
        Sizes.
    commands : Commands
        Unit, and whether each command moves both axes.
    axes : Axes
        Gains of the commands [rad per unit]; a gear is searched within a factor of 5.
    noise : (2,) array
        Noise of the measured tilt [rad]; NaN without any.
    period : float
        Duration of a row [s].
    stamped : bool
        Whether this duration was logged.
    """
    gears = [_gear_range(axes, axis) for axis in (0, 1)]
    parameters = {
        f"gear_{name}": {"range": gear} for name, gear in zip("xy", gears, strict=True) if gear is not None
    }
    scale = period / SUBSTEP_S
    # A nominal rate determines the duration of rows only roughly.
    factor = _TIME_FACTOR if stamped else _NOMINAL_FACTOR
    parameters["rolling_friction"] = {"range": _FRICTION}
    parameters["time_scale"] = {"range": [_short(scale / factor), _short(scale * factor)]}
    spoken: dict[str, object] = {"unit": commands.unit}
    if commands.matrix:
        spoken["matrix"] = True
    content: dict[str, object] = {
        "board": {"edge_x_m": board.edge_x_m, "edge_y_m": board.edge_y_m},
        "marble": {"radius_m": marble.radius_m, "mass_kg": marble.mass_kg},
        "recordings": {"start": "moving"},
        "commands": spoken,
    }
    if np.isfinite(noise).any():
        content["tilt"] = {"noise_rad": _short(float(np.nanmax(noise)))}
    lines = [tomli_w.dumps(content), "[parameters]"]
    lines += [f"{name} = {{ range = {table['range']} }}" for name, table in parameters.items()]
    return "\n".join(lines) + "\n"


def twin_toml(rates: Rates, tilt: Axes, commands: Axes, current: float | None) -> str | None:
    """Return the text of twin.toml, the motors of a CyberRunner's twin; None if they are not that lab's.

    Parameters
    ----------
    rates : Rates
        How fast the commands turn the board.
    tilt, commands : Axes
        Assignment of both; in that lab the second command turns the board about x.
    current : float or None
        Units of current in a unit of the commands.
    """
    if current is None or commands.order != (1, 0) or "undecided" in commands.sure or is_matrix(commands):
        return None
    # The twin takes the rate of the board about x for a negative current, and about y for a positive one.
    speeds = commands.gains / current * [-1.0, 1.0]
    dead = rates.dead[list(tilt.order)] * abs(current)
    return (
        "# Motors for `rig twin --as cyberrunner --config` this file, about x and y: rate of the tilt\n"
        "# [rad/s] over the current beyond the one that friction holds.\n"
        "[twin]\n"
        f"current_rad_s = {[_short(one) for one in speeds]}\n"
        f"current_dead = {[_short(one) for one in dead]}\n"
    )


def _gear_range(axes: Axes, axis: int) -> list[float] | None:
    """Return a range that contains the gear for any bias of the gain by friction and lag; None if unknown."""
    gain, error = float(axes.gains[axis]), float(axes.errors[axis])
    if not np.isfinite(gain) or gain == 0.0:
        return None
    if axes.sure[axis] == "undecided":
        most = _GEAR_FACTOR * (abs(gain) + 2.0 * (error if np.isfinite(error) else 0.0))
        return [_short(-most), _short(most)]
    return sorted([_short(gain / _GEAR_FACTOR), _short(gain * _GEAR_FACTOR)])


def _short(value: float) -> float:
    return float(f"{value:.3g}")
