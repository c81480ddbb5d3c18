"""Formatting of numbers and names for reports and the terminal."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from importlib.metadata import version

from markupsafe import Markup

from irt import display
from irt.model import Parameter

#: Units of the parameters; others are dimensionless.
UNITS = {"time_scale": "1/240 s"}

_NO_BREAK = "\N{NO-BREAK SPACE}"
_TIMES = "\N{MULTIPLICATION SIGN}"
#: Two errors with a smaller ratio count as equal.
_EQUAL = 1.05


def percent(error: float) -> str:
    """Return an error given in board edges as text: percent, to two digits."""
    if math.isnan(error):
        return "-"
    return f"{display.two_digits(100 * error)}{_NO_BREAK}%"


def millimetres(error: float, edge_m: float) -> str:
    """Return an error given in board edges as a length."""
    return f"{1000 * error * edge_m:.2g}{_NO_BREAK}mm"


def change(before: float, after: float) -> str:
    """Return the change of an error as text, such as "32× smaller"."""
    if not before > 0 or not after > 0:
        return "-"
    if before < _EQUAL * after:
        return "unchanged" if after < _EQUAL * before else f"{_ratio(after / before)}{_TIMES} larger"
    return f"{_ratio(before / after)}{_TIMES} smaller"


def explained(before: float, after: float, floor: float) -> float:
    """Return the share of an error above the noise floor that a better model removes.

    Parameters
    ----------
    before, after : float
        Mean absolute errors [board edges].
    floor : float
        Mean absolute error of the tracker noise alone [board edges].

    Returns
    -------
    float
        From 0 to 1; NaN if the error before was at the floor already.
    """
    if not before > _EQUAL * floor:
        return math.nan
    return min(1.0, max(0.0, (before - after) / (before - floor)))


def duration(rows: int, seconds: float | None = None) -> str:
    """Return a duration as text: in seconds if there are stamps, else in rows.

    Parameters
    ----------
    rows : int
        Number of rows.
    seconds : float, optional
        Duration by the recording's stamps [s]; None without stamps.
    """
    return counted(rows, "row") if seconds is None else f"{seconds:.1f}{_NO_BREAK}s"


def share(part: float) -> str:
    """Return a share as text: in whole percent, but never rounded to 0 or 100 %."""
    if part >= 0.995:
        return _percentage(f"{math.floor(1000 * part) / 10:.4g}")
    return _percentage("< 1" if 0.0 < part < 0.005 else f"{100 * part:.0f}")


def commands(text: str) -> Markup:
    """Return a sentence with the commands in it, which stand between backticks, as code."""
    code = Markup("<code>{}</code>")
    parts = text.split("`")
    return Markup("").join(code.format(part) if index % 2 else part for index, part in enumerate(parts))


def probability(chance: float) -> str:
    """Return a probability as text: in percent, never rounded to 0 or 100 %."""
    if chance > 0.999:
        return _percentage("> 99.9")
    if chance < 0.001:
        return _percentage("< 0.1")
    return _percentage(f"{100 * chance:.2g}" if chance < 0.985 else f"{100 * chance:.1f}")


def in_rows(name: str, value: Parameter, unit: str, row_s: float) -> tuple[str, Parameter, str]:
    """Return a parameter's name, value and unit, with seconds converted to rows.

    The interval is dropped, because without stamps it reflects mostly that of the time scale.

    Parameters
    ----------
    name : str
        Such as "delay_s" or "rate_per_s"; its unit suffix is replaced too.
    value : Parameter
        In SI units.
    unit : str
        Such as "s", "m/s²" or "rad s/m".
    row_s : float
        Duration of a row [s].
    """
    renamed, number, changed = display.in_rows(name, value.value, unit, row_s)
    return (name, value, unit) if changed == unit else (renamed, Parameter(number), changed)


def with_interval(parameter: Parameter) -> str:
    """Return a value and its 95 % interval as text, to significant digits."""
    return display.interval(parameter.value, parameter.low, parameter.high)


def quantity(value: float, unit: str) -> str:
    """Return a value with three digits and its unit as text."""
    return f"{value:.3g}{_NO_BREAK}{unit}" if unit else f"{value:.3g}"


def labelled(name: str, unit: str) -> str:
    """Return the name of a parameter with its unit, as a table header."""
    return f"{name} [{unit}]" if unit else name


def scaled(factor: float, value: Parameter) -> Parameter:
    """Return a value and its interval multiplied by a factor."""
    if value.low is None or value.high is None:
        return Parameter(factor * value.value)
    return Parameter(factor * value.value, factor * value.low, factor * value.high)


def p_value(probability: float) -> str:
    """Return a p-value as text, with one significant digit."""
    if math.isnan(probability):
        return "-"
    return "< 0.000001" if probability < 1e-6 else f"{float(f'{probability:.1g}'):f}".rstrip("0")


def plain(name: str) -> str:
    """Return a catalogue name with spaces instead of underscores."""
    return name.replace("_", " ")


def together(names: Sequence[str]) -> str:
    """Return a set of effects, as one hypothesis, as text."""
    return " + ".join(plain(name) for name in names) or "nothing added"


def counted(count: int, thing: str, plural: str = "") -> str:
    """Return a count with its noun; `plural` is for nouns without a plural in -s."""
    return f"{count:,} {thing if count == 1 else plural or f'{thing}s'}"


def versions(*others: str) -> dict[str, str]:
    """Return the versions of Python and of our own package, numpy, scipy and the given packages."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("labsim-irt", "numpy", "scipy", *others))
    return {
        "versions": f"{packages}, Python {platform.python_version()}",
        "machine": f"{platform.system()} {platform.machine()}",
    }


def _percentage(number: str) -> str:
    return f"{number} %".replace(" ", _NO_BREAK)


def _ratio(value: float) -> str:
    return f"{value:.1f}" if value < 10 else f"{_round(value):,}"


def _round(value: float) -> int:
    """Return a number rounded to two significant digits."""
    return round(float(f"{value:.2g}"))
