"""The engine's catalogue of physical effects: names, parameters, descriptions."""

from __future__ import annotations

import functools
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from irt import _labsim, arguments
from irt.errors import IrtError, unknown_name

Array = npt.NDArray[np.float64]

#: Power of the angle in the units of parameters at the knob.
_POWERS_OF_RAD = {"rad": 1, "rad/s": 1, "1/rad²": -2}


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect.

    Attributes
    ----------
    name : str
        Name, with the unit as suffix if it has one.
    unit : str
        SI unit; empty for a dimensionless number.
    low, high : float
        Search range; both are the default value for a choice.
    neutral : float
        The value without effect.
    least, most : float
        The range that physics allows.
    time_power : int
        Power of the time scale with which the parameter changes under the time symmetry (slower motion under
        weaker pushes along the same path): 1 for a time, -1 for a speed, -2 for a push or a tilt of the
        board.
    doc : str
        A short description.
    optional : bool
        Whether it refines the effect: fits hold it at its neutral value unless it is named.
    reach : (float, float)
        Values that a fit may take without penalty; contains the range from `low` to `high`.
    """

    name: str
    unit: str
    low: float
    high: float
    neutral: float
    least: float
    most: float
    time_power: int
    doc: str
    optional: bool = False
    reach: tuple[float, float] = (-np.inf, np.inf)

    @property
    def is_choice(self) -> bool:
        """Whether it is binary: 1 or 0, without values in between."""
        return self.low == self.high

    @property
    def choices(self) -> tuple[float, float]:
        """The two values of a choice."""
        return self.least, self.most

    def drawn(self, random: np.random.Generator) -> float:
        """Draw uniformly from the search range, or one of the values of a choice."""
        return float(random.choice(self.choices) if self.is_choice else random.uniform(self.low, self.high))

    def in_unit(self, unit: str, rad: float) -> EffectParameter:
        """Return the parameter with angles in another unit of `rad` radians, and the same allowed numbers."""
        factor = rad ** -_POWERS_OF_RAD.get(self.unit, 0)
        return replace(
            self,
            unit=self.unit.replace("rad", unit),
            low=factor * self.low,
            high=factor * self.high,
            neutral=factor * self.neutral,
            reach=(factor * self.reach[0], factor * self.reach[1]),
        )

    @property
    def searched(self) -> str:
        """The search range as text."""
        if self.is_choice:
            return " or ".join(f"{one:g}" for one in self.choices)
        return f"{self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class EffectInfo:
    """An effect of the catalogue.

    Attributes
    ----------
    name : str
        Its name in all files and reports.
    stage : str
        Stage of the simulator: actuation, timing, board, contact, air, field or sensing.
    equation : str
        The physics in one line.
    parameters : tuple of EffectParameter
        The parameters, in the order of arrays.
    does, matters, looks : str
        What it does, when it matters, and how it appears in data.
    references : tuple of str
        Literature.
    listed : bool
        Whether the catalogue lists it. Unlisted effects can be simulated but are not hypotheses.
    turns : bool
        Whether it depends on the marble's orientation.
    hypothesis : bool
        Whether the diagnosis searches it.
    shrunk : bool
        Whether its parameters have a normal prior about zero whose size is estimated.
    moves_board : bool
        Whether it acts between the command and the board's tilt.
    of_rims : bool
        Whether it is a law of rebounds from the rim.
    noise : str or None
        The random quantity of a filter with it: "jitter" of delays, or "release" of a marble that friction
        holds at rest more firmly than it brakes a rolling one.
    """

    name: str
    stage: str
    equation: str
    parameters: tuple[EffectParameter, ...]
    does: str
    matters: str
    looks: str
    references: tuple[str, ...]
    listed: bool
    turns: bool
    hypothesis: bool
    shrunk: bool
    moves_board: bool
    of_rims: bool
    noise: str | None

    @property
    def required(self) -> tuple[EffectParameter, ...]:
        """The parameters of every fit: all but the optional ones, which come last."""
        return self.used(())

    @property
    def units(self) -> dict[str, str]:
        """The units of the parameters by name."""
        return {one.name: one.unit for one in self.parameters}

    def in_unit(self, unit: str, rad: float) -> EffectInfo:
        """Return the effect with angles of the knob in another unit of `rad` radians."""
        if self.stage != "actuation":
            return self
        return replace(self, parameters=tuple(one.in_unit(unit, rad) for one in self.parameters))

    def used(self, named: Container[str]) -> tuple[EffectParameter, ...]:
        """Return the parameters of a fit: all that are not optional, and those that are named."""
        return tuple(one for one in self.parameters if not one.optional or one.name in named)

    @property
    def doc(self) -> str:
        """The complete description: what it does, when it matters, and how it appears in data."""
        return f"{self.does} {self.matters} {self.looks}"


@arguments.entry
def effects() -> list[EffectInfo]:
    """List the catalogue of physical effects, in the order in which they act from command to picture."""
    return [one for one in _known().values() if one.listed]


def hypothetical() -> list[EffectInfo]:
    """List the effects that the diagnosis searches, in the order in which they act."""
    return [one for one in effects() if one.hypothesis]


def effect(name: str) -> EffectInfo:
    """Return an effect by name, listed or not.

    Raises
    ------
    IrtError
        If the name is unknown; the message suggests the nearest.
    """
    try:
        return _known()[name]
    except KeyError:
        raise unknown_name("effect", name, _known()) from None


def parameter_values(chosen: Sequence[Mapping[str, Any]], count: int) -> list[tuple[str, Array]]:
    """Return the parameter values of effects as arrays for rollouts.

    Parameters
    ----------
    chosen : sequence of mappings
        Each with the ``name`` of an effect, and its parameters by name: numbers, or (n,) arrays with one
        number for each rollout. Missing parameters are neutral.
    count : int
        Number of rollouts, n.

    Returns
    -------
    list of (name, (1 or n, p) array)
        The parameters in the catalogue's order.

    Raises
    ------
    IrtError
        For an unknown effect or parameter, or a value that is not a number.
    """
    if isinstance(chosen, str | Mapping) or not isinstance(chosen, Sequence):
        raise IrtError(f"effects: expected a sequence of mappings, got {arguments.shown(chosen)}")
    return [_values(one, count) for one in chosen]


def _values(chosen: Mapping[str, Any], count: int) -> tuple[str, Array]:
    if not isinstance(chosen, Mapping) or "name" not in chosen:
        raise IrtError(f"effects: expected mappings with a name and parameters, got {chosen!r}")
    info = effect(str(chosen["name"]))
    known = [parameter.name for parameter in info.parameters]
    for name in chosen:
        if name != "name" and name not in known:
            raise unknown_name(f"parameter of {info.name}", name, known)
    columns = [
        _column(info.name, parameter.name, chosen.get(parameter.name, parameter.neutral), count)
        for parameter in info.parameters
    ]
    rows = max(len(column) for column in columns)
    return info.name, np.ascontiguousarray(
        np.stack([np.broadcast_to(column, rows) for column in columns], axis=1)
    )


def _column(effect_name: str, name: str, value: Any, count: int) -> Array:
    try:
        column = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise IrtError(f"{effect_name}, {name}: expected a number, got {value!r}") from error
    if column.shape not in ((1,), (count,)):
        raise IrtError(
            f"{effect_name}, {name}: expected a number or one for each of the {count} rollouts, "
            f"got shape {np.shape(value)}"
        )
    return column


@functools.cache
def _known() -> dict[str, EffectInfo]:
    found = {}
    for one in _labsim.effects():
        name, stage, equation, parameters, does, matters, looks, references, flags, noise = one
        listed, turns, hypothesis, shrunk, moves_board, of_rims = flags
        found[name] = EffectInfo(
            name=name,
            stage=stage,
            equation=equation,
            parameters=tuple(EffectParameter(*parameter) for parameter in parameters),
            does=does,
            matters=matters,
            looks=looks,
            references=tuple(references),
            listed=listed,
            turns=turns,
            hypothesis=hypothesis,
            shrunk=shrunk,
            moves_board=moves_board,
            of_rims=of_rims,
            noise=noise,
        )
    return found
