"""Plot of the error budget: a stacked bar for each horizon, and a key with the percentages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.patches import Rectangle

from irt.files import PathLike
from irt.report import style
from irt.report.error_budget import Bar, Part
from irt.report.words import share

#: Colours of effects, the most important first.
_EFFECTS = (style.TUNED, style.SECOND, style.THIRD, style.HEAT[5], style.HEAT[3])
#: Hatch of the unexplained part, distinct without colour.
_HATCH = "////"
#: Heights [inches]: of a line of text, of a bar, and of the space below it.
_LINE, _BAR, _SPACE = 0.21, 0.3, 0.14
#: Width of a letter, and space that a label leaves free in its segment [inches].
_LETTER, _MARGIN = 0.077, 0.1
#: Width of the figure, narrow enough that a phone shows its text in full size, and its margins [inches].
_WIDTH, _MARGINS = 3.6, 0.1


def plot_budget(path: PathLike, bars: Sequence[Bar]) -> None:
    """Draw the bars of an error budget below each other, and a key with a column for each bar.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    bars : sequence of Bar
        One for each horizon, all of the same parts; at least one.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    parts = bars[0].parts
    height = len(bars) * (_LINE + _BAR + _SPACE) + (1 + len(parts)) * _LINE
    width = _WIDTH - _MARGINS
    with style.drawing(path, _WIDTH, height + _MARGINS) as figure:
        axes: Any = figure.subplots()
        below = 0.0
        for bar in bars:
            axes.text(0.0, below + 0.5 * _LINE, _sentence(bar.title), color=style.INK, va="center")
            draw_bar(axes, bar, (below + _LINE, below + _LINE + _BAR), width)
            below += _LINE + _BAR + _SPACE
        _draw_key(axes, bars, below, width)
        axes.set(xlim=(0.0, 1.0), ylim=(height, 0.0))
        bare(axes)


def draw_bar(axes: Any, bar: Bar, between: tuple[float, float], width: float) -> list[int]:
    """Draw a bar from 0 to 1 along x; return the indices of parts too narrow for their names.

    Parameters
    ----------
    axes : matplotlib Axes
        Axes to draw into.
    bar : Bar
        The bar.
    between : (float, float)
        Top and bottom of the bar along y.
    width : float
        Length of the bar on the page [inches].
    """
    left, (top, bottom), nameless = 0.0, between, []
    for index, part in enumerate(bar.parts):
        if part.share > 0.0:
            axes.add_patch(_patch(bar.parts, index, (left, top), part.share, bottom - top))
        room = part.share * width - _MARGIN
        fitting = [text for text in labels(part) if len(text) * _LETTER <= room]
        if fitting:
            is_rest = part.kind == "rest"
            box = {"facecolor": style.PAPER, "edgecolor": "none", "pad": 1.5} if is_rest else None
            axes.text(
                left + 0.5 * part.share,
                0.5 * (top + bottom),
                fitting[0],
                color=colour(bar.parts, index) if is_rest else style.PAPER,
                ha="center",
                va="center",
                bbox=box,
            )
        if labels(part)[0] not in fitting:
            nameless.append(index)
        left += part.share
    return nameless


def labels(part: Part) -> tuple[str, str]:
    """Return the possible labels of a part of a bar, the longest first."""
    return f"{part.name} {share(part.share)}", share(part.share)


def colour(parts: Sequence[Part], index: int) -> str:
    """Return the colour of a part."""
    kind = parts[index].kind
    if kind == "rest":
        return style.UNTUNED
    return style.RECORDED if kind == "tracker" else _EFFECTS[index % len(_EFFECTS)]


def bare(axes: Any) -> None:
    """Hide ticks, grid and spines of axes."""
    axes.set(xticks=[], yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def _draw_key(axes: Any, bars: Sequence[Bar], top: float, width: float) -> None:
    """Draw a row for each part: its look, its name, and its share of each bar."""
    parts = bars[0].parts
    columns = [1.0 - 1.1 / width * place for place in reversed(range(len(bars)))]
    for column, bar in zip(columns, bars, strict=True):
        axes.text(column, top + 0.5 * _LINE, bar.title, color=style.MUTED, ha="right", va="center")
    for index, part in enumerate(parts):
        middle = top + (1.5 + index) * _LINE
        axes.add_patch(_patch(parts, index, (0.0, middle - 0.06), 0.2 / width, 0.12))
        axes.text(0.3 / width, middle, part.name, color=style.INK, va="center")
        for column, bar in zip(columns, bars, strict=True):
            axes.text(column, middle, share(bar.parts[index].share), color=style.INK, ha="right", va="center")


def _patch(parts: Sequence[Part], index: int, corner: tuple[float, float], wide: float, high: float) -> Any:
    """Return a rectangle in the style of a part; the unexplained part is hollow and hatched."""
    own = colour(parts, index)
    if parts[index].kind == "rest":
        return Rectangle(
            corner, wide, high, facecolor=style.PAPER, edgecolor=own, hatch=_HATCH, linewidth=0.8
        )
    return Rectangle(corner, wide, high, facecolor=own, edgecolor=style.PAPER, linewidth=0.8)


def _sentence(title: str) -> str:
    return title[:1].upper() + title[1:]
