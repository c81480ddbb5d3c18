"""Numbers and names as the pages write them."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import version

from irt import display
from irt.model import Parameter

#: Units of the parameters that have one.
UNITS = {"time_scale": "1/240 s"}

_NO_BREAK = "\N{NO-BREAK SPACE}"
#: Below this ratio of two errors the smaller one is no progress worth a number.
_EQUAL = 1.05


def percent(error: float) -> str:
    """Return an error given in board edges as text: percent, to two digits."""
    if math.isnan(error):
        return "-"
    value = 100 * error
    return f"{value:.{max(0, min(3, 1 - display.magnitude(value)))}f}{_NO_BREAK}%"


def millimetres(error: float, edge_m: float) -> str:
    """Return an error given in board edges as a length."""
    return f"{1000 * error * edge_m:.2g}{_NO_BREAK}mm"


def times_less(before: float, after: float) -> str:
    """Return how much smaller an error became, in words."""
    if not before > 0 or not after > 0:
        return "-"
    if before < _EQUAL * after:
        return "no less" if after < _EQUAL * before else f"{_ratio(after / before)} times more"
    return f"{_ratio(before / after)} times less"


def with_interval(parameter: Parameter) -> str:
    """Return a value and its 95 % interval as text, to the digits that the interval leaves meaning."""
    return display.interval(parameter.value, parameter.low, parameter.high)


def quantity(value: float, unit: str) -> str:
    """Return a value of a few digits with its unit."""
    return f"{value:.3g}{_NO_BREAK}{unit}" if unit else f"{value:.3g}"


def labelled(name: str, unit: str) -> str:
    """Return the name of a parameter with its unit, as tables head a row."""
    return f"{name} [{unit}]" if unit else name


def odds(p_value: float) -> str:
    """Return how often chance alone does as much, in words."""
    if math.isnan(p_value):
        return "-"
    if p_value < 1e-6:
        return "less than 1 in a million"
    if p_value > 0.5:
        return "more often than not"
    return f"1 in {_round(1 / p_value):,}"


def plain(name: str) -> str:
    """Return a name of the catalogue as words."""
    return name.replace("_", " ")


def together(names: Sequence[str]) -> str:
    """Return effects that are added at once, as one hypothesis."""
    return " + ".join(plain(name) for name in names) or "nothing added"


def listed(items: Iterable[str], last: str = "and") -> str:
    """Return items as a sentence lists them."""
    *others, final = items
    return f"{', '.join(others)} {last} {final}" if others else final


def counted(count: int, thing: str) -> str:
    """Return a number of things, in words."""
    return f"{count:,} {thing}{'s' if count != 1 else ''}"


def versions() -> dict[str, str]:
    """Return what the numbers were computed with."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("labsim-irt", "numpy", "scipy", "torch"))
    return {
        "versions": f"{packages}, Python {platform.python_version()}",
        "machine": f"{platform.system()} {platform.machine()}",
    }


def _ratio(value: float) -> str:
    return f"{value:.1f}" if value < 10 else f"{_round(value):,}"


def _round(value: float) -> int:
    """Return a number to two digits."""
    return round(float(f"{value:.2g}"))
