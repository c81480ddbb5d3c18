"""Plots of results for notebooks; each function returns a matplotlib figure.

Figures are made without pyplot, so that no figure is shown twice and matplotlib's global state is unchanged.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

Array = NDArray[np.float64]

# From Okabe and Ito's colour-blind-safe palette, and a grey.
MEASURED = "#57606a"
BEFORE = "#d55e00"
AFTER = "#0072b2"
#: Colour cycle of lines and bars.
COLOURS = (AFTER, BEFORE, "#009e73", "#cc79a7")

_SETTINGS: Any = {
    "font.size": 9.0,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e6ea",
    "legend.frameon": False,
    # File names may contain dollar signs.
    "text.parse_math": False,
    "savefig.dpi": 120,
}
_WIDTH = 6.4


class Picture(Figure):
    """A figure with a PNG representation for notebooks."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        with mpl.rc_context(_SETTINGS):
            self.savefig(buffer, format="png")
        return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a panel; `dots` draws dots instead."""

    label: str
    values: Array
    colour: str
    dots: bool = False


def over_time(times: Array, unit: str, panels: Mapping[str, Sequence[Line]]) -> Figure:
    """Return a figure with lines over time in stacked panels, by label."""
    with mpl.rc_context(_SETTINGS):
        figure = Picture(figsize=(_WIDTH, 0.5 + 1.6 * len(panels)), layout="constrained")
        axes = figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
        for one, (label, lines) in zip(axes, panels.items(), strict=True):
            for line in lines:
                style = {"ls": "", "marker": ".", "ms": 4.0} if line.dots else {"lw": 1.4}
                one.plot(times, line.values, color=line.colour, label=line.label, **style)
            one.set_ylabel(label)
        if any(line.label for lines in panels.values() for line in lines):
            axes[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
        axes[-1].set_xlabel(unit)
        axes[-1].margins(x=0.01)
    return figure


def curves(lines: Sequence[Line], across: str, up: str) -> Figure:
    """Return a figure with curves over their index, on a logarithmic axis."""
    with mpl.rc_context(_SETTINGS):
        figure = Picture(figsize=(_WIDTH, 3.0), layout="constrained")
        axes = figure.subplots()
        for line in lines:
            axes.plot(line.values, color=line.colour, label=line.label or None, lw=1.4)
        make_logarithmic(axes)
        axes.set(xlabel=across, ylabel=up)
        if any(line.label for line in lines):
            axes.legend()
    return figure


def make_logarithmic(axes: Any) -> None:
    """Make the y axis logarithmic, with plain numbers at 1, 2 and 5."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())


def bars(names: Sequence[str], groups: Mapping[str, Sequence[float]], across: str) -> Figure:
    """Return a figure with horizontal bars, grouped by name and coloured by the keys of `groups`."""
    count = len(groups)
    with mpl.rc_context(_SETTINGS):
        figure = Picture(figsize=(_WIDTH, 0.9 + 0.18 * len(names) * (count + 0.6)), layout="constrained")
        axes = figure.subplots()
        for index, (label, values) in enumerate(groups.items()):
            places = np.arange(len(names)) + 0.8 * ((index + 0.5) / count - 0.5)
            axes.barh(places, values, 0.8 / count, label=label, color=COLOURS[index % len(COLOURS)])
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(across)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    return figure


@dataclass(frozen=True)
class Span:
    """A value with its interval and its search range."""

    name: str
    text: str
    value: float
    interval: tuple[float, float]
    range: tuple[float, float]


def spans(rows: Sequence[Span]) -> Figure:
    """Return a figure with values and intervals within their search ranges."""
    with mpl.rc_context(_SETTINGS):
        figure = Picture(figsize=(_WIDTH, 0.7 + 0.45 * len(rows)), layout="constrained")
        axes = figure.subplots()
        for place, row in enumerate(rows):
            low, high = row.range
            value, *ends = (np.array([row.value, *row.interval]) - low) / (high - low)
            left, right = np.clip(np.sort(ends), -0.05, 1.05)
            axes.plot([0.0, 1.0], [place, place], color="#e3e6ea", lw=6.0, solid_capstyle="butt")
            axes.plot([left, right], [place, place], color=AFTER, lw=6.0, alpha=0.35, solid_capstyle="butt")
            axes.plot(np.clip(value, -0.05, 1.05), place, "o", color=AFTER, ms=5.0)
            axes.text(1.08, place, row.text, va="center")
        axes.set_yticks(range(len(rows)), [row.name for row in rows])
        axes.set_xticks([0.0, 1.0], ["lower bound", "upper bound"])
        axes.set_xlim(-0.08, 1.9)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0.0)
    return figure
