"""Numbers of a proof as words and lines of its Markdown page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from irt.proof.metrics import Floor, Quantity, Rate


def counted(count: int, what: str) -> str:
    """Return a count with its noun."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def rate(value: Rate) -> str:
    """Return a rate with its interval in percent; empty without trials."""
    return percent(value.share, *value.interval) if value.of else ""


def rate_of(value: Rate) -> str:
    """Return a rate with its interval in percent, and the number of trials; empty without trials."""
    return f"{rate(value)} of {value.of}" if value.of else ""


def quantity(value: Quantity) -> str:
    """Return a median with its interval; empty without values."""
    return f"{value.value:.3g} ({value.low:.3g} to {value.high:.3g})" if value.of else ""


def measured(floor: Floor) -> str:
    """Return the measured value of a promise; empty if nothing was counted."""
    if not floor.of:
        return ""
    if floor.is_rate:
        return percent(floor.value, floor.low, floor.high)
    return f"{floor.value:.3f} ({floor.low:.3f} to {floor.high:.3f})"


def kept(floor: Floor) -> str:
    """Return whether a promise was kept."""
    if floor.kept is None:
        return "not counted"
    sure = "" if floor.sure else ", though not with 95 % confidence"
    return f"{'yes' if floor.kept else '**no**'}{sure}"


def percent(value: float, low: float, high: float) -> str:
    """Return a share with its interval in percent."""
    return f"{100 * value:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def picture(folder: str, name: str, caption: str) -> Iterator[str]:
    """Yield the lines of a picture with its caption."""
    yield f"![{caption}]({folder}/{name}.png)\n"
    yield f"*{caption}*\n"


def row(cells: Sequence[str]) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(cells)} |"


def header(cells: Sequence[str]) -> Iterator[str]:
    """Yield the head of a table."""
    yield row(cells)
    yield row(["---"] * len(cells))
