"""Notebook display of results: small HTML tables, and numbers as text."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

#: Seconds in a unit, with their power.
_SECOND = re.compile(r"\bs(?=([²³])?(?:\W|$))")
#: Seconds in the suffix of a name.
_PER_SECOND = re.compile(r"_per_s(?=\d|_|$)")
_SUPERSCRIPTS = str.maketrans("²³", "23")
#: Most rows of a displayed table.
_MOST_ROWS = 30


def interval(value: float, low: float | None, high: float | None) -> str:
    """Return a value and its 95 % interval as text, to significant digits."""
    if low is None or high is None:
        return f"{value:.4g}"
    if math.isinf(low) or math.isinf(high):
        if math.isinf(low) and math.isinf(high):
            return f"{value:.4g}  (not identifiable)"
        return f"{value:.4g}  ({f'at most {high:.4g}' if math.isinf(low) else f'at least {low:.4g}'})"
    digits = max(0, 1 - magnitude(high - low)) if high > low else 6
    middle, bottom, top = (f"{number:z.{digits}f}" for number in (value, low, high))
    return f"{middle}  ({bottom} to {top})"


def in_rows(name: str, value: float, unit: str, row_s: float) -> tuple[str, float, str]:
    """Return a parameter's name, value and unit, with seconds converted to rows.

    Parameters
    ----------
    name : str
        Such as "delay_s" or "rate_per_s"; its unit suffix is replaced too.
    value : float
        In SI units.
    unit : str
        Such as "s", "m/s²" or "rad/s".
    row_s : float
        Duration of a row in the simulation [s].
    """
    above, _, below = unit.partition("/")
    power = _seconds(above) - _seconds(below)
    if power == 0:
        return name, value, unit
    if unit == "s":
        return name.removesuffix("_s"), value / row_s, "rows"
    return _PER_SECOND.sub("_per_row", name), value * row_s**-power, _SECOND.sub("row", unit)


def _seconds(unit: str) -> int:
    """Return the power of seconds in a unit without a fraction."""
    found = _SECOND.search(unit)
    return 0 if found is None else int((found.group(1) or "1").translate(_SUPERSCRIPTS))


def listed(items: Iterable[str], last: str = "and") -> str:
    """Return items as an enumeration, such as "a, b and c"."""
    *others, final = items
    return f"{', '.join(others)} {last} {final}" if others else final


def magnitude(value: float) -> int:
    """Return the order of magnitude of a number: the power of ten of its first digit."""
    return math.floor(math.log10(abs(value))) if value else 0


def two_digits(value: float) -> str:
    """Return a number to two digits, with trailing zeros and at most three decimals."""
    return f"{value:.{max(0, min(3, 1 - magnitude(value)))}f}"


def percent(error: float | None) -> str:
    """Return an error in board edges as percent of the edge; a dash if there is none."""
    return "-" if error is None or math.isnan(error) else f"{100.0 * error:.3g} %"


def page(title: str, *parts: str) -> str:
    """Return a heading followed by parts made by other functions of this module."""
    written: str = _parts().page(title, parts)
    return written


def paragraph(text: str) -> str:
    """Return a paragraph, or nothing if the text is empty."""
    written: str = _parts().paragraph(text)
    return written


def items(sentences: Iterable[str]) -> str:
    """Return a list of sentences, or nothing if there are none."""
    written: str = _parts().items(list(sentences))
    return written


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table with a heading row; long tables are cut."""
    written: str = _parts().table(head, rows, _MOST_ROWS)
    return written


@functools.cache
def _parts() -> Any:
    """Return the macros of the template; they escape text, but not each other's results."""
    # jinja2 takes longer to load than everything else that a model needs.
    from jinja2 import Environment, PackageLoader  # noqa: PLC0415

    return Environment(loader=PackageLoader("irt"), autoescape=True).get_template("notebook.html").module
