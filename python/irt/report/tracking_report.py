"""HTML report of a track: detection, precision, timing and geometry."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from irt.files import PathLike
from irt.report import style
from irt.report.page import Picture, Table, write_page
from irt.report.plots import TICKS
from irt.report.words import counted, millimetres, percent, versions
from irt.tracking.budget import Budget
from irt.tracking.doubts import doubts
from irt.tracking.recorded import Summary, Timed
from irt.tracking.run import Track

Array = NDArray[np.float64]

#: Most gaps that are listed.
_LISTED = 12
#: What adds to the error of a position, in words.
_PARTS = {
    "corners": "the board's corners",
    "lens": "the lens",
    "height": "the height of the marble above the board",
    "tilt": "the tilt of the board",
    "marble": "the marble's middle in its picture",
    "noise": "noise from picture to picture",
}


def write_tracking_report(
    folder: PathLike,
    track: Track,
    summary: Summary,
    timed: Timed | None,
    *,
    facts: Mapping[str, Any],
    edge_m: float,
) -> Path:
    """Write ``NAME-report.html`` and its pictures into the folder of a track, and return its path.

    Parameters
    ----------
    folder : path
        Folder of the track's files.
    track, summary : Track, Summary
        Positions, and their quality.
    timed : Timed or None
        The recording, if commands are known.
    facts : mapping
        Inputs of the track.
    edge_m : float
        The board's long edge [m].

    Raises
    ------
    IrtError
        If a file cannot be written.
    """
    folder = Path(folder)
    path = folder / f"{track.name}-report.html"
    write_page(
        path,
        "tracking.html",
        title=f"{track.name}: the marble's track",
        lead=_lead(summary, edge_m),
        stopped=track.stopped,
        key_figures=_figures(summary, edge_m),
        doubts=doubts(summary),
        path=_path(folder, track),
        errors=_errors(summary.budget),
        confidence=_confidence(folder, track),
        lost=_lost(track),
        timing=_timing(track, summary, timed),
        geometry=_geometry(track, summary, edge_m),
        settings={name: f"{value}" for name, value in facts.items()} | versions(),
    )
    return path


def _lead(summary: Summary, edge_m: float) -> str:
    """Return the summary of the track."""
    largest = next(iter(summary.budget.parts))
    return (
        f"The marble was found in {summary.seen:,} of {counted(summary.shown, 'picture')}. The standard "
        f"error of a position on the board is {summary.budget.total:.2f} mm, most of it by "
        f"{_PARTS[largest]}; from picture to picture it is {millimetres(summary.noise, edge_m)}. Rows in "
        "which the tracker was uncertain are empty."
    )


def _figures(summary: Summary, edge_m: float) -> list[tuple[str, str]]:
    longest = summary.lost[0][1] if summary.lost else 0
    figures = [
        (f"{100 * summary.detection:.2f} %", "of the pictures show the marble"),
        (f"{summary.budget.total:.2f} mm", "standard error of a position on the board"),
        (f"{summary.noise * summary.pixels_per_edge:.2f} px", f"noise, {percent(summary.noise)} of the edge"),
        (f"{longest}", "pictures in the longest gap"),
    ]
    if summary.corners_px is not None:
        error = summary.corners_px / summary.pixels_per_edge
        figures.append(
            (
                f"{summary.corners_px:.2f} px",
                f"error of the corners against the board's shape: {millimetres(error, edge_m)}",
            )
        )
    return figures


def _errors(budget: Budget) -> Table:
    """Return what adds to the error of a position on the board."""
    rows = [[_PARTS[name], f"{value:.2f} mm"] for name, value in budget.parts.items()]
    rows += [[_PARTS[name], "unknown"] for name in budget.unknown]
    return Table(
        "Standard errors of a position. Noise and tilt differ from picture to picture, all else stays.",
        ["by", "error"],
        [*rows, ["together", f"{budget.total:.2f} mm"]],
        total=True,
        words=(0,),
    )


def _path(folder: Path, track: Track) -> list[Picture]:
    """Draw the marble's path over the board and over time."""
    over = folder / f"{track.name}-board.svg"
    half_x, half_y = track.scene.size.along_x / 2, track.scene.size.along_y / 2
    with style.drawing(over, style.WIDTH, 4.0) as figure:
        axes = figure.subplots()
        axes.add_patch(Rectangle((-half_x, -half_y), 2 * half_x, 2 * half_y, fill=False, color=style.MUTED))
        axes.plot(*track.marble.T, ".-", color=style.TUNED, lw=0.8, ms=2.0)
        axes.set_aspect("equal")
        axes.set_xticks(TICKS)
        axes.set_yticks(TICKS)
        axes.set_xlabel("x  [board edges]")
        axes.set_ylabel("y  [board edges]")
    time = folder / f"{track.name}-time.svg"
    with style.drawing(time, style.WIDTH, 4.0) as figure:
        upper, lower = figure.subplots(2, sharex=True)
        for axes, axis, name in ((upper, 0, "x"), (lower, 1, "y")):
            _shade_lost(axes, track)
            axes.plot(track.stamps, track.marble[:, axis], "-", color=style.TUNED, lw=1.0)
            axes.set_ylabel(f"{name}  [board edges]")
        lower.set_xlabel("time  [s]")
    return [
        Picture(over, "Path of the marble within the board's edges."),
        Picture(time, "Coordinates over time; gaps are shaded."),
    ]


def _confidence(folder: Path, track: Track) -> list[Picture]:
    """Draw the tracker's confidence over time, and show the pictures with the lowest."""
    path = folder / f"{track.name}-confidence.svg"
    with style.drawing(path, style.WIDTH, 2.4) as figure:
        axes = figure.subplots()
        _shade_lost(axes, track)
        axes.plot(track.stamps, track.confidence, "-", color=style.SECOND, lw=1.0)
        axes.set_ylim(0.0, 1.03)
        axes.set_ylabel("confidence")
        axes.set_xlabel("time  [s]")
    return [
        Picture(path, "Confidence over time; gaps are shaded."),
        Picture(
            folder / f"{track.name}-unsure.png",
            "The picture of lowest confidence in each part of the run, with the detected rim.",
        ),
    ]


def _lost(track: Track) -> Table | None:
    """Return the longest gaps."""
    gaps = _stretches(track)
    if not gaps:
        return None
    return Table(
        "Pictures without a position",
        ["from", "pictures", "length"],
        [
            [f"{track.stamps[first]:.2f} s", f"{count}", f"{_seconds(track, first, count):.2f} s"]
            for first, count in gaps
        ],
    )


def _timing(track: Track, summary: Summary, timed: Timed | None) -> dict[str, str]:
    """Return the regularity of the stamps and the alignment of commands and pictures."""
    gaps = summary.gaps
    facts = {
        "interval": f"{1000 * gaps.interval:.2f} ms, jitter {1000 * gaps.jitter:.2f} ms",
        "dropped": f"{counted(gaps.dropped, 'picture')}; longest interval {1000 * gaps.longest:.1f} ms",
        "repeated": f"{counted(gaps.repeated, 'picture')}, left empty",
        "search": f"near the expected position in {percent(float(track.in_window.mean()))} of the pictures",
    }
    if timed is not None:
        facts["rows"] = f"{len(timed.recording.knobs):,}, from {timed.recording.seen.sum():,} positions"
        facts["commands"] = f"offset {timed.offset:.4f} s from their clock to the video's"
        if timed.alignment is not None:
            found = timed.alignment
            facts["commands"] = (
                f"offset {found.offset:.4f} s from their clock to the video's, standard error "
                f"{found.error:.4f} s, including the rig's delay; they explain {percent(found.explained)} of "
                "the accelerations"
            )
    return facts


def _geometry(track: Track, summary: Summary, edge_m: float) -> dict[str, str]:
    """Return the geometry that converts pixels to positions."""
    scale = summary.pixels_per_edge
    facts = {
        "corners": track.scene.found_by,
        "board": f"{scale:.1f} pixels along the long edge, {1000 * edge_m / scale:.3f} mm per pixel",
        "marble": f"{2 * summary.radius_px:.1f} pixels across",
        "height of the marble": summary.height,
        "tilt of the board": summary.tilt,
    }
    if summary.lens_px is not None:
        facts["lens"] = f"calibrated; residual {summary.lens_px:.2f} pixels"
    else:
        facts["lens"] = "not calibrated: four corners fit exactly, so their error is unknown"
    return facts


def _shade_lost(axes: Any, track: Track) -> None:
    for first, count in _stretches(track):
        axes.axvspan(
            track.stamps[first], track.stamps[first] + _seconds(track, first, count), color=style.FAINT
        )


def _stretches(track: Track) -> list[tuple[int, int]]:
    """Return first row and length of the longest gaps, in the order of the run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~track.seen, [False]]).astype(np.int8)))
    runs = [(int(first), int(end - first)) for first, end in zip(edges[::2], edges[1::2], strict=True)]
    return sorted(sorted(runs, key=lambda run: -run[1])[:_LISTED])


def _seconds(track: Track, first: int, count: int) -> float:
    last = min(first + count, len(track.stamps) - 1)
    return float(track.stamps[last] - track.stamps[first])
