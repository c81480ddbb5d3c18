"""Plots of fits, paths, evaluations and training; each function writes one SVG or PNG file.

Positions are in units of the board's long edge and errors in percent of it, as in the paper's figures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.patches import BoxStyle, Circle, FancyBboxPatch, Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from numpy.typing import ArrayLike, NDArray

from irt.files import PathLike
from irt.fitting.fit import FitResult
from irt.fitting.robust import mean_absolute
from irt.maze import Maze
from irt.model import Model
from irt.pictures import make_logarithmic
from irt.recording import Recording
from irt.report import style
from irt.residual import Evaluation
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

PERCENT = 100.0
FLOOR: dict[str, Any] = {"color": style.INK, "lw": 0.9, "ls": (0, (4, 3))}
TICKS = (-0.4, -0.2, 0.0, 0.2, 0.4)
_ERROR = "mean error  [% of edge]"
#: Methods whose history has an entry for each rollout.
_BY_ROLLOUT = ("irt+", "cma-es", "es", "direct")


@dataclass(frozen=True, eq=False)
class Prediction:
    """A model's prediction of a recording, with its label and colour.

    Attributes
    ----------
    label : str
        Label of the line, one or two words.
    marble : (n, 2) array
        Predicted positions [board edges], one for each row of the recording.
    model : Model
        The predicting model.
    colour : str
        One of `irt.report.style`.
    window_rows : (w,) int array
        First rows of windows, where the prediction restarts and the line breaks.
    """

    label: str
    marble: Array
    model: Model
    colour: str = style.TUNED
    window_rows: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def pieces(self) -> list[NDArray[np.int64]]:
        """Rows of each continuous piece of the prediction."""
        return np.split(np.arange(len(self.marble)), self.window_rows)


def plot_fit(
    path: PathLike, recording: Recording, predictions: Sequence[Prediction], *, limit: float | None = None
) -> None:
    """Draw recorded positions as dots, predicted ones as lines, over time (paper, Figs. 3 and 7).

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    recording : Recording
        Rows without a marble are shaded.
    predictions : sequence of Prediction
        Drawn in this order.
    limit : float, optional
        Both axes reach from ``-limit`` to ``limit`` [board edges], so that figures can be compared; by
        default each axis fits its data.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    time, unit = _time(recording)
    with style.drawing(path, style.WIDTH, 3.5) as figure:
        both = figure.subplots(2, sharex=True)
        for axis, axes in enumerate(both):
            axes.plot(time, recording.marble[:, axis], ".", color=style.RECORDED, clip_on=False)
            for prediction in predictions:
                for rows in prediction.pieces:
                    axes.plot(time[rows], prediction.marble[rows, axis], color=prediction.colour, zorder=3)
            for first, last in _lost(recording):
                axes.axvspan(first, last, color=style.FAINT, lw=0)
            axes.set_ylabel(f"{'xy'[axis]}  [edges]")
            if limit is not None:
                axes.set_ylim(-limit, limit)
            axes.yaxis.set_major_locator(MaxNLocator(5, symmetric=limit is not None))
            ends = [(_last(recording.marble[:, axis]), "recorded", style.RECORDED)]
            ends += [(_last(p.marble[:, axis]), p.label, p.colour) for p in predictions]
            style.label_ends(axes, ends)
        both[0].set_xlim(time[0], time[-1])
        both[1].set_xlabel(unit)


def plot_tilt(path: PathLike, recording: Recording, predicted: Array) -> None:
    """Draw the measured tilt as dots and the tilt predicted from commands as lines, over time.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    recording : Recording
        A recording with a measured tilt.
    predicted : (n, 2) array
        Predicted angles about x and y [rad], one for each row of the recording.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    assert recording.tilt is not None, recording.name
    time, unit = _time(recording)
    with style.drawing(path, style.WIDTH, 3.5) as figure:
        both = figure.subplots(2, sharex=True)
        for axis, axes in enumerate(both):
            measured, line = 1000.0 * recording.tilt[:, axis], 1000.0 * predicted[:, axis]
            axes.plot(time, measured, ".", color=style.RECORDED, clip_on=False)
            axes.plot(time, line, color=style.TUNED, zorder=3)
            axes.set_ylabel(f"tilt about {'xy'[axis]}  [mrad]")
            axes.yaxis.set_major_locator(MaxNLocator(5))
            ends = [(_last(line), "predicted", style.TUNED)]
            if np.isfinite(measured).any():
                ends.insert(0, (_last(measured), "measured", style.RECORDED))
            style.label_ends(axes, ends)
        both[0].set_xlim(time[0], time[-1])
        both[1].set_xlabel(unit)


def plot_paths(path: PathLike, panels: Sequence[tuple[Recording, Prediction]]) -> None:
    """Draw the board from above, two panels to a row: recorded dots, the predicted path, and the rim.

    The rim is drawn at its observed position, scaled by the model's observation scale.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    panels : sequence of (Recording, Prediction)
        Content of each panel, row by row.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    with style.drawing(path, 3.6 * columns + 0.3, 3.2 * rows + 0.3) as figure:
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        figure.set_layout_engine("constrained", wspace=0.06, hspace=0.04)
        for axes in grid.flat[len(panels) :]:
            axes.set_axis_off()
        for axes, (recording, prediction) in zip(grid.flat, panels, strict=False):
            _draw_path(axes, recording, prediction)
        half = 1.015 * np.max([rim_of(prediction.model) for _, prediction in panels], axis=0)
        grid[0, 0].set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]), xticks=TICKS, yticks=TICKS)
        for axes in grid[-1]:
            axes.set_xlabel("x  [edges]")
        for axes in grid[:, 0]:
            axes.set_ylabel("y  [edges]")


def plot_history(path: PathLike, result: FitResult, *, noise: float | None = None) -> None:
    """Draw the error over the iterations of a fit, from every start point (paper, Figs. 5 and 8).

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    result : FitResult
        Its first estimate, which the model comes from, is highlighted.
    noise : float, optional
        Standard deviation of the tracker [board edges]; draws the noise floor.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with style.drawing(path, style.WIDTH, 3.1) as figure:
        axes = figure.subplots()
        # Iteration 0 is the start point; rollouts count from 1.
        first = int(result.method in _BY_ROLLOUT)
        for estimate in reversed(result.estimates):
            errors = PERCENT * np.array([iteration.mae for iteration in estimate.history])
            won = estimate is result.estimates[0]
            count = first + np.arange(len(errors))
            axes.plot(count, errors, color=style.TUNED if won else style.MUTED, **_weight(won))
        best = result.estimates[0].best
        place = (first + _index(result.estimates[0].history, best), PERCENT * best.mae)
        axes.plot(*place, "o", color=style.TUNED, ms=6, mfc=style.PAPER, zorder=4)
        make_logarithmic(axes)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("rollout" if first else "iteration")
        axes.set_ylabel(_ERROR)
        axes.margins(x=0.02)
        name = "best start" if len(result.estimates) > 1 else ""
        ends = [(PERCENT * result.history[-1].mae, name, style.TUNED)]
        if noise is not None:
            floor = PERCENT * mean_absolute(noise)
            axes.axhline(floor, **FLOOR)
            axes.set_ylim(bottom=floor / 1.6)
            ends.append((floor, "tracker\nnoise", style.INK))
        style.label_ends(axes, ends)


def plot_parameters(path: PathLike, result: FitResult) -> None:
    """Draw each parameter over the iterations of a fit, from every start point (paper, Fig. 6).

    Each axis spans the search range; the band is the 95 % interval of the final value.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    result : FitResult
        Its first estimate, which the model comes from, is highlighted.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with style.drawing(path, style.WIDTH, 5.6) as figure:
        panels = figure.subplots(len(PARAMETERS), sharex=True)
        for index, (name, axes) in enumerate(zip(PARAMETERS, panels, strict=True)):
            for estimate in reversed(result.estimates):
                values = [iteration.parameters[index] for iteration in estimate.history]
                won = estimate is result.estimates[0]
                axes.plot(values, color=style.TUNED if won else style.MUTED, **_weight(won))
            fitted = result.model.parameters[name]
            if fitted.low is not None and fitted.high is not None:
                axes.axhspan(fitted.low, fitted.high, color=style.TUNED, alpha=0.18, lw=0)
            low, high = result.model.ranges[name]
            axes.set_ylim(min(low, fitted.value), max(high, fitted.value))
            axes.yaxis.set_major_locator(MaxNLocator(3))
            axes.set_title(name.replace("_", " "))
        panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
        panels[-1].set_xlabel("iteration")
        panels[-1].margins(x=0.0)


def plot_evaluation(
    path: PathLike, evaluation: Evaluation, recordings: Sequence[Recording], *, noise: float | None = None
) -> None:
    """Draw a model's error over time, one panel per recording: in a free run and in windows.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    evaluation : Evaluation
        The result of `irt.residual.evaluate` for these recordings.
    recordings : sequence of Recording
        The evaluated recordings.
    noise : float, optional
        Standard deviation of the tracker [board edges]; draws the noise floor.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with style.drawing(path, style.WIDTH, 0.5 + 1.5 * len(recordings)) as figure:
        panels = figure.subplots(len(recordings), squeeze=False, sharey=True)[:, 0]
        for axes, recording, run in zip(panels, recordings, evaluation.runs, strict=True):
            time, unit = _time(recording)
            free = _distance(recording, run.free_prediction)
            windowed = _distance(recording, run.windowed_prediction)
            axes.plot(time, free, color=style.TUNED)
            for rows in np.split(np.arange(len(time)), run.window_rows):
                axes.plot(time[rows], windowed[rows], color=style.SECOND)
            axes.set_xlim(time[0], time[-1])
            name = style.shortened(recording.name, 40)
            axes.set_title(name if run.free_run is not None else f"{name}: no marble")
            ends = [] if run.free_run is None else [(_last(free), "free run", style.TUNED)]
            if run.windowed is not None:
                ends.append((_last(windowed), evaluation.windows.replace(" of ", " of\n"), style.SECOND))
            if noise is not None:
                floor = PERCENT * mean_absolute(noise)
                axes.axhline(floor, **FLOOR)
                ends.append((floor, "tracker noise", style.INK))
            axes.set_ylim(bottom=0.0)
            style.label_ends(axes, ends)
        panels[-1].set_xlabel(unit)
        figure.supylabel(_ERROR, color=style.MUTED, fontsize="medium")


def plot_loss(path: PathLike, training: ArrayLike, heldout: ArrayLike) -> None:
    """Draw the loss of a network over the training epochs.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    training, heldout : (epochs,) array
        Mean squared error of the normalised parameter difference, on training and held-out pairs.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with style.drawing(path, style.WIDTH, 3.1) as figure:
        axes = figure.subplots()
        ends = []
        for name, losses, colour in (("training", training, style.MUTED), ("held out", heldout, style.TUNED)):
            values = np.asarray(losses, dtype=np.float64)
            axes.plot(np.arange(1, len(values) + 1), values, color=colour)
            ends.append((float(values[-1]), name, colour))
        make_logarithmic(axes)
        axes.set_xlabel("epoch")
        axes.set_ylabel("mean squared error")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        style.label_ends(axes, ends)


def plot_likelihood(path: PathLike, losses: ArrayLike) -> None:
    """Draw the loss of an IRT+ network over the training pools.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    losses : (pools,) array
        Mean negative log-likelihood of the coordinates [nats].

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    values = np.asarray(losses, dtype=np.float64)
    with style.drawing(path, style.WIDTH, 3.1) as figure:
        axes = figure.subplots()
        axes.plot(np.arange(1, len(values) + 1), values, color=style.TUNED)
        # The high losses of the first pools would compress all others.
        axes.set_ylim(top=max(float(np.quantile(values, 0.97)), float(values[-1])) + 0.2)
        axes.set_xlabel("pool")
        axes.set_ylabel("negative log-likelihood  [nats]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _weight(won: bool) -> dict[str, Any]:
    """Return the line style of the best start, or of the others."""
    return {"lw": 1.8, "zorder": 3} if won else {"lw": 0.9, "alpha": 0.7}


def _last(values: Array) -> float:
    """Return the last finite value."""
    return float(values[np.isfinite(values)][-1])


def _index(items: Sequence[object], item: object) -> int:
    """Return the index of an item, compared by identity."""
    return next(i for i, other in enumerate(items) if other is item)


def _time(recording: Recording) -> tuple[Array, str]:
    """Return the time axis, starting at 0, and its label."""
    if recording.stamps is None:
        return np.arange(len(recording.knobs), dtype=np.float64), "timestep"
    return recording.stamps - recording.stamps[0], "time  [s]"


def _lost(recording: Recording) -> list[tuple[float, float]]:
    """Return each interval without a marble, extended by half a row on either side."""
    time, _ = _time(recording)
    half = 0.5 * float(np.median(np.diff(time)))
    edges = np.diff(np.concatenate([[False], ~recording.seen, [False]]).astype(int))
    firsts, lasts = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(time[first] - half, time[last] + half) for first, last in zip(firsts, lasts, strict=True)]


def _distance(recording: Recording, marble: Array) -> Array:
    """Return the mean over x and y of the absolute error in each row, (n,) [% of the edge]."""
    return np.asarray(PERCENT * np.abs(marble - recording.marble).mean(axis=1))


def _draw_path(axes: Any, recording: Recording, prediction: Prediction) -> None:
    """Draw one board."""
    draw_rim(axes, prediction.model)
    axes.plot(*recording.marble.T, ".", color=style.RECORDED)
    for rows in prediction.pieces:
        axes.plot(*prediction.marble[rows].T, color=prediction.colour)
    axes.plot(*recording.marble[0], "o", color=style.INK, ms=6, mfc=style.PAPER, zorder=4)
    # On the side away from the path.
    up = recording.marble[0, 1] >= np.nanmean(recording.marble[:, 1])
    place = {"xytext": (0, 7 if up else -7), "va": "bottom" if up else "top"}
    axes.annotate("start", recording.marble[0], textcoords="offset points", ha="center", **place)
    axes.set_title(style.shortened(prediction.label, 24), color=prediction.colour, fontweight="bold")
    axes.set_title("• recorded", color=style.RECORDED, loc="right")
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def rim_of(model: Model) -> Array:
    """Return the observed half-widths of the inside of the rim along x and y, (2,) [board edges]."""
    scale = model.parameters["observation_scale"].value
    return np.asarray(0.5 * scale * np.array([1.0, model.board.edge_y_m / model.board.edge_x_m]))


def draw_rim(axes: Any, model: Model) -> None:
    """Draw the rim's inside, walls and holes, and as a dotted line the limit of the marble's centre."""
    rim = rim_of(model)
    marble = 2 * rim[0] * model.marble.radius_m / model.board.edge_x_m
    outline: dict[str, Any] = {"ec": style.INK, "lw": 2.2, "joinstyle": "round"}
    reach: dict[str, Any] = {"ec": style.MUTED, "lw": 0.7, "ls": (0, (1, 3))}
    for (x, y), look in ((rim, outline), (rim - marble, reach)):
        axes.add_patch(Rectangle((-x, -y), 2 * x, 2 * y, fill=False, **look))
    if model.maze is not None:
        _draw_maze(axes, model.maze, rim, 2 * rim[0] / model.board.edge_x_m)


def _draw_maze(axes: Any, maze: Maze, rim: Array, per_m: float) -> None:
    """Draw inner walls as they are, with their round ends, and holes; so many board edges are a metre."""
    half = maze.wall_thickness_m / 2.0
    for x0, y0, x1, y1 in per_m * np.reshape(maze.walls, (-1, 4)):
        length, angle = math.hypot(x1 - x0, y1 - y0), math.degrees(math.atan2(y1 - y0, x1 - x0))
        wall = FancyBboxPatch(
            (0.0, 0.0), length, 0.0, boxstyle=BoxStyle.Round(pad=per_m * half), fc=style.INK, ec="none"
        )
        wall.set_transform(Affine2D().rotate_deg(angle).translate(x0, y0) + axes.transData)
        axes.add_patch(wall)
        inside = Rectangle((-rim[0], -rim[1]), 2 * rim[0], 2 * rim[1], transform=axes.transData)
        wall.set_clip_path(inside)
    for place in per_m * np.reshape(maze.holes, (-1, 2)):
        axes.add_patch(Circle(place, per_m * maze.hole_radius_m, fc=style.MUTED, ec="none", zorder=0.5))
