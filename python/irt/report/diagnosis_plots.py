"""Plots of a diagnosis: paths before and after, errors over the board and over time, ranked hypotheses."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from irt.diagnosis.result import Candidate, Diagnosis, NeededPush, RunProof
from irt.files import PathLike
from irt.fitting.robust import mean_absolute
from irt.model import Model
from irt.pictures import make_logarithmic
from irt.report import style
from irt.report.plots import FLOOR, PERCENT, TICKS, draw_rim, rim_of
from irt.report.words import together

Array = NDArray[np.float64]

#: Two-sided 95 % of a normal distribution, in standard deviations.
_BAND = 1.96
#: Most dots, and most vertices of a line; more would only enlarge the file.
_MOST_DOTS = 300
_MOST_CORNERS = 800
#: Bins of an error line over time.
_BINS = 80
#: Cells of the map along the long edge.
_CELLS = 14
#: Bounds of the map's colours, in multiples of the tracker noise.
_LEVELS = (0.0, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0)
#: The evidence axis is linear up to this value and logarithmic beyond [nats].
_LINEAR = 10.0
#: A logarithmic axis of this span has enough ticks at the powers of ten.
_MANY_TICKS = 20.0
#: Most letters of a panel's title.
_TITLE = 48
#: Most letters above a bar, and the least of an outcome that are worth showing.
_LINE, _SHORTEST = 62, 14


@dataclass(frozen=True)
class Side:
    """One of the two simulators that a diagnosis compares.

    Attributes
    ----------
    label : str
        Label of its lines.
    colour : str
        One of `irt.report.style`.
    which : {"base", "final"}
        Which prediction of a `RunProof` it is.
    """

    label: str
    colour: str
    which: Literal["base", "final"]

    def marble(self, run: RunProof) -> Array:
        """Return the predicted positions, (n, 2) [board edges]."""
        return run.base if self.which == "base" else run.final

    def residual(self, run: RunProof) -> Array:
        """Return predicted minus observed positions, (n, 2) [board edges]."""
        return self.marble(run) - run.observed

    def push(self, one: NeededPush) -> tuple[Array, Array]:
        """Return the push that the simulator lacks, and its standard deviation, (n, 2) each [m/s^2]."""
        is_base = self.which == "base"
        return (one.base, one.base_deviation) if is_base else (one.final, one.final_deviation)

    def mae(self, run: RunProof) -> float:
        """Return the mean absolute error [board edges]."""
        return run.base_mae if self.which == "base" else run.final_mae


def sides(diagnosis: Diagnosis) -> tuple[Side, ...]:
    """Return the simulators to compare; without added effects there is only one."""
    if not diagnosis.effects:
        return (Side("simulated", style.TUNED, "base"),)
    return Side("before", style.UNTUNED, "base"), Side("after", style.TUNED, "final")


def plot_board(path: PathLike, run: RunProof, model: Model, shown: Sequence[Side]) -> None:
    """Draw one run from above: recorded dots, predicted paths, the rim.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    run : RunProof
        Recorded and predicted positions.
    model : Model
        Gives the observed position of the rim.
    shown : sequence of Side
        Simulators whose paths are drawn, in this order.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with style.drawing(path, 3.9, 3.4) as figure:
        axes: Any = figure.subplots()
        draw_rim(axes, model)
        dots = run.observed[thinned(len(run.times), _MOST_DOTS)]
        axes.plot(*dots.T, ".", color=style.RECORDED)
        corners = thinned(len(run.times), _MOST_CORNERS)
        for number, side in enumerate(shown):
            axes.plot(*side.marble(run)[corners].T, color=side.colour, zorder=3 + number)
            title = {"loc": "left"} if number == 0 else {"loc": "center"}
            axes.set_title(side.label, color=side.colour, fontweight="bold", **title)
        axes.set_title("• recorded", color=style.RECORDED, loc="right")
        seen = run.observed[np.isfinite(run.observed).all(axis=1)]
        if len(seen):
            axes.plot(*seen[0], "o", color=style.INK, ms=6, mfc=style.PAPER, zorder=6)
            # On the side away from the path.
            up = seen[0, 1] >= seen[:, 1].mean()
            place = {"xytext": (0, 7 if up else -7), "va": "bottom" if up else "top", "zorder": 6}
            axes.annotate("start", seen[0], textcoords="offset points", ha="center", **place)
        half = 1.015 * rim_of(model)
        axes.set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]), xticks=TICKS, yticks=TICKS)
        axes.set(xlabel="x  [edges]", ylabel="y  [edges]", aspect="equal")
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)


def plot_over_time(
    path: PathLike, run: RunProof, side: Side, noise: float, *, limit: float, stamped: bool = True
) -> None:
    """Draw x and y of one run over time, recorded and predicted, and the residuals.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    run : RunProof
        Recorded and predicted positions.
    side : Side
        Simulator whose prediction is drawn.
    noise : float
        Standard deviation of the tracker [board edges]; the band holds 95 % of a perfect model's residuals.
    limit : float
        The axes of the positions reach from ``-limit`` to ``limit`` [board edges].
    stamped : bool
        Whether the time axis is in seconds; otherwise it is in rows.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    dots, corners = thinned(len(run.times), _MOST_DOTS), thinned(len(run.times), _MOST_CORNERS)
    times, unit = time_axis(run, stamped=stamped)
    marble, off = side.marble(run), PERCENT * side.residual(run)
    with style.drawing(path, style.WIDTH, 5.2) as figure:
        panels = figure.subplots(4, sharex=True, height_ratios=(2, 1, 2, 1))
        for axis, (axes, below) in enumerate(zip(panels[::2], panels[1::2], strict=True)):
            axes.plot(times[dots], run.observed[dots, axis], ".", color=style.RECORDED)
            axes.plot(times[corners], marble[corners, axis], color=side.colour, zorder=3)
            axes.set(ylabel=f"{'xy'[axis]}  [edges]", ylim=(-limit, limit))
            axes.yaxis.set_major_locator(MaxNLocator(5, symmetric=True))
            band = PERCENT * _BAND * noise
            below.axhspan(-band, band, color=style.FAINT, lw=0)
            below.plot(times[corners], off[corners, axis], color=side.colour, lw=1.0)
            below.set_ylabel("residual  [%]")
            below.yaxis.set_major_locator(MaxNLocator(3, symmetric=True))
        panels[0].set_title(side.label, color=side.colour, fontweight="bold")
        panels[0].set_title("• recorded", color=style.RECORDED, loc="right")
        panels[-1].set(xlabel=unit, xlim=(times[0], times[-1]))
        figure.align_ylabels(panels)


def plot_push(
    path: PathLike, push: NeededPush, shown: Sequence[Side], rows_s: Sequence[float], *, stamped: bool
) -> None:
    """Draw the push missing in the simulator over time, with 95 % bands.

    `path`, `stamped` and errors as in `plot_over_time`.

    Parameters
    ----------
    push : NeededPush
        The push of a recording.
    shown : sequence of Side
        The simulators, in this order.
    rows_s : sequence of float
        Duration of a row in each simulator [s]; without stamps pushes are in millimetres per row squared.
    """
    corners = thinned(len(push.times), _MOST_CORNERS)
    times, label = time_axis(push, stamped=stamped)
    unit = "m/s²" if stamped else "mm/row²"
    with style.drawing(path, style.WIDTH, 3.6) as figure:
        panels = figure.subplots(2, sharex=True)
        for axis, axes in enumerate(panels):
            axes.axhline(0.0, color=style.MUTED, lw=0.6)
            for side, row_s in zip(shown, rows_s, strict=True):
                size = 1.0 if stamped else 1000.0 * row_s**2
                mean, deviation = (size * each[corners, axis] for each in side.push(push))
                band = _BAND * deviation
                axes.fill_between(
                    times[corners], mean - band, mean + band, color=side.colour, alpha=0.2, lw=0
                )
                axes.plot(times[corners], mean, color=side.colour, lw=1.2)
            axes.set_ylabel(f"push along {'xy'[axis]}\n[{unit}]")
            axes.yaxis.set_major_locator(MaxNLocator(5, symmetric=True))
        for side, place in zip(shown, ("left", "right"), strict=False):
            panels[0].set_title(side.label, color=side.colour, fontweight="bold", loc=place)
        panels[-1].set(xlabel=label, xlim=(times[0], times[-1]))
        figure.align_ylabels(panels)


def time_axis(run: RunProof | NeededPush, *, stamped: bool) -> tuple[Array, str]:
    """Return the time axis of a run, (n,), and its label: seconds if there are stamps, else rows."""
    return (run.times, "time  [s]") if stamped else (np.arange(len(run.times), dtype=np.float64), "row")


def plot_map(path: PathLike, runs: Sequence[RunProof], model: Model, side: Side, noise: float) -> None:
    """Draw the RMS error in each cell of the board, in multiples of the tracker noise.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    runs : sequence of RunProof
        Recorded and predicted positions.
    model : Model
        Gives the observed position of the rim.
    side : Side
        Simulator whose predictions are drawn.
    noise : float
        Standard deviation of the tracker [board edges]; all cells of a perfect model are at 1.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    rim = rim_of(model)
    across = max(1, round(_CELLS * rim[1] / rim[0]))
    edges = [np.linspace(-rim[0], rim[0], _CELLS + 1), np.linspace(-rim[1], rim[1], across + 1)]
    with style.drawing(path, 3.9, 3.9) as figure:
        axes = figure.subplots()
        cells = axes.pcolormesh(
            *edges,
            cell_means(runs, side, edges, noise).T,
            norm=BoundaryNorm(_LEVELS, len(style.HEAT), extend="max"),
            cmap=ListedColormap(style.HEAT),
            edgecolors=style.PAPER,
            linewidth=0.6,
        )
        draw_rim(axes, model)
        axes.set_title(side.label, color=side.colour, fontweight="bold")
        axes.set(xticks=TICKS, yticks=TICKS, xlabel="x  [edges]", ylabel="y  [edges]", aspect="equal")
        axes.set(xlim=1.015 * rim[0] * np.array([-1, 1]), ylim=1.015 * rim[1] * np.array([-1, 1]))
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        bar = figure.colorbar(cells, orientation="horizontal", aspect=28, spacing="uniform", ticks=_LEVELS)
        bar.set_label("error, in multiples of the tracker noise")
        bar.ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.outline.set_visible(False)


def cell_means(runs: Sequence[RunProof], side: Side, edges: Sequence[Array], noise: float) -> Array:
    """Return the RMS of the residuals in each cell of the board, in multiples of the noise.

    Parameters
    ----------
    runs : sequence of RunProof
        Recorded and predicted positions.
    side : Side
        Simulator whose predictions are evaluated.
    edges : (a + 1,) and (b + 1,) array
        Bounds of the cells along x and y [board edges].
    noise : float
        Standard deviation of the tracker [board edges].

    Returns
    -------
    (a, b) masked array
        Cells without an observation are masked.
    """
    places = np.concatenate([run.observed for run in runs])
    squares = np.concatenate([(side.residual(run) ** 2).mean(axis=1) for run in runs])
    known = np.isfinite(squares)
    x, y = places[known].T
    count, _, _ = np.histogram2d(x, y, bins=edges)
    total, _, _ = np.histogram2d(x, y, bins=edges, weights=squares[known])
    return np.ma.masked_array(np.sqrt(total / np.maximum(count, 1.0)) / noise, mask=count == 0)


def plot_errors(
    path: PathLike,
    runs: Sequence[RunProof],
    shown: Sequence[Side],
    noise: float,
    *,
    top: float,
    stamped: bool = True,
) -> None:
    """Draw the prediction error over time, one panel per run, on a shared logarithmic scale.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    runs : sequence of RunProof
        Recorded and predicted positions.
    shown : sequence of Side
        Simulators whose errors are drawn.
    noise : float
        Standard deviation of the tracker [board edges].
    top : float
        Upper end of the axes [% of the edge], so that several figures can be compared.
    stamped : bool
        Whether the time axes are in seconds; otherwise they are in rows.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    floor = PERCENT * mean_absolute(noise)
    with style.drawing(path, style.WIDTH, 0.6 + 1.25 * len(runs)) as figure:
        panels = figure.subplots(len(runs), squeeze=False, sharey=True)[:, 0]
        for axes, run in zip(panels, runs, strict=True):
            times, unit = time_axis(run, stamped=stamped)
            make_logarithmic(axes)
            axes.axhline(floor, **FLOOR)
            for side in shown:
                axes.plot(*binned_error(run, side, times), color=side.colour)
            axes.set_xlim(times[0], times[-1])
            axes.set_title(style.shortened(run.recording, _TITLE))
            axes.set_ylim(floor / 3, top)
            if top > _MANY_TICKS * floor:
                axes.yaxis.set_major_locator(LogLocator(numticks=5))
            _label_ends(axes, run, shown, floor)
        panels[-1].set_xlabel(unit)
        figure.supylabel("mean error  [% of edge]", color=style.MUTED, fontsize="medium")


def binned_error(run: RunProof, side: Side, times: Array | None = None) -> tuple[Array, Array]:
    """Return the error averaged over x, y and bins of rows: (m,) times and errors [% of the edge].

    `times` has shape (n,); the default is the run's own times [s]. Binning is needed because single rows of a
    good model come arbitrarily close to zero, which a logarithmic scale would exaggerate.
    """
    error = PERCENT * np.abs(side.residual(run)).mean(axis=1)
    parts = np.array_split(np.arange(len(error)), min(_BINS, max(1, len(error) // 3)))
    means = [_mean(error[part]) for part in parts]
    times = run.times if times is None else times
    return np.array([times[part].mean() for part in parts]), np.array(means)


def highest_error(runs: Sequence[RunProof], shown: Sequence[Side]) -> float:
    """Return the highest point of all lines of `plot_errors` [% of the edge], 0 without observations."""
    lines = [binned_error(run, side)[1] for run in runs for side in shown]
    return float(np.nanmax(np.concatenate(lines), initial=0.0))


def plot_ranking(
    path: PathLike,
    candidates: Sequence[Candidate],
    answer: frozenset[str],
    ties: Collection[frozenset[str]],
    *,
    span: tuple[float, float],
) -> None:
    """Draw the log evidence of hypotheses over the base model as bars: gain minus penalty.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    candidates : sequence of Candidate
        From top to bottom.
    answer : set of names
        The reported hypothesis.
    ties : collection of sets of names
        Hypotheses that explain the recordings as well.
    span : (float, float)
        Smallest and largest evidence on the axis, so that several figures can be compared.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    count = len(candidates)
    with style.drawing(path, style.WIDTH, 0.6 + 0.4 * count) as figure:
        axes = figure.subplots()
        for place, one in enumerate(candidates):
            tied = frozenset(one.effects) in ties
            colour = style.TUNED if tied or frozenset(one.effects) == answer else style.MUTED
            # A tie is hollow, to distinguish it from the answer.
            look = {"fc": style.PAPER, "ec": colour, "lw": 1.2} if tied else {"color": colour}
            axes.barh(place, evidence_for(one), height=0.34, **look)
            _label_bar(axes, place, one, colour)
        _make_symmetric_log(axes, *span)
        axes.vlines(
            np.zeros(count), np.arange(count) - 0.25, np.arange(count) + 0.25, color=style.INK, lw=0.9
        )
        axes.set(ylim=(count - 0.6, -0.85), yticks=[], xlabel="log evidence over the base model  [nats]")
        axes.spines["left"].set_visible(False)


def _label_bar(axes: Any, place: int, one: Candidate, colour: str) -> None:
    """Label a bar with its hypothesis, outcome and evidence."""
    look = {"textcoords": "offset points", "va": "bottom", "xycoords": axes.get_yaxis_transform()}
    evidence = f"{evidence_for(one):+z,.0f}".replace("-", "\N{MINUS SIGN}")
    name = style.shortened(together(one.effects), _LINE - len(evidence) - 3)
    room = _LINE - len(name) - len(evidence) - 3
    outcome = textwrap.shorten(one.outcome, room, placeholder=" …") if room >= _SHORTEST else ""
    axes.annotate(name, (0, place), xytext=(0, 6), color=colour, **look)
    words = f"{outcome}   {evidence}".strip()
    axes.annotate(words, (1, place), xytext=(0, 6), ha="right", color=style.INK, **look)


def evidence_for(one: Candidate) -> float:
    """Return the log evidence of a hypothesis over the base model (log posterior odds)."""
    return one.gain - one.penalty


def thinned(count: int, most: int) -> NDArray[np.int64]:
    """Return at most `most` of `count` row numbers, evenly spaced, with the first and the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def _make_symmetric_log(axes: Any, least: float, most: float) -> None:
    """Make the x axis linear near zero and logarithmic beyond, with plain numbers."""
    axes.set_xscale("symlog", linthresh=_LINEAR, linscale=0.6)
    low, high = min(0.0, least), max(_LINEAR, most)
    ticks = [0.0, *(sign * 10.0**power for power in range(1, 9) for sign in (-1, 1))]
    axes.set_xlim(1.15 * low, 1.15 * high)
    axes.xaxis.set_major_locator(FixedLocator([tick for tick in ticks if 1.15 * low <= tick <= 1.15 * high]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))


def _label_ends(axes: Any, run: RunProof, shown: Sequence[Side], floor: float) -> None:
    """Name the lines of a panel of `plot_errors`."""
    ends = [(floor, "noise", style.INK)]
    for side in shown:
        _, errors = binned_error(run, side)
        if np.isfinite(errors).any():
            # A logarithmic axis has no place for zero.
            last = max(float(errors[np.isfinite(errors)][-1]), floor / 3.0)
            ends.append((last, side.label, side.colour))
    style.label_ends(axes, ends)


def _mean(values: Array) -> float:
    """Return the mean of the finite values, NaN if there are none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
