"""Known facts about each lab's logs: sizes, names and the declared convention."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from irt.importing.mapping import Expression
from irt.rig import Board, Marble


@dataclass(frozen=True)
class Lab:
    """A format's board, marble and declared convention.

    Attributes
    ----------
    name : str
        Name in ``--from``.
    board, marble : Board, Marble
        Sizes if the rig's folder has no rig.toml.
    mapping : dict
        Expressions of the log's columns; ``edge_x_m`` is the board's long edge.
    unit : str
        Unit of the commands.
    rate : float
        Nominal rate of the states, for logs without stamps [Hz].
    current : float or None
        Units of a motor's current in a unit of the commands, where commands are currents.
    """

    name: str
    board: Board = field(default_factory=Board)
    marble: Marble = field(default_factory=Marble)
    mapping: Mapping[str, str] = field(default_factory=dict)
    unit: str = "1"
    rate: float = 55.0
    current: float | None = None

    def expressions(self, own: Mapping[str, Expression]) -> dict[str, Expression]:
        """Return the mapping with the user's expressions instead of the declared ones."""
        return {**{target: Expression.parse(text) for target, text in self.mapping.items()}, **own}


# alpha is minus the rotation about y, beta the rotation about x (CyberRunner's and TAG's estimators).
_STATE = {
    "marble_x": "x_b/edge_x_m",
    "marble_y": "y_b/edge_x_m",
    "tilt_x_rad": "beta",
    "tilt_y_rad": "-alpha",
    "cmd_x": "vel_1",
    "cmd_y": "vel_2",
}

#: 0.276 x 0.231 m, a steel ball of 8.5 g.
CYBERRUNNER = Lab(
    "cyberrunner",
    Board(0.276, 0.231),
    Marble(0.00635, 0.0085),
    _STATE,
    unit="motor current, about mA",
    current=1.0,
)
#: Its replay: actions of -1 to 1, each scaled by -200 units of current.
REPLAY = Lab(
    "cyberrunner",
    CYBERRUNNER.board,
    CYBERRUNNER.marble,
    {**_STATE, "cmd_x": "action_1", "cmd_y": "action_2"},
    unit="action",
    current=-200.0,
)
#: A CyberRunner without ROS: alpha about x, beta about y; an action is 5 degrees of a tilt set point.
WITHOUT_ROS = Lab(
    "cyberrunner",
    CYBERRUNNER.board,
    CYBERRUNNER.marble,
    {
        "t_s": "t",
        "marble_x": "xb/edge_x_m",
        "marble_y": "yb/edge_x_m",
        "tilt_x_rad": "alpha",
        "tilt_y_rad": "beta",
        "cmd_x": "a1",
        "cmd_y": "a0",
        "seen": "ball_found",
    },
    unit="action",
)
#: 0.259 x 0.229 m, a steel ball of 12 mm.
TAG = Lab("tag", Board(0.259, 0.229), Marble(0.006, 0.0071), _STATE, unit="servo command")
#: Any CSV: the user maps all columns.
ANY = Lab("csv")
