"""What a track leaves behind: the recording, and beside it what is known of how it was made."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.files import PathLike, write_atomic
from irt.recording import MARBLE, STEP, TILT, Commands, Recording
from irt.tracking.budget import Budget, error_budget
from irt.tracking.geometry import Pose
from irt.tracking.run import Track
from irt.tracking.standing import Stretches, stretches
from irt.tracking.timing import Alignment, Gaps, align, at_commands, find_gaps

Array = NDArray[np.float64]

#: A tilt is written where its noise is at most this share of what it varies by: a tenth of the variance.
USEFUL = float(np.sqrt(0.1))
#: A camera that shows one picture for so long stands still [s]: a webcam that waits for light takes a tenth.
STILL_S = 0.5
#: A marble moves in its first row if it is faster than this [board edges per second].
AT_REST = 0.02


@dataclass(frozen=True, eq=False)
class Timed:
    """A track laid on commands.

    Attributes
    ----------
    recording : Recording
        From the first row in which the marble is seen.
    confidence : (n,) array
        That of the picture nearest to each row.
    alignment : Alignment or None
        Of the two clocks, where it was looked for.
    offset : float
        What was added to the commands' stamps [s].
    """

    recording: Recording
    confidence: Array
    alignment: Alignment | None
    offset: float


def shows_tilt(track: Track) -> bool:
    """Return whether the board's tilt was measured well enough to be of use to a fit."""
    noise = track.scene.tilt_noise
    measured = np.isfinite(track.tilt[:, 0])
    if noise is None or measured.sum() < 2:
        return False
    varies = float(np.sqrt(track.tilt[measured].var(axis=0).sum()))
    return float(np.linalg.norm(noise)) <= USEFUL * varies


def laid_on(track: Track, commands: Commands, path: Path, offset: float | None = None) -> Timed:
    """Lay a track on the commands that were played.

    Row i of the recording is where the marble is when command i is issued.

    Parameters
    ----------
    track : Track
        Of the run.
    commands : Commands
        With stamps; without, one for each picture.
    path : path
        Of the recording to be.
    offset : float, optional
        What to add to the commands' stamps to have those of the pictures [s]; by default the offset at which
        the marble's accelerations follow the commands best.

    Raises
    ------
    IrtError
        If they do not belong together.
    """
    alignment = None
    if commands.stamps is None:
        if len(commands.knobs) != len(track.stamps):
            raise IrtError(
                f"{len(commands.knobs)} commands without stamps, but {len(track.stamps)} pictures: give each "
                "command its time in a column t_s"
            )
        times, offset = track.stamps, 0.0
    else:
        # In places between pictures the next one that is new counts.
        track = track.new()
        if offset is None:
            alignment = align(commands.stamps, commands.knobs, track.stamps, track.marble)
            offset = alignment.offset
        times = commands.stamps + offset
    marble = at_commands(track.stamps, track.marble, times)
    seen = np.flatnonzero(~np.isnan(marble[:, 0]))
    if len(seen) < 2:
        raise IrtError("the commands and the pictures do not overlap: is --offset right?")
    rows = slice(seen[0], seen[-1] + 1)
    nearest = np.abs(times[rows, None] - track.stamps[None, :]).argmin(axis=1)
    tilt = at_commands(track.stamps, track.tilt, times)[rows] if shows_tilt(track) else None
    recording = Recording(path.stem, path, commands.knobs[rows], marble[rows], times[rows], tilt)
    return Timed(recording, track.confidence[nearest], alignment, float(offset))


def save_timed(timed: Timed) -> None:
    """Write a recording, with a column `confidence` that readers of recordings pass over.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    header, *lines = timed.recording.to_csv().splitlines()
    rows = [f"{line},{sure:.3f}" for line, sure in zip(lines, timed.confidence, strict=True)]
    write_atomic(timed.recording.path, "\n".join([f"{header},confidence", *rows]) + "\n")


def save_positions(path: PathLike, track: Track) -> None:
    """Write a track without commands: a row for each picture.

    It is no recording yet, as nothing is known of the knobs.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    columns = [track.stamps[:, None], track.marble]
    names = ["t_s", *MARBLE]
    if shows_tilt(track):
        columns.append(track.tilt)
        names += TILT
    lines = [",".join([STEP, *names, "confidence"])]
    for step, (row, sure) in enumerate(zip(np.hstack(columns), track.confidence, strict=True)):
        cells = ("" if np.isnan(one) else repr(float(one)) for one in row)
        lines.append(f"{step},{','.join(cells)},{sure:.3f}")
    write_atomic(path, "\n".join(lines) + "\n")


@dataclass(frozen=True)
class Summary:
    """What a track is worth.

    Attributes
    ----------
    pictures, seen : int
        How many there are, and on how many the marble is seen.
    lost : tuple of (first, count)
        Stretches of pictures in which it is not, the longest first.
    gaps : Gaps
        Of the stamps.
    stamps : str
        How the stamps were made, in words.
    away, still : tuple of (first, count, from, to)
        Stretches of pictures in which the board is not where it was, and in which the camera shows one
        picture for half a second or more: first picture, number, and their stamps [s].
    pixels_per_edge : float
        At the middle of the board.
    radius_px : float
        Of the marble.
    noise : float
        Standard deviation of a position [board edges].
    corners_mm : float
        Standard error of the board's corners [mm].
    shadow : float
        The chance that a shadow was followed, from 0 to 1; a half where the board has no texture.
    budget : Budget
        What adds to the error of a place on the board [mm].
    disagree : float
        How far the middle of the marble's rim is from that of what it covers [radii].
    corners_px : float or None
        Root mean square of the corners off the board's own shape, where a lens is calibrated [pixels].
    lens_px : float or None
        What the calibration left over [pixels].
    height, tilt : str
        Whether the marble's height, and the board's tilt, are taken out of its positions.
    tilt_noise_rad : (about x, about y) or None
        Standard error of the tilt in one picture, None where it was not measured [rad].
    tilt_written : bool
        Whether the recording has the tilt: where its noise is small beside what it varies by.
    confidence : float
        The median, where it is seen.
    moving : bool
        Whether the marble moves in the first picture that shows it.
    """

    pictures: int
    seen: int
    lost: tuple[tuple[int, int], ...]
    gaps: Gaps
    stamps: str
    away: tuple[tuple[int, int, float, float], ...]
    still: tuple[tuple[int, int, float, float], ...]
    pixels_per_edge: float
    radius_px: float
    noise: float
    corners_mm: float
    shadow: float
    budget: Budget
    disagree: float
    corners_px: float | None
    lens_px: float | None
    height: str
    tilt: str
    tilt_noise_rad: tuple[float, float] | None
    tilt_written: bool
    confidence: float
    moving: bool

    @property
    def shown(self) -> int:
        """Number of pictures that do not repeat the one before."""
        return self.pictures - self.gaps.repeated

    @property
    def detection(self) -> float:
        """Share of these on which the marble is seen."""
        return self.seen / self.shown if self.shown else 0.0


def summarise(track: Track, noise: float, edge_mm: float, stamps: str) -> Summary:
    """Return what a track is worth.

    Parameters
    ----------
    track : Track
        Of a run.
    noise : float
        Standard deviation of its positions [board edges].
    edge_mm : float
        The board's long edge [mm].
    stamps : str
        How the stamps were made, in words.
    """
    scene, geometry = track.scene, track.scene.geometry
    corners_px = None
    height = "not corrected: without a calibrated lens (--lens) positions are too far out by about 1 %"
    if isinstance(geometry, Pose):
        flat = np.column_stack([scene.size.corners, np.zeros(4)])
        apart = geometry.project(flat) - scene.corners
        corners_px = float(np.sqrt((apart**2).sum(axis=1).mean()))
        height = (
            f"corrected: the marble's middle moves {1000 * scene.size.radius:.1f} thousandths above the board"
        )
    tilt = (
        "not measured: no markers on the board and no calibrated lens (--lens), so that its tilt moves the "
        "marble (parallax)"
    )
    if scene.markers is not None:
        tilt = f"measured in each picture by {len(scene.markers.places)} markers on the board"
    elif scene.edges is not None:
        tilt = "measured in each picture by the board's sides"
    elif scene.texture is not None:
        tilt = "measured in each picture by the grain and the lines on the board"
    if scene.shows_tilt is not None and scene.shows_tilt.missed:
        tilt += f", but for {scene.shows_tilt.missed} pictures, which take that of the one before"
    noise_rad = scene.tilt_noise
    if noise_rad is not None:
        tilt += (
            f", noise {noise_rad[0]:.5f} rad about x and {noise_rad[1]:.5f} about y: "
            f"{'written as tilt_x_rad, tilt_y_rad' if shows_tilt(track) else 'too much to be written'}"
        )
    middle = np.array([[0.0, 0.0], [0.01, 0.0]])
    ends = geometry.pixels(middle)
    pixels = 100.0 * float(np.hypot(*(ends[1] - ends[0])))
    corners_mm = edge_mm * _largest(scene.corners_px, corners_px) / pixels
    return Summary(
        pictures=len(track.stamps),
        seen=int(track.seen.sum()),
        lost=tuple(sorted(stretches(~track.seen), key=lambda one: -one[1])),
        gaps=find_gaps(track.stamps, track.repeated),
        stamps=stamps,
        away=_dated(track, track.away),
        still=tuple(one for one in _dated(track, stretches(track.repeated)) if one[3] - one[2] >= STILL_S),
        pixels_per_edge=pixels,
        radius_px=scene.learned.radius,
        noise=noise,
        corners_mm=corners_mm,
        shadow=scene.learned.shadow,
        budget=error_budget(scene, corners_mm, noise, edge_mm, pixels),
        disagree=scene.learned.appearance.apart / scene.learned.radius,
        corners_px=corners_px,
        lens_px=geometry.lens.error_px if isinstance(geometry, Pose) else None,
        height=height,
        tilt=tilt,
        tilt_noise_rad=None if noise_rad is None else (float(noise_rad[0]), float(noise_rad[1])),
        tilt_written=shows_tilt(track),
        confidence=float(np.median(track.confidence[track.seen])) if track.seen.any() else 0.0,
        moving=_moving(track),
    )


def _largest(error: float, misfit: float | None) -> float:
    """Return the error of corners: what their sides scatter by, or what a board's own shape is missed by."""
    return max(error, misfit or 0.0)


def save_metadata(path: PathLike, track: Track, summary: Summary, facts: dict[str, Any]) -> None:
    """Write what is known of a track as JSON; `facts` are those of the files that it was made from.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    content = {
        **facts,
        **{name: value for name, value in asdict(summary).items() if name != "budget"},
        "budget_mm": {**asdict(summary.budget), "total": summary.budget.total},
        "detection": summary.detection,
        "lost": [{"first": first, "pictures": count} for first, count in summary.lost],
        "corners": {"found_by": track.scene.found_by, "pixels": track.scene.corners.round(3).tolist()},
        "stopped": track.stopped,
    }
    write_atomic(path, json.dumps(content, indent=2) + "\n")


def _dated(track: Track, found: Stretches) -> tuple[tuple[int, int, float, float], ...]:
    """Return stretches of pictures with the stamps of their ends [s]."""
    stamps = track.stamps
    return tuple(
        (first, count, float(stamps[first]), float(stamps[first + count - 1])) for first, count in found
    )


def _moving(track: Track) -> bool:
    """Return whether the marble moves in the first pictures that show it."""
    rows = np.flatnonzero(track.seen)[:6]
    if len(rows) < 3 or np.ptp(track.stamps[rows]) <= 0:
        return False
    slopes = np.polyfit(track.stamps[rows], track.marble[rows], 1)[0]
    return bool(np.hypot(*slopes) > AT_REST)
