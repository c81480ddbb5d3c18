"""A tuned value with its interval, and an effect with its values."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from irt import arguments
from irt.errors import IrtError

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True)
class Parameter:
    """The value of one tuned parameter, and where it is known its 95 % interval, in the parameter's own unit.

    An end of the interval is infinite where the recordings do not bound the parameter.

    Raises
    ------
    IrtError
        If the interval has one end only, or does not run upwards.
    """

    value: float
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("value", self.value), ("low", self.low), ("high", self.high)):
            if value is not None or name == "value":
                arguments.number(name, value)
        if (self.low is None) != (self.high is None):
            raise IrtError("an interval needs both low and high")
        if self.low is not None and self.high is not None and not self.low <= self.high:
            raise IrtError(f"the interval from {self.low} to {self.high} is upside down")


@dataclass(frozen=True)
class Effect:
    """A physical effect added to the base simulation: its name in the catalogue, its parameters by name.

    Parameters left out are neutral. Whether the engine knows the effect shows when it is read or simulated.

    Raises
    ------
    IrtError
        If a name could not stand in a file, or a value is not finite.
    """

    name: str
    parameters: dict[str, float]

    def __post_init__(self) -> None:
        arguments.mapping("parameters", self.parameters)
        for name in (self.name, *self.parameters):
            if not isinstance(name, str) or not _NAME.fullmatch(name):
                raise IrtError(f'"{name}" is no name of an effect or of a parameter of one')
        for name, value in self.parameters.items():
            if not math.isfinite(arguments.number(f"{self.name}, {name}", value)):
                raise IrtError(f"{self.name}, {name}: expected a finite number, found {value}")
