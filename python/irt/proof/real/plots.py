"""Pictures of a proof on a real rig: the tilt over time, and intervals, predicted and measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from irt.files import PathLike
from irt.proof.real.response import QUANTITIES, Comparison, Estimate
from irt.proof.real.run import Run
from irt.report import style

_MILLI = 1000.0
#: Lines of a picture over time: key of the model, label, colour.
_LINES = (("tuned", "no effects", style.UNTUNED), ("diagnosed", "diagnosed", style.TUNED))


def plot_tilt(path: PathLike, run: Run) -> None:
    """Draw the measured tilt of a recording as dots and the predicted ones as lines, over time.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    recording = run.predictions["tuned"].recording
    assert recording.stamps is not None, recording.name
    time = recording.stamps - recording.stamps[0]
    with style.drawing(path, style.WIDTH, 3.5) as figure:
        both = figure.subplots(2, sharex=True)
        for axis, axes in enumerate(both):
            measured = _MILLI * run.predictions["tuned"].measured[:, axis]
            axes.plot(time, measured, ".", color=style.RECORDED, clip_on=False)
            ends = [(_last(measured), "measured", style.RECORDED)]
            for key, label, colour in _LINES:
                line = _MILLI * run.predictions[key].tilt[:, axis]
                line = line + np.nanmean(measured - line)
                axes.plot(time, line, color=colour, zorder=3)
                ends.append((_last(line), label, colour))
            axes.set_ylabel(f"tilt about {'xy'[axis]}  [mrad]")
            axes.yaxis.set_major_locator(MaxNLocator(5))
            style.label_ends(axes, ends)
        both[0].set_xlim(time[0], time[-1])
        both[1].set_xlabel("time  [s]")


def plot_intervals(path: PathLike, comparisons: Sequence[Comparison]) -> None:
    """Draw each quantity about both axes: the interval of the diagnosis above the measured one.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with style.drawing(path, style.WIDTH, 5.2) as figure:
        panels = figure.subplots(3, 2).ravel()
        for axes, known in zip(panels, QUANTITIES, strict=True):
            both = [one for one in comparisons if one.quantity.name == known.name]
            quantity = both[0].quantity
            scale = _MILLI if quantity.unit == "rad" else 1.0
            unit = "mrad" if quantity.unit == "rad" else quantity.unit
            for place, one in enumerate(both):
                _draw(axes, one.predicted, place - 0.14, scale, style.TUNED)
                _draw(axes, one.measured, place + 0.14, scale, style.RECORDED)
            axes.set_yticks([0, 1], ["x", "y"])
            axes.set_ylim(1.5, -0.5)
            axes.xaxis.set_major_locator(MaxNLocator(4))
            axes.grid(visible=False, axis="y")
            axes.set_title(f"{quantity.title}{f'  [{unit}]' if unit else ''}")
        figure.legend(
            handles=[
                Line2D([], [], color=style.TUNED, marker="o", ms=4.5, lw=2.2, label="predicted"),
                Line2D([], [], color=style.RECORDED, marker="o", ms=4.5, lw=2.2, label="measured"),
            ],
            loc="outside upper left",
            ncols=2,
            frameon=False,
        )


def _draw(axes: Any, one: Estimate, place: float, scale: float, colour: str) -> None:
    if one.has_interval:
        axes.plot([scale * one.low, scale * one.high], [place, place], color=colour, lw=2.2)
    axes.plot(scale * one.value, place, "o", color=colour, ms=4.5)


def _last(line: np.ndarray) -> float:
    """Return the last finite number of a line."""
    return float(line[np.isfinite(line)][-1])
