"""Dimensions of a rig's board and marble, and properties of its commands and tilt sensor."""

from __future__ import annotations

from dataclasses import dataclass

from irt import arguments
from irt.errors import IrtError

#: Default range of the zero of a measured tilt [rad]; real rigs had offsets of 20 to 50 mrad.
TILT_OFFSET_RAD = (-0.06, 0.06)

#: Smallest length [m] or mass [kg]; divisions by smaller values overflow.
_TINY = 1e-9


@dataclass(frozen=True)
class Board:
    """The board and its rim walls; the defaults are the paper's BRIO labyrinth.

    Attributes
    ----------
    edge_x_m, edge_y_m : float
        Edges [m]; positions are in units of `edge_x_m`, the long one.
    wall_restitution : float
        Coefficient of restitution of the rim: normal speed after an impact over that before it, 0 to 1.
    wall_friction : float
        Coulomb coefficient between marble and rim.
    sliding_friction : float
        Coulomb coefficient between marble and board; it matters only while the marble slips, some
        milliseconds after contact with the rim.
    spinning_friction : float
        Torque of the board against a spin about the vertical, over the marble's weight and radius.

    Raises
    ------
    IrtError
        If a value is impossible.
    """

    edge_x_m: float = 0.276
    edge_y_m: float = 0.231
    wall_restitution: float = 0.0
    wall_friction: float = 0.25
    sliding_friction: float = 0.25
    spinning_friction: float = 0.0

    def __post_init__(self) -> None:
        # An upper bound of 10 m detects boards given in millimetres.
        check_number("edge_x_m", self.edge_x_m, _TINY, 10.0, " m")
        check_number("edge_y_m", self.edge_y_m, _TINY, 10.0, " m")
        check_number("wall_restitution", self.wall_restitution, 0.0, 1.0)
        check_number("wall_friction", self.wall_friction, 0.0, 1000.0)
        check_number("sliding_friction", self.sliding_friction, 0.0, 1000.0)
        check_number("spinning_friction", self.spinning_friction, 0.0, 1000.0)


@dataclass(frozen=True)
class Marble:
    """The marble; the defaults are the paper's, 13.7 mm in diameter.

    Attributes
    ----------
    radius_m : float
        Radius [m].
    mass_kg : float
        Mass [kg].
    damping_per_s : float
        Rate at which speed and spin decay [1/s].

    Raises
    ------
    IrtError
        If a value is impossible.
    """

    radius_m: float = 0.00685
    mass_kg: float = 0.0105
    damping_per_s: float = 0.0

    def __post_init__(self) -> None:
        # An upper bound of 1 m detects radii given in millimetres.
        check_number("radius_m", self.radius_m, _TINY, 1.0, " m")
        check_number("mass_kg", self.mass_kg, _TINY, 1000.0, " kg")
        check_number("damping_per_s", self.damping_per_s, 0.0, 1000.0, " per second")


@dataclass(frozen=True)
class Commands:
    """Properties of a rig's commands.

    Attributes
    ----------
    unit : str
        "rad" for knob angles, or another unit such as "mA"; gears are in rad per unit.
    matrix : bool
        Whether each command may tilt the board about both axes.
    """

    unit: str = "rad"
    matrix: bool = False

    def __post_init__(self) -> None:
        arguments.text("unit", self.unit)
        arguments.flag("matrix", self.matrix)


@dataclass(frozen=True)
class TiltSensor:
    """Properties of the measured tilt.

    Attributes
    ----------
    noise_rad : float or None
        Standard deviation of a measured tilt [rad]; None to estimate it from the recordings.
    offset : (float, float)
        Range of the reading when the board is level [rad].

    Raises
    ------
    IrtError
        If the noise is not positive, or the range is reversed.
    """

    noise_rad: float | None = None
    offset: tuple[float, float] = TILT_OFFSET_RAD

    def __post_init__(self) -> None:
        if self.noise_rad is not None:
            check_number("noise_rad", self.noise_rad, _TINY, 1.0, " rad")
        low, high = arguments.pair("offset", self.offset)
        arguments.upwards("offset", low, high)
        for end in self.offset:
            check_number("offset", end, -1.0, 1.0, " rad")


def check_room(board: Board, marble: Marble) -> None:
    """Raise `IrtError` unless the marble can move between the walls of the board."""
    if 2.0 * marble.radius_m >= min(board.edge_x_m, board.edge_y_m):
        raise IrtError(
            f"radius_m: a marble of {marble.radius_m:g} m does not fit between the walls of a board of "
            f"{board.edge_x_m:g} m x {board.edge_y_m:g} m"
        )


def check_number(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise `IrtError` if a value is not a number within bounds."""
    if not low <= arguments.number(name, value) <= high:
        raise IrtError(f"{name}: expected a number from {low:g} to {high:g}{unit}, found {value:g}")
