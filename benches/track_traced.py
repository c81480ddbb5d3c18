"""Score the tracker and its peers on path-traced runs of `render_traced.py`.

    python benches/render_traced.py --out DIR 0 1 2 3 4 5 6 7 && python benches/track_traced.py DIR

Prints one line for each run and method. Corners are detected; on boards with a rim, which may hide which
outline is the board's, those of the first picture are given to the pixel, and one more line ("corners") is
with those that are detected. The peers (`tracking.rivals`) are given the marble's colour, its size and the
true corners.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.fitting.problem import noise_in
from irt.tracking.blob_detector import Box
from irt.tracking.geometry import Lens, Pose, Size
from irt.tracking.recorded import summarise
from irt.tracking.run import Question, follow, prepare
from irt.tracking.separation import Clue
from irt.tracking.source import open_source
from tracking.cases import EDGES_M
from tracking.rivals import rivals
from tracking.view import turned

Array = NDArray[np.float64]
MM = 1000.0 * EDGES_M[0]
#: Distance above which a position is of another object [radii].
WRONG_RADII = 1.0
#: Two standard errors of a place in two dimensions, over the total of its budget.
WITHIN = 1.73
#: Number of pictures for which the peers get the marble's position.
GIVEN = 10


class Run:
    """A rendered run: its pictures and the truth."""

    def __init__(self, folder: Path) -> None:
        self.name = folder.name
        truth: dict[str, Any] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        self.kind, self.rim = truth["kind"], truth["rim"]
        self.radius_px = float(truth["radius_px"])
        self.corners, self.pixels, self.places = (
            np.array(truth[name]) for name in ("corners", "pixels", "places")
        )
        tilts = np.array(truth["tilts"])
        along_x, along_y = truth.get("edges_m", EDGES_M)
        self.size = Size(1.0, along_y / along_x, truth["radius_m"] / along_x)
        self.lens = Lens(np.array(truth["matrix"]), np.zeros(5), tuple(truth["size"]), 0.1)
        level = Pose.of(self.lens, self.corners, self.size.corners, self.size.radius)
        self.poses = [
            Pose(self.lens, level.rotation @ turned(tilt), level.origin, level.radius) for tilt in tilts
        ]
        self.source = open_source(str(next(folder.glob("run*"))), 30.0)

    def question(self, clue: Clue, *, corners: bool) -> Question:
        """Return the command-line arguments, with corners or without."""
        first = self.poses[0].project(np.column_stack([self.size.corners, np.zeros(4)]))
        given = tuple((round(x), round(y)) for x, y in first) if corners else None
        return Question(self.size, self.lens, given, clue)


def score(run: Run, way: str, pixels: Array, marble: Array) -> str:
    """Return a line of figures: share seen, wrong, root mean squares [pixels and mm]."""
    seen = ~np.isnan(pixels[:, 0])
    apart = np.linalg.norm(pixels - run.pixels, axis=1)
    wrong = seen & ~(apart < WRONG_RADII * run.radius_px)
    right = seen & ~wrong
    missed = np.linalg.norm(marble[right] - run.places[right], axis=1) * MM
    return (
        f"{run.name} {run.kind:8} {way:7} seen {seen.mean():6.1%} wrong {wrong.sum():3d} "
        f"rms {_rms(apart[right]):.2f} px {_rms(missed):.2f} mm"
    )


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else float("nan")


def ours(run: Run, way: str, clue: Clue, *, corners: bool) -> str:
    """Return the result of `irt track` on a run, with corners given or not."""
    try:
        scene = prepare(run.source, run.question(clue, corners=corners), lambda *_: None)
        with tempfile.TemporaryDirectory() as folder:
            track = follow(run.source, scene, Path(folder) / "partial", lambda *_: None)
    except IrtError as error:
        return f"{run.name} {run.kind:8} {way:7} refused: {error}"
    # Given corners are those of the first picture, found ones those of the mean board.
    flat = np.column_stack([run.size.corners, np.zeros(4)])
    seen = run.poses[:1] if corners else run.poses
    true_corners = np.mean([pose.project(flat) for pose in seen], axis=0)
    apart = scene.corners - true_corners
    inside = float(np.linalg.norm(scene.corners - scene.corners.mean(axis=0), axis=1).mean())
    true = float(np.linalg.norm(true_corners - true_corners.mean(axis=0), axis=1).mean())
    pose = Pose.of(run.lens, scene.corners, run.size.corners, run.size.radius)
    shift = pose.positions(run.pixels) - run.places
    line = score(run, way, track.pixels, track.marble)
    said = summarise(track, noise_in([track.marble]), MM, "")
    missed = np.linalg.norm(track.marble - run.places, axis=1)[track.seen] * MM
    return (
        f"{line}; corners {_rms(np.linalg.norm(apart, axis=1)):.2f} px, scale {true / inside:.4f}, "
        f"stated {scene.corners_px:.2f} px, aside {np.linalg.norm(shift.mean(axis=0)) * MM:.2f} mm; "
        f"confidence {said.confidence:.2f}, shadow {said.shadow:.2f}, stated {said.budget.total:.2f} mm, "
        f"which holds {(missed < WITHIN * said.budget.total).mean():.0%}"
    )


def peers(run: Run) -> Iterator[str]:
    """Yield the result of each peer, which gets the colour."""
    pictures = [frame.picture for frame in run.source.frames()]
    width, height = run.lens.size
    ways = rivals(pictures[:GIVEN], run.pixels[:GIVEN], run.radius_px, Box(0, 0, width, height), {})
    pose = Pose.of(run.lens, run.corners, run.size.corners, run.size.radius)
    for name, way in ways.items():
        pixels = np.array([way.see(picture) for picture in pictures])
        short = name.removeprefix("cv2.").split()[0].split(".")[0]
        yield score(run, short, pixels, pose.positions(pixels))


def main() -> None:
    parser = argparse.ArgumentParser(description="Score the tracker on path-traced runs.")
    parser.add_argument("folder", type=Path, help="of `render_traced.py --out`")
    parser.add_argument("numbers", nargs="*", help="runs (default: all)")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for folder in sorted(options.folder.iterdir()):
        if (options.numbers and folder.name not in options.numbers) or not (folder / "truth.json").exists():
            continue
        run = Run(folder)
        given = Clue(places=((float(run.pixels[0, 0]), float(run.pixels[0, 1])),))
        print(ours(run, "alone", Clue(), corners=run.rim), flush=True)
        print(ours(run, "given", given, corners=run.rim), flush=True)
        if run.rim:
            print(ours(run, "corners", Clue(), corners=False), flush=True)
        for line in peers(run):
            print(line, flush=True)


if __name__ == "__main__":
    main()
