"""The catalogue of physical effects, as the engine has it: names, parameters, words."""

from __future__ import annotations

import functools
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from irt import _labsim, arguments
from irt.errors import IrtError, unknown_name

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect.

    Attributes
    ----------
    name : str
        Carries the unit where that could be doubted.
    unit : str
        SI; empty for a plain number.
    low, high : float
        The plausible values: where a search looks; both are its usual answer for a choice.
    neutral : float
        The value without effect.
    least, most : float
        The values that physics allows.
    time_power : int
        With which power of the time scale it changes where all of the motion runs slower under weaker pushes,
        along the same path: 1 of a time, -1 of a speed, -2 of a push, or of a tilt of the board.
    doc : str
        What it is, in a few words.
    optional : bool
        Whether it refines the effect: fits hold it at its neutral value unless the caller names it.
    reach : (float, float)
        The values that a fit takes without a price; at least from `low` to `high`.
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
        """Whether it is a question of yes (1) or no (0): both are tried, and nothing between them."""
        return self.low == self.high

    @property
    def choices(self) -> tuple[float, float]:
        """What a choice may be."""
        return self.least, self.most

    def drawn(self, random: np.random.Generator) -> float:
        """Draw one of the plausible values, each as likely, or an answer to a choice."""
        return float(random.choice(self.choices) if self.is_choice else random.uniform(self.low, self.high))

    @property
    def searched(self) -> str:
        """Where a search looks, in words."""
        if self.is_choice:
            return " or ".join(f"{one:g}" for one in self.choices)
        return f"{self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class EffectInfo:
    """What the catalogue says of an effect.

    Attributes
    ----------
    name : str
        Its name in every file and report.
    stage : str
        Where it sits: actuation, timing, board, contact, air, field or sensing.
    equation : str
        The physics, in one line.
    parameters : tuple of EffectParameter
        In the order in which arrays hold them.
    does, matters, looks : str
        What it does, when it matters, what it looks like in data.
    references : tuple of str
        Where to read more.
    listed : bool
        Whether the catalogue lists it. What it does not list simulates like any effect and is no hypothesis.
    turns : bool
        Whether it matters how the marble has been turned by its path.
    hypothesis : bool
        Whether the diagnosis tries it.
    shrunk : bool
        Whether its parameters are drawn from one normal distribution about zero, whose size is estimated.
    moves_board : bool
        Whether it acts between the command and the board's tilt.
    of_rims : bool
        Whether it is a law of the rim: how a marble leaves it.
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

    @property
    def required(self) -> tuple[EffectParameter, ...]:
        """The parameters that every fit of the effect has: all but the optional ones, which come last."""
        return self.used(())

    def used(self, named: Container[str]) -> tuple[EffectParameter, ...]:
        """Return the parameters that a fit has, if some are named: those, and all that are not optional."""
        return tuple(one for one in self.parameters if not one.optional or one.name in named)

    @property
    def doc(self) -> str:
        """What it does, when it matters, what it looks like: one text."""
        return f"{self.does} {self.matters} {self.looks}"


def effects() -> list[EffectInfo]:
    """List the catalogue of physical effects, in the order in which they act from command to picture."""
    return [one for one in _known().values() if one.listed]


def hypothetical() -> list[EffectInfo]:
    """List the effects of the catalogue that the diagnosis tries, in the order in which they act."""
    return [one for one in effects() if one.hypothesis]


def effect(name: str) -> EffectInfo:
    """Return what the catalogue says of an effect, or the engine of one that it does not list.

    Raises
    ------
    IrtError
        If there is none of this name; the message lists those that are near.
    """
    try:
        return _known()[name]
    except KeyError:
        raise unknown_name("effect", name, _known()) from None


def parameter_values(chosen: Sequence[Mapping[str, Any]], count: int) -> list[tuple[str, Array]]:
    """Return the values that rollouts take of effects.

    Parameters
    ----------
    chosen : sequence of mappings
        Each with the ``name`` of an effect, and its parameters by name: numbers, or (n,) arrays with one
        number for each rollout. Those left out are neutral.
    count : int
        How many rollouts, n.

    Returns
    -------
    list of (name, (1 or n, p) array)
        The parameters in the catalogue's order.

    Raises
    ------
    IrtError
        For an unknown effect or parameter, or a value that is no number.
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
        name, stage, equation, parameters, does, matters, looks, references, flags = one
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
        )
    return found
