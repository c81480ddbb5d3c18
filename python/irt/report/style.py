"""Colours, fonts and file output of all plots."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from irt.errors import IrtError
from irt.files import PathLike, write_atomic

# Each colour has one role and all values differ: pages replace each value in an SVG by a CSS variable, so
# that one picture serves light and dark pages. The line colours are from Okabe and Ito's colour-blind-safe
# palette.
PAPER = "#ffffff"
INK = "#1b1f24"
MUTED = "#6e7781"
FAINT = "#e3e6ea"
RECORDED = "#57606a"
UNTUNED = "#d55e00"
TUNED = "#0072b2"
SECOND = "#009e73"
THIRD = "#cc79a7"
#: Sequential map of cells, from least to most: cream to violet; reversed on dark pages.
HEAT = ("#fdebac", "#feb67c", "#fa7d5e", "#e24d66", "#b5367a", "#842681", "#57157e", "#251255")
#: Diverging map from most negative to most positive: blue, pale, orange; dark pages use dark for pale.
DIVERGING = ("#0b4f7d", "#3a86b4", "#86bcd8", "#cfe4f0", "#fbe0cc", "#f2ab7c", "#d8692b", "#8f3a06")
COLOURS = {
    "paper": PAPER,
    "ink": INK,
    "muted": MUTED,
    "faint": FAINT,
    "recorded": RECORDED,
    "untuned": UNTUNED,
    "tuned": TUNED,
    "second": SECOND,
    "third": THIRD,
    **{f"heat{letter}": colour for letter, colour in zip("abcdefgh", HEAT, strict=True)},
    **{f"sign{letter}": colour for letter, colour in zip("abcdefgh", DIVERGING, strict=True)},
}

#: Width of a plot [inches], readable on a phone without zooming.
WIDTH = 4.7

_FONT_SIZE = 9.0
#: Pixels per inch of a PNG, and of cells inside an SVG.
_PNG_DPI = 200.0

_SETTINGS: Any = {
    "font.family": "sans-serif",
    "font.size": _FONT_SIZE,
    "axes.titlesize": _FONT_SIZE,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelsize": _FONT_SIZE,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.major.size": 0.0,
    "ytick.major.size": 0.0,
    "ytick.minor.size": 0.0,
    "text.color": INK,
    # File names may contain dollar signs.
    "text.parse_math": False,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "lines.markersize": 3.2,
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "savefig.dpi": _PNG_DPI,
    # Text stays text, so that it can be searched, read aloud, and set in the page's font.
    "svg.fonttype": "none",
}

#: For each suffix the canvas, its dots per inch (an SVG is in points), and metadata without date and program.
_KINDS: dict[str, tuple[Any, float, dict[str, None]]] = {
    "svg": (FigureCanvasSVG, 72.0, {"Date": None, "Creator": None}),
    "png": (FigureCanvasAgg, _PNG_DPI, {"Software": None}),
}


@contextmanager
def drawing(path: PathLike, width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure, and write it to ``path`` when the block ends.

    matplotlib's global state is restored, and no display is needed. The same drawing gives the same bytes.

    Parameters
    ----------
    path : path
        Ends in ``.svg`` or ``.png``; replaced atomically.
    width, height : float
        Size [inches].

    Raises
    ------
    IrtError
        If the suffix is unknown, or the file cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _KINDS:
        raise IrtError(f"{path}: pictures are written as .svg or .png")
    # The salt makes the ids inside an SVG depend on its name, instead of a random number.
    canvas, dots_per_inch, metadata = _KINDS[kind]
    with mpl.rc_context({**_SETTINGS, "svg.hashsalt": path.stem}):
        figure = Figure(figsize=(width, height), dpi=dots_per_inch, layout="constrained")
        canvas(figure)
        yield figure
        # With a layout engine, savefig draws everything once more than needed.
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
        figure.set_layout_engine(None)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=kind, metadata=metadata)
    write_atomic(path, buffer.getvalue())


def label_ends(axes: Any, labels: Sequence[tuple[float, str, str]]) -> None:
    """Label each line to the right of the axes, at the height of its end, without overlap.

    Call when the limits of the axes are final.

    Parameters
    ----------
    axes : matplotlib Axes
        Axes of the lines.
    labels : sequence of (height, text, colour)
        Height in data coordinates.
    """
    axes.autoscale_view()
    to_axes = axes.transScale + axes.transLimits
    ends = sorted((float(to_axes.transform((1.0, place))[1]), text, colour) for place, text, colour in labels)
    inches = axes.get_position().height * axes.figure.get_figheight()
    line = 1.25 * _FONT_SIZE / 72 / inches
    sizes = [line * (1 + text.count("\n")) for _, text, _ in ends]
    centres = spread([height for height, _, _ in ends], sizes)
    for centre, (_, text, colour) in zip(centres, ends, strict=True):
        axes.text(1.015, centre, text, color=colour, transform=axes.transAxes, va="center", ha="left")


def shortened(name: str, most: int) -> str:
    """Return a name of at most `most` letters, shortened in the middle because names differ at their ends."""
    if len(name) <= most:
        return name
    half = (most - 1) // 2
    return f"{name[:half]}…{name[-half:]}"


def spread(heights: Sequence[float], sizes: Sequence[float]) -> list[float]:
    """Return centres for labels of these sizes, as near to the heights as possible without overlap.

    Parameters
    ----------
    heights : sequence of float
        Wanted centres of the labels, in ascending order.
    sizes : sequence of float
        Height of each label, in the same unit.
    """
    blocks: list[tuple[float, float, int]] = []  # centre, size, number of labels
    for height, size in zip(heights, sizes, strict=True):
        block = (height, size, 1)
        while blocks and blocks[-1][0] + blocks[-1][1] / 2 > block[0] - block[1] / 2:
            centre, below, count = blocks.pop()
            total = count + block[2]
            block = ((centre * count + block[0] * block[2]) / total, below + block[1], total)
        blocks.append(block)
    centres = []
    remaining = iter(sizes)
    for centre, size, count in blocks:
        bottom = centre - size / 2
        for _ in range(count):
            own = next(remaining)
            centres.append(bottom + own / 2)
            bottom += own
    return centres
