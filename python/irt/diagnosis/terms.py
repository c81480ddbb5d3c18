"""The library of terms of learned corrections, beyond the effects of the catalogue.

It contains profiles (waves, steps, bells, ridges, spots, lines, bowls, saddles) of a push, of a drag or of
the gears over position, velocity, heading, tilt, time and path length; power laws of the speed, against the
motion and perpendicular to it; an oscillation mode of the board; a drive that follows late and yields; a
picture that turns and grows with the tilt; and forces at the rim.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

from irt.diagnosis.basis import SHAPES

#: Number of profiles in the engine's effect, and the parameters of the first over each variable.
PROFILES = 5
VECTORS = {
    "position": ("wave_1_x_per_m", "wave_1_y_per_m"),
    "velocity": ("velocity_1_x_s_per_m", "velocity_1_y_s_per_m"),
    "heading": ("heading_1_x", "heading_1_y"),
    "command": ("tilt_1_x_per_rad", "tilt_1_y_per_rad"),
    "time": ("rate_1_per_s",),
    "way": ("way_1_per_m",),
}
#: Terms other than profiles: power laws of the speed, against the motion and perpendicular to it, the mode,
#: the drive that yields, and the picture.
LAWS = ("drag", "side")
MODE = "mode"
YIELD = "yield"
PICTURE = "picture"
#: Rates of the picture's angle and growth for each radian of the board about x and about y.
TURNS = ("picture_turn_x", "picture_turn_y")
GROWTHS = ("picture_growth_x_per_rad", "picture_growth_y_per_rad")
#: Parameters of a drive that yields: its lag, and for each axis what it loses and the phase of what it keeps.
YIELDING = ("yield_lag_s", "yield_x", "yield_y", "yield_x_s_per_rad", "yield_y_s_per_rad")
#: Forces at the rim, each a term of its own, and where fits of them begin: what holds a marble there
#: [m/s^2], and what brakes it at any speed [m/s^2] and in proportion to it [1/s].
AT_RIM = {
    "rim_hold_m_per_s2": (0.02, 0.1, 0.5),
    "rim_brake_m_per_s2": (0.01, 0.05),
    "rim_drag_per_s": (0.5, 4.0),
}
#: Size parameters of these terms.
_SIZES = {
    "drag_strength": "drag",
    "side_strength": "side",
    "mode_gain": MODE,
    YIELDING[0]: YIELD,
    TURNS[0]: PICTURE,
    **{name: name for name in AT_RIM},
}
#: Amplitudes of a profile: push and drag.
PUSH = ("push_1_x_m_per_s2", "push_1_y_m_per_s2")
BRAKE = "brake_1_m_per_s2"
#: Amplitudes of the gears whose pushes are along x and along y; a turn about y pushes along x.
GEARS = ("gear_1_y", "gear_1_x")


@dataclass(frozen=True)
class Term:
    """A term of the library with its best values.

    Attributes
    ----------
    variable : str
        Variable that the push depends on, a key of `VECTORS`.
    values : dict
        Parameters of the engine's effect; those of a profile are named as in the first slot.
    free : tuple of str
        Names of the parameters that a fit may change.
    explained : float
        Explained share of the residuals' sum of squares.
    gain : float
        Gain in log-likelihood by the term [nats].
    """

    variable: str
    values: dict[str, float]
    free: tuple[str, ...]
    explained: float
    gain: float

    @property
    def law(self) -> str | None:
        """Name of a term that is no profile: of `LAWS` or `AT_RIM`, `MODE`, `YIELD`, `PICTURE`; else None."""
        return next((name for size, name in _SIZES.items() if size in self.values), None)

    @property
    def brakes(self) -> bool:
        """Whether the term is a profile of the drag."""
        return BRAKE in self.values

    @property
    def gears(self) -> bool:
        """Whether the term is a profile of the gears."""
        return GEARS[0] in self.values

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variables that the push depends on; those of a drag include the velocity, the rim has none."""
        if self.law in AT_RIM:
            return ()
        also = {"brake": ("velocity",), "gear": ("command",), YIELD: ("command rate",)}
        return tuple(dict.fromkeys((self.variable, *also.get(self._changes, ()))))

    @property
    def _changes(self) -> str:
        """The quantity that the term changes: push, drag, gears, or the name of a law."""
        changed = {"brake": BRAKE, "gear": GEARS[0]}
        return self.law or next((what for what, name in changed.items() if name in self.values), "push")

    @property
    def title(self) -> str:
        """The term in words."""
        if self.law in AT_RIM:
            return "a force at the rim"
        return f"a {'picture' if self.law == PICTURE else 'push'} that depends on {self.variable}"

    @property
    def shape(self) -> str:
        """The shape of a profile."""
        return SHAPES[round(self.values["shape_1"])]

    @property
    def family(self) -> tuple[str, ...]:
        """Key shared by all terms that differ only in their values."""
        return (self.variable, self._changes)

    def in_slot(self, slot: int) -> Term:
        """Return the term in another slot of the engine's profiles."""
        values = {of_slot(name, slot): value for name, value in self.values.items()}
        return replace(self, values=values, free=tuple(of_slot(name, slot) for name in self.free))


def turning_picture() -> Term:
    """Return a picture that turns and grows with the tilt, with rates near zero.

    Displacements by large angles are not proportional to them, and walls are seen elsewhere, so that no
    regression finds the rates. From zero, the likelihood of complete recordings leads to them.
    """
    values = dict.fromkeys((*TURNS, *GROWTHS), 0.01)
    return Term("command", values, tuple(values), 0.0, 0.0)


def forces_at_rim() -> list[Term]:
    """Return forces at the rim at small and at large sizes.

    They act from an impact to the departure after it, so that no regression on free motion finds them.
    """
    return [Term("rim", {name: size}, (name,), 0.0, 0.0) for name, sizes in AT_RIM.items() for size in sizes]


def of_slot(name: str, slot: int) -> str:
    """Return the name of a parameter of the first profile in another slot."""
    if name == "shape_1":
        return f"shape_{slot}"
    return name.replace("_1_", f"_{slot}_")


def in_slots(terms: Sequence[Term]) -> list[Term]:
    """Return terms with each profile in its own slot of the engine's effect."""
    slots = itertools.accumulate(int(term.law is None) for term in terms)
    return [term.in_slot(slot) for term, slot in zip(terms, slots, strict=True)]
