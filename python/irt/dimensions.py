"""What is measured of a rig with a ruler and a scale, and known of its signals."""

from __future__ import annotations

from dataclasses import dataclass

from irt import arguments
from irt.errors import IrtError

#: Where the zero of a measured tilt is looked for [rad]: real rigs were 20 to 50 mrad off.
TILT_OFFSET_RAD = (-0.06, 0.06)

#: Least that a length [m] or a mass [kg] can be: below, divisions by it overflow.
_TINY = 1e-9


@dataclass(frozen=True)
class Board:
    """The board and its rim walls; the defaults are the paper's BRIO labyrinth.

    Attributes
    ----------
    edge_x_m, edge_y_m : float
        Edges [m]; positions are in units of `edge_x_m`, the long one.
    wall_restitution : float
        Normal speed after an impact on the rim over the speed before it, 0 to 1.
    wall_friction : float
        Coulomb coefficient between marble and rim.
    sliding_friction : float
        Coulomb coefficient between marble and board; it matters only while the marble slips, for some
        milliseconds after it has met the rim.
    spinning_friction : float
        Torque with which the board resists a spin about the vertical, over the marble's weight and radius.

    Raises
    ------
    IrtError
        If a value is none that a board can have.
    """

    edge_x_m: float = 0.276
    edge_y_m: float = 0.231
    wall_restitution: float = 0.0
    wall_friction: float = 0.25
    sliding_friction: float = 0.25
    spinning_friction: float = 0.0

    def __post_init__(self) -> None:
        # No table is ten metres long, but a board given in millimetres is 276.
        check_number("edge_x_m", self.edge_x_m, _TINY, 10.0, " m")
        check_number("edge_y_m", self.edge_y_m, _TINY, 10.0, " m")
        check_number("wall_restitution", self.wall_restitution, 0.0, 1.0)
        check_number("wall_friction", self.wall_friction, 0.0, 1000.0)
        check_number("sliding_friction", self.sliding_friction, 0.0, 1000.0)
        check_number("spinning_friction", self.spinning_friction, 0.0, 1000.0)


@dataclass(frozen=True)
class Marble:
    """The marble; the defaults are the paper's, 13.7 mm across.

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
        If a value is none that a marble can have.
    """

    radius_m: float = 0.00685
    mass_kg: float = 0.0105
    damping_per_s: float = 0.0

    def __post_init__(self) -> None:
        check_number("radius_m", self.radius_m, _TINY, 10.0, " m")
        check_number("mass_kg", self.mass_kg, _TINY, 1000.0, " kg")
        check_number("damping_per_s", self.damping_per_s, 0.0, 1000.0, " per second")


@dataclass(frozen=True)
class Commands:
    """What the commands of a rig are.

    Attributes
    ----------
    unit : str
        "rad" for knob angles; else a name for the reader, such as "mA": gears are in rad per unit.
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
    """What is known of the measured tilt.

    Attributes
    ----------
    noise_rad : float or None
        Standard deviation of a measured tilt [rad]; None where it is estimated from the recordings.
    offset : (float, float)
        Range of its reading when the board is level [rad].

    Raises
    ------
    IrtError
        If the noise is not positive, or the range is upside down.
    """

    noise_rad: float | None = None
    offset: tuple[float, float] = TILT_OFFSET_RAD

    def __post_init__(self) -> None:
        if self.noise_rad is not None:
            check_number("noise_rad", self.noise_rad, _TINY, 1.0, " rad")
        low, high = arguments.pair("offset", self.offset)
        if low >= high:
            raise IrtError(f"offset: the range [{low}, {high}] is upside down; expected [low, high]")
        for end in self.offset:
            check_number("offset", end, -1.0, 1.0, " rad")


def check_number(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise `IrtError` unless a value is a number within bounds."""
    if not low <= arguments.number(name, value) <= high:
        raise IrtError(f"{name}: expected a number from {low:g} to {high:g}{unit}, found {value:g}")
