"""A library of pushes that no effect of the catalogue has, and which of them explain most of what is left.

Profiles (waves, steps, bells, ridges, spots, lines, bowls, saddles) of a push, of a drag or of the gears over
the board, over the marble's velocity and its direction, over the board's tilt, over time and over the way so
far; powers of the speed against the motion and across it; a mode in which the board swings after its knobs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from irt.diagnosis.basis import SHAPES

#: Profiles that the engine's effect can hold, and the parameters of one over each of what it may depend on.
PROFILES = 5
VECTORS = {
    "position": ("wave_1_x_per_m", "wave_1_y_per_m"),
    "velocity": ("velocity_1_x_s_per_m", "velocity_1_y_s_per_m"),
    "heading": ("heading_1_x", "heading_1_y"),
    "command": ("tilt_1_x_per_rad", "tilt_1_y_per_rad"),
    "time": ("rate_1_per_s",),
    "way": ("way_1_per_m",),
}
#: What is no profile: power laws of the speed, against the motion and across it, and the mode.
LAWS = ("drag", "side")
MODE = "mode"
#: By what parameter each of them is told.
_SIZES = {"drag_strength": "drag", "side_strength": "side", "mode_gain": MODE}
#: What of a profile multiplies it.
PUSH = ("push_1_x_m_per_s2", "push_1_y_m_per_s2")
BRAKE = "brake_1_m_per_s2"
#: Those of the knobs that push along x and along y: a turn about y does the former.
GEARS = ("gear_1_y", "gear_1_x")


@dataclass(frozen=True)
class Term:
    """A term of the library, with the values that explain most.

    Attributes
    ----------
    variable : str
        What the push depends on, a key of `VECTORS`.
    values : dict
        Parameters of the engine's effect, those of a profile by their names in the first slot.
    free : tuple of str
        Those that a fit may move.
    explained : float
        Share of the leftover's sum of squares.
    """

    variable: str
    values: dict[str, float]
    free: tuple[str, ...]
    explained: float

    @property
    def law(self) -> str | None:
        """The power law that it is, "drag" or "side", or "mode"; None for a profile."""
        return next((name for size, name in _SIZES.items() if size in self.values), None)

    @property
    def brakes(self) -> bool:
        """Whether it is a profile of the drag."""
        return BRAKE in self.values

    @property
    def gears(self) -> bool:
        """Whether it is a profile of the gears."""
        return GEARS[0] in self.values

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variables that the push depends on: a drag is against the velocity, whatever changes it."""
        also = {"brake": ("velocity",), "gear": ("command",)}
        return tuple(dict.fromkeys((self.variable, *also.get(self._changes, ()))))

    @property
    def _changes(self) -> str:
        """What it is a profile or a law of."""
        changed = {"brake": BRAKE, "gear": GEARS[0]}
        return self.law or next((what for what, name in changed.items() if name in self.values), "push")

    @property
    def shape(self) -> str:
        """The shape of a profile."""
        return SHAPES[round(self.values["shape_1"])]

    @property
    def family(self) -> tuple[str, ...]:
        """What tells terms from each other that are not the same with other values."""
        return (self.variable, self._changes)

    def in_slot(self, slot: int) -> Term:
        """Return it in another of the engine's profiles."""
        values = {of_slot(name, slot): value for name, value in self.values.items()}
        return Term(self.variable, values, tuple(of_slot(name, slot) for name in self.free), self.explained)


def of_slot(name: str, slot: int) -> str:
    """Return what a parameter of the engine's first profile is called in another of its profiles."""
    if name == "shape_1":
        return f"shape_{slot}"
    return name.replace("_1_", f"_{slot}_")


def in_slots(terms: Sequence[Term]) -> list[Term]:
    """Return terms as the engine's effect takes them together: each profile in a slot of its own."""
    slots = itertools.accumulate(int(term.law is None) for term in terms)
    return [term.in_slot(slot) for term, slot in zip(terms, slots, strict=True)]
