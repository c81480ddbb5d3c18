"""The paper's figures with the same axes and units, for more methods and with the spread over trials."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray
from PIL import Image

from irt.files import PathLike, write_atomic
from irt.paper.contenders import METHODS
from irt.paper.setting import ROLLOUTS
from irt.paper.symmetry import Symmetry
from irt.pictures import make_logarithmic
from irt.report import style
from irt.report.plots import FLOOR, PERCENT
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: One colour for each method in all figures (Okabe and Ito's, and greys).
COLOURS = {
    "irt+": style.TUNED,
    "irt": "#56b4e9",
    "irt-paper": style.SECOND,
    "direct": style.THIRD,
    "cma-es": style.UNTUNED,
    "es": "#e69f00",
    "npe": style.MUTED,
    "least-squares": style.INK,
}
_WIDE = 7.6
#: Line styles of a proposed path and of the target over it, so that both stay visible.
_PROPOSED: dict[str, Any] = {"lw": 2.6, "alpha": 0.45}
_TARGET: dict[str, Any] = {"lw": 1.0, "ls": (0, (2, 1.5))}
#: Colours of a picture.
_SHADES = 160
#: Bootstrap draws of the band about a mean.
_DRAWS = 400


def plot_errors(
    path: PathLike,
    errors: Mapping[str, Array],
    what: str,
    *,
    floor: tuple[float, str] | None = None,
    logarithmic: bool = True,
    papers: Sequence[tuple[float, float, str]] = (),
) -> None:
    """Draw mean errors over the number of simulated rollouts, with 95 % bands (paper, Figs. 4, 5 and 8).

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    errors : mapping of (n, rollouts + 1) arrays
        Of n trials, by method; in shares.
    what : str
        Name of the error, for the axis.
    floor : (height, text), optional
        Lower bound for all methods.
    logarithmic : bool
        Whether the vertical axis is logarithmic; otherwise it starts at zero, as in the paper.
    papers : sequence of (rollouts, height, text)
        The paper's own numbers, as crosses.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with _drawing(path, _WIDE, 4.2) as figure:
        axes = figure.subplots()
        ends = []
        for name, trials in errors.items():
            rollouts = np.arange(1, trials.shape[1])
            mean, low, high = _bands(PERCENT * trials[:, 1:])
            axes.fill_between(rollouts, low, high, color=COLOURS[name], alpha=0.15, lw=0)
            axes.plot(rollouts, mean, color=COLOURS[name], lw=2.2 if name == "irt+" else 1.4)
            ends.append((float(mean[-1]), METHODS[name].title, COLOURS[name]))
        if floor is not None:
            axes.axhline(PERCENT * floor[0], **FLOOR)
            ends.append((PERCENT * floor[0], floor[1], style.INK))
        for at, height, text in papers:
            axes.plot(
                max(at, 1), PERCENT * height, "x", color=style.INK, ms=7, mew=1.6, zorder=5, clip_on=False
            )
            axes.annotate(
                text,
                (max(at, 1), PERCENT * height),
                xytext=(6, 5),
                textcoords="offset points",
                fontsize=7.5,
                zorder=6,
                bbox={"boxstyle": "square,pad=0.1", "color": style.PAPER, "alpha": 0.8},
            )
        if logarithmic:
            make_logarithmic(axes)
        else:
            axes.set_ylim(bottom=0.0)
        _count(axes)
        axes.set_xlim(1, ROLLOUTS)
        axes.set_ylabel(f"{what}  [%]")
        style.label_ends(axes, ends)


def plot_pretraining(path: PathLike, errors: Mapping[str, Array], pretraining: Mapping[str, int]) -> None:
    """Draw the mean state error over all rollouts including the pretraining, for one target and for many.

    All targets of a network share the rollouts of its training. On the left they count in full, on the right
    by a hundredth, as for a hundred targets.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    errors : mapping of (n, rollouts + 1) arrays
        As of `plot_errors`.
    pretraining : mapping
        Rollouts by method.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with _drawing(path, _WIDE, 3.8) as figure:
        both = figure.subplots(1, 2, sharey=True)
        for axes, targets in zip(both, (1, 100), strict=True):
            ends = []
            for name, trials in errors.items():
                rollouts = np.arange(1, trials.shape[1]) + pretraining[name] / targets
                mean = PERCENT * trials[:, 1:].mean(axis=0)
                axes.plot(rollouts, mean, color=COLOURS[name], lw=2.2 if name == "irt+" else 1.4)
                # After its first rollout: after a long pretraining a line of 300 rollouts would be vertical.
                axes.plot(rollouts[0], mean[0], "o", color=COLOURS[name], ms=4.0)
                ends.append((float(mean[-1]), METHODS[name].title, COLOURS[name]))
            make_logarithmic(axes)
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(numticks=9))
            axes.xaxis.set_major_formatter(FuncFormatter(_thousands))
            axes.xaxis.set_minor_locator(NullLocator())
            axes.set_title("one target" if targets == 1 else f"each of {targets} targets")
            axes.set_xlabel("rollouts, the pretraining's included")
        both[0].set_ylabel("mean absolute state error  [%]")
        style.label_ends(both[1], ends)


def plot_observations(
    path: PathLike, columns: Sequence[tuple[str, Array, Sequence[tuple[str, Array]]]]
) -> None:
    """Draw proposed and target observations over time, a column for each start, a row for each iteration.

    As in the paper's Figs. 3 and 7.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    columns : sequence of (title, (n, 2) array, sequence of (label, (n, 2) array))
        Title, target and proposals of each column.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    rows = max(len(proposals) for _, _, proposals in columns)
    with _drawing(path, _WIDE, 1.25 * rows + 0.6) as figure:
        grid = figure.subplots(rows, len(columns), sharex=True, sharey=True, squeeze=False)
        for axis, (title, target, proposals) in enumerate(columns):
            for row, (label, proposed) in enumerate(proposals):
                axes = grid[row, axis]
                for coordinate, colour in enumerate((style.TUNED, style.UNTUNED)):
                    axes.plot(proposed[:, coordinate], color=colour, **_PROPOSED)
                    axes.plot(target[:, coordinate], color=colour, **_TARGET)
                axes.set_title(f"{title}\n{label}" if row == 0 else label, fontsize=8)
                axes.set_ylim(-0.62, 0.62)
                axes.set_yticks([-0.5, 0.0, 0.5])
        for axes in grid[-1]:
            axes.set_xlabel("timestep")
        for axes in grid[:, 0]:
            axes.set_ylabel("position [edge]")
        texts = [
            (colour, line, f"{coordinate}, {what}")
            for coordinate, colour in (("x", style.TUNED), ("y", style.UNTUNED))
            for what, line in (("proposed", _PROPOSED), ("target", _TARGET))
        ]
        handles = [grid[0, 0].plot([], [], color=colour, **line)[0] for colour, line, _ in texts]
        figure.legend(
            handles, [text for *_, text in texts], loc="outside lower center", ncols=4, frameon=False
        )


def plot_evolution(path: PathLike, scaled: Array, truth: Array, titles: Sequence[str]) -> None:
    """Draw each parameter over the iterations of IRT (paper, Fig. 6).

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    scaled : (panels, traces, iterations + 1, 5) array
        Parameters scaled to [0, 1], a row of panels each.
    truth : (5,) array
        Parameters of the target.
    titles : sequence of str
        Titles of the rows.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with _drawing(path, _WIDE, 1.9 * len(scaled) + 0.3) as figure:
        grid = figure.subplots(len(scaled), len(PARAMETERS), sharex=True, sharey=True, squeeze=False)
        for row, (traces, title) in enumerate(zip(scaled, titles, strict=True)):
            for column, name in enumerate(PARAMETERS):
                axes = grid[row, column]
                axes.plot(traces[:, :, column].T, color=style.TUNED, lw=0.9, alpha=0.7)
                axes.axhline(truth[column], **FLOOR)
                axes.set_ylim(-0.03, 1.03)
                if row == 0:
                    axes.set_title(name, fontsize=8)
                if row == len(scaled) - 1:
                    axes.set_xlabel("iteration")
            grid[row, 0].set_ylabel(f"scaled parameter\n{title}")


def plot_symmetry(path: PathLike, found: Symmetry) -> None:
    """Draw the changes of the observation and of the parameters along the symmetry.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    found : Symmetry
        From `irt.paper.symmetry.symmetry`.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    colours = (style.MUTED, style.TUNED, style.SECOND, style.UNTUNED)
    with _drawing(path, _WIDE, 3.6) as figure:
        axes = figure.subplots()
        ends = []
        # The unmoved end has zero change, which a logarithmic axis cannot show.
        moved = found.parameter_error > 0.0
        away = PERCENT * found.parameter_error[moved]
        for (name, quartiles), colour in zip(found.change.items(), colours, strict=True):
            low, middle, high = PERCENT * quartiles[moved].T
            axes.fill_between(away, low, high, color=colour, alpha=0.15, lw=0)
            axes.plot(away, middle, color=colour)
            ends.append((float(middle[0]), name, colour))
        make_logarithmic(axes)
        axes.yaxis.set_major_locator(LogLocator())
        axes.set_xlim(0.0, float(away.max()))
        axes.set_xlabel("mean absolute parameter error along time_scale f, gears and friction 1/f²  [%]")
        axes.set_ylabel("change of the observation  [% of edge]")
        style.label_ends(axes, ends)


@contextmanager
def _drawing(path: PathLike, width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure, and write it to ``path``; a PNG has a small palette to keep pages small."""
    with style.drawing(path, width, height) as figure:
        yield figure
    if str(path).endswith(".png"):
        file = io.BytesIO()
        with Image.open(path) as picture:
            picture.convert("RGB").quantize(_SHADES, dither=Image.Dither.NONE).save(
                file, "png", optimize=True
            )
        write_atomic(path, file.getvalue())


def _bands(errors: Array) -> tuple[Array, Array, Array]:
    """Return the mean of (n, k) errors and its 95 % band, by bootstrap over trials."""
    random = np.random.default_rng(0)
    weights = random.multinomial(len(errors), np.full(len(errors), 1.0 / len(errors)), _DRAWS) / len(errors)
    low, high = np.percentile(weights @ errors, [2.5, 97.5], axis=0)
    return errors.mean(axis=0), low, high


def _thousands(value: float, _: int) -> str:
    """Return a short label for a count on an axis."""
    for size, letter in ((1_000_000, "M"), (1_000, "k")):
        if value >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


def _count(axes: Any) -> None:
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("number of simulated rollouts")
