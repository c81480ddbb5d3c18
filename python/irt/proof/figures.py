"""Figures of a scorecard: each function draws scores into one SVG or PNG file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import PercentFormatter

from irt.diagnosis.result import UNLISTED
from irt.files import PathLike
from irt.proof.metrics import CLEAR, Bin, Rate, calibration, confusion, coverage, gaps, of_catalogue, power
from irt.proof.score import NOTHING, Budget, RigScore
from irt.proof.wording import counted
from irt.report import style

#: Last entries of a confusion matrix, which are no effects of the catalogue.
_OTHERS = (UNLISTED, NOTHING, "failed")
_WIDE = 7.6


def plot_confusion(path: PathLike, scores: Sequence[RigScore]) -> None:
    """Draw the confusion matrix of hidden (rows) and named effects (columns), in shares of each row.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    scores : sequence of RigScore
        All rigs.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    rigs = confusion(scores)
    rows = _ordered({hidden for hidden, _ in rigs})
    columns = _ordered({named for _, named in rigs} | set(rows) - {"failed"})
    counts = np.array([[rigs[row, column] for column in columns] for row in rows], dtype=np.float64)
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    side = 0.235
    with style.drawing(path, max(4.0, 1.9 + side * len(columns)), max(2.6, 1.6 + side * len(rows))) as figure:
        axes = figure.subplots()
        colours = LinearSegmentedColormap.from_list("heat", [style.PAPER, *style.HEAT])
        axes.imshow(shares, cmap=colours, vmin=0.0, vmax=1.0, aspect="auto")
        axes.grid(visible=False)
        for row, column in zip(*np.nonzero(counts), strict=True):
            colour = style.PAPER if shares[row, column] > 0.45 else style.INK
            axes.text(
                column,
                row,
                f"{counts[row, column]:.0f}",
                color=colour,
                ha="center",
                va="center",
                fontsize=6.5,
            )
        for index, name in enumerate(rows):
            if name in columns:
                place = (columns.index(name) - 0.5, index - 0.5)
                axes.add_patch(_frame(place))
        axes.set_xticks(range(len(columns)), [_words(one) for one in columns], rotation=90, fontsize=7)
        axes.set_yticks(range(len(rows)), [_words(one) for one in rows], fontsize=7)
        axes.set(xlabel="named", ylabel="hidden")


def plot_power(path: PathLike, scores: Sequence[RigScore]) -> None:
    """Draw the share of rigs with found effects over the signal to noise of the refitted base model.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    bins = [one for one in power(scores) if one.rate.of]
    with style.drawing(path, style.WIDTH, 3.0) as figure:
        axes = figure.subplots()
        _draw_rates(axes, np.arange(len(bins)), [one.rate for one in bins], style.TUNED)
        axes.set_xticks(range(len(bins)), [f"{_range(one)}\n{counted(one.rate.of, 'rig')}" for one in bins])
        clear = [index for index, one in enumerate(bins) if one.low >= CLEAR]
        if clear:
            begin, end = clear[0] - 0.5, len(bins) - 0.5
            axes.plot([begin, end], [0.95, 0.95], color=style.INK, lw=0.9, ls=(0, (4, 3)))
            axes.text(begin, 0.935, "floor", fontsize=7.5, ha="left", va="top", color=style.MUTED)
        axes.set(xlim=(-0.5, max(len(bins) - 0.5, 0.5)), ylim=(0.0, 1.04))
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set(xlabel="signal after refit, in units of the tracker's noise", ylabel="named, or in a tie")


def plot_gaps(
    path: PathLike, scores: Sequence[RigScore], rivals: Sequence[tuple[str, Sequence[float]]]
) -> None:
    """Draw the closed share of the held-out gap for the diagnosis and other methods, sorted by rig.

    Parameters
    ----------
    path : path
        ``.svg`` or ``.png`` file to write.
    scores : sequence of RigScore
        All rigs; those with effects of the catalogue count.
    rivals : sequence of (title, shares)
        Other methods, on the same rigs.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    lines = [("irt diagnose", gaps(of_catalogue(scores)), style.TUNED)]
    colours = (style.UNTUNED, style.SECOND, style.THIRD, style.MUTED)
    lines += [
        (title, list(values), colour)
        for (title, values), colour in zip(rivals, colours, strict=False)
        if values
    ]
    with style.drawing(path, _WIDE, 3.2) as figure:
        axes = figure.subplots()
        ends = []
        for title, values, colour in lines:
            if not values:
                continue
            place = (np.arange(len(values)) + 0.5) / len(values)
            drawn = np.clip(np.sort(values), -1.0, 1.05)
            axes.plot(place, drawn, ".-" if len(values) < 80 else "-", color=colour, clip_on=False)
            ends.append((float(drawn[-1]), title, colour))
        axes.axhline(1.0, color=style.INK, lw=0.9, ls=(0, (4, 3)))
        axes.set(xlim=(0.0, 1.0), ylim=(-1.05, 1.1))
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set(xlabel="rigs, the worst first", ylabel="held-out gap closed")
        style.label_ends(axes, ends)


def plot_coverage(path: PathLike, scores: Sequence[RigScore]) -> None:
    """Draw the coverage of the 95 % interval of each parameter.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    names = sorted({name for one in scores for name in one.intervals if "." not in name})
    rates = [(name.replace("_", " "), _coverage_of(scores, name)) for name in names]
    effects = coverage(scores, of_effects=True)[0]
    rates += [("of effects", effects), ("all", coverage(scores)[0])]
    rates = [(name, rate) for name, rate in rates if rate.of]
    with style.drawing(path, style.WIDTH, 0.9 + 0.3 * max(len(rates), 1)) as figure:
        axes = figure.subplots()
        axes.axvspan(0.85, 0.99, color=style.FAINT, lw=0)
        axes.axvline(0.95, color=style.INK, lw=0.9, ls=(0, (4, 3)))
        for index, (_, rate) in enumerate(rates):
            low, high = rate.interval
            axes.plot([low, high], [index, index], color=style.TUNED)
            axes.plot(rate.share, index, "o", color=style.TUNED, ms=5)
        axes.set_yticks(range(len(rates)), [f"{name}  ({rate.of})" for name, rate in rates])
        axes.invert_yaxis()
        axes.set(xlim=(min([0.5, *[rate.interval[0] for _, rate in rates]]), 1.01))
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set_xlabel("intervals that hold the truth (band: the floor)")


def plot_reliability(path: PathLike, scores: Sequence[RigScore]) -> None:
    """Draw how often effects act, over the probability that diagnoses give them.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    deciles = calibration(scores)
    with style.drawing(path, style.WIDTH, 3.6) as figure:
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], color=style.INK, lw=0.9, ls=(0, (4, 3)))
        _draw_rates(axes, [one.mean for one in deciles], [one.rate for one in deciles], style.TUNED)
        for one in deciles:
            axes.text(one.mean, -0.03, f"{one.rate.of}", fontsize=7, ha="center", va="top", color=style.MUTED)
        axes.set(xlim=(-0.04, 1.04), ylim=(-0.12, 1.04))
        axes.set(xlabel="stated probability (numbers: effects in each bin)", ylabel="effects that act")
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))


def plot_budget(path: PathLike, budgets: Sequence[Budget]) -> None:
    """Draw the shares of effects and tracker by the diagnosis over those by the true paths.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    with style.drawing(path, style.WIDTH, 3.6) as figure:
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], color=style.INK, lw=0.9, ls=(0, (4, 3)))
        for title, marker, colour, shares in (
            ("effects", "o", style.TUNED, [(one.true_effects, one.effects) for one in budgets]),
            ("tracker", "s", style.UNTUNED, [(one.true_tracker, one.tracker) for one in budgets]),
        ):
            true, said = np.array(shares).reshape(-1, 2).T
            axes.plot(true, said, marker, color=colour, ms=4, label=title)
        axes.legend(loc="upper left", frameon=False, fontsize=8)
        axes.set(xlim=(-0.04, 1.04), ylim=(-0.04, 1.04), xlabel="true share", ylabel="share by the diagnosis")
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))


def _coverage_of(scores: Sequence[RigScore], name: str) -> Rate:
    held = [one.intervals[name] for one in scores if one.intervals.get(name, "open") != "open"]
    return Rate(held.count("yes"), len(held))


def _draw_rates(axes: Any, places: Any, rates: Sequence[Rate], colour: str) -> None:
    for place, rate in zip(places, rates, strict=True):
        axes.plot([place, place], rate.interval, color=colour)
    axes.plot(places, [rate.share for rate in rates], "o-", color=colour, ms=5, lw=0.8)


def _frame(place: tuple[float, float]) -> Any:
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    return Rectangle(place, 1.0, 1.0, fill=False, ec=style.MUTED, lw=0.6)


def _ordered(names: set[str]) -> list[str]:
    return [*sorted(names - set(_OTHERS)), *[one for one in _OTHERS if one in names]]


def _words(name: str) -> str:
    return name.replace("_", " ")


def _range(one: Bin) -> str:
    low, high = f"{one.low:g}", f"{one.high:g}"
    return f"from {low}" if math.isinf(one.high) else f"{low} to {high}"
