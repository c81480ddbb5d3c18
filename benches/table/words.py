"""Numbers as words of a table."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

UNITS = (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9))


def significant(number: float) -> str:
    """Return a number with three significant digits and no exponent."""
    rounded = float(f"{number:.3g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 1e5 else f"{rounded:g}"


def duration(seconds: float) -> str:
    """Return a time in the unit that suits it."""
    unit, scale = next((u, s) for u, s in UNITS if seconds >= s or u == "ns")
    return f"{significant(seconds / scale)} {unit}"


def rate(substeps_per_s: float) -> str:
    """Return a rate in millions."""
    return f"{significant(substeps_per_s / 1e6)} M"


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first column is text and whose others are numbers."""
    lines = [columns, ["---", *["---:"] * (len(columns) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def natural_order(name: str) -> list[tuple[str, int]]:
    """Return a sort key under which the numbers in names count as numbers: 64 before 1024."""
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", name)]


@dataclass(frozen=True)
class Measured:
    """A middle value and how far repetitions scatter about it, both in the same unit."""

    median: float
    spread: float

    @classmethod
    def of(cls, samples: Sequence[float]) -> Measured:
        """Return the median and 1.4826 x the median absolute deviation: a robust standard deviation."""
        median = statistics.median(samples)
        return cls(median, 1.4826 * statistics.median(abs(sample - median) for sample in samples))

    def over(self, other: Measured) -> Measured:
        """Return the ratio of two independent measurements."""
        ratio = self.median / other.median
        return Measured(ratio, ratio * math.hypot(self.spread / self.median, other.spread / other.median))

    @property
    def percent(self) -> str:
        """Return the spread in percent of the median."""
        return f"± {100 * self.spread / self.median:.1f} %"
