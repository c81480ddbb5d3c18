"""Measure the tracker beside other ways to find a ball, on rendered runs, into ``target/tracking.json``.

    python benches/track.py && python benches/write_table.py

Processor time on one core. Wants trackpy of ``benches/requirements.txt``; without it, it is left out and
said to be.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.corners import find_corners, ordered
from irt.tracking.geometry import Lens, Pose, Size
from irt.tracking.learning import learn, scale_of
from irt.tracking.run import SAMPLE, board_box
from irt.tracking.tracker import Tracker
from machine import busy_cores, machine
from tracking.rivals import rivals
from tracking.scene import EDGES_M, RADIUS_M, Picture, Scene
from tracking.sets import SETS

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
SIZE = Size(1.0, EDGES_M[1] / EDGES_M[0], RADIUS_M / EDGES_M[0])
OURS = "irt track"
#: A position farther off is false [pixels]; so is any where nothing is seen of the marble.
FALSE_PX = 2.0
#: A marble is visible if this share of it is.
VISIBLE = 0.75
#: Pictures of which the others are told where the marble is.
TOLD = 10


@dataclass
class Score:
    """What one way did on one run."""

    name: str
    set: str
    clip: int
    squares: float = 0.0
    given: int = 0
    false: int = 0
    visible: int = 0
    found: int = 0
    pictures: int = 0
    seconds: float = 0.0
    window: list[float] = field(default_factory=list)
    full: list[float] = field(default_factory=list)
    failed: str = ""

    def add(self, seen: Array, truth: Array, visible: float) -> None:
        """Count a picture."""
        self.pictures += 1
        apart = float(np.hypot(*(seen - truth)))
        there = not np.isnan(apart)
        wrong = there and (apart > FALSE_PX or visible <= 0.0)
        self.false += wrong
        self.visible += visible >= VISIBLE
        self.found += visible >= VISIBLE and there and not wrong
        if there and not wrong:
            self.given += 1
            self.squares += apart**2


def progress(text: str) -> None:
    """Say on stderr how far the run is."""
    print(text, file=sys.stderr, flush=True)


def run_clip(name: str, clip: int, rows: int, absent: dict[str, str]) -> list[Score]:
    """Return the scores of all ways on one run."""
    scene = SETS[name](clip, rows)
    frames = [scene.frame(index) for index in range(rows)]
    pictures = [picture for picture, _ in frames]
    truths = np.array([truth.pixel for _, truth in frames])
    visible = [truth.visible for _, truth in frames]
    scores = [_ours(name, clip, scene, pictures=pictures, truths=truths, visible=visible)]
    radius = scene.view.focal * RADIUS_M / float(np.linalg.norm(scene.view.eye))
    for rival, way in rivals(pictures[:TOLD], truths[:TOLD], radius, absent).items():
        score = Score(rival, name, clip)
        _count(score, way.see, pictures, truths, visible)
        scores.append(score)
    return scores


def _ours(
    name: str, clip: int, scene: Scene, *, pictures: list[Picture], truths: Array, visible: list[float]
) -> Score:
    score = Score(OURS, name, clip)
    lens = Lens(scene.view.matrix, scene.view.distortion, (scene.view.width, scene.view.height), 0.0)
    sample = [pictures[one] for one in np.linspace(0, len(pictures) - 1, SAMPLE).astype(int)]
    try:
        corners = ordered(find_corners(pictures[0], lens), SIZE)
        pose = Pose.of(lens, corners, SIZE.corners, SIZE.radius)
        learned = learn(sample, pose, board_box(corners, pose, lens.size))
    except IrtError as error:
        score.failed = str(error)
        for truth, share in zip(truths, visible, strict=True):
            score.add(np.full(2, np.nan), truth, share)
        return score
    tracker = Tracker(learned, scale_of(pose, learned.finder.middle))
    if learned.first is not None:
        tracker.expect(*learned.first)

    def see(picture: Picture) -> tuple[float, float]:
        start = time.process_time()
        found = tracker.see(picture)
        (score.window if found.in_window else score.full).append(time.process_time() - start)
        return found.x, found.y

    _count(score, see, pictures, truths, visible)
    return score


def _count(
    score: Score,
    see: Callable[[Picture], tuple[float, float]],
    pictures: list[Picture],
    truths: Array,
    visible: list[float],
) -> None:
    for picture, truth, share in zip(pictures, truths, visible, strict=True):
        start = time.process_time()
        found = see(picture)
        score.seconds += time.process_time() - start
        score.add(np.array(found), truth, share)


def main() -> None:
    """Measure, and write the scores."""
    parser = argparse.ArgumentParser(description="Measure the tracker beside other ways to find a ball.")
    parser.add_argument("--clips", type=int, default=10, help="runs of each set (default: 10)")
    parser.add_argument("--rows", type=int, default=1000, help="pictures of each run (default: 1000)")
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "tracking.json", help="file to write")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    busy = busy_cores()
    absent: dict[str, str] = {}
    scores: list[dict[str, Any]] = []
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for clip in range(options.clips):
        for name in SETS:
            scores += [asdict(one) for one in run_clip(name, clip, options.rows, absent)]
            told = ", ".join(
                f"{one['name']} {one['found']}/{one['visible']} {one['false']} false" for one in scores[-5:]
            )
            progress(f"{name} {clip}: {told}")
            results = {"machine": machine(), "busy": max(busy, busy_cores(0.5)), "absent": absent}
            unfinished = options.out.with_suffix(".part")
            unfinished.write_text(json.dumps({**results, "scores": scores}), encoding="utf-8")
            unfinished.replace(options.out)
    progress(f"wrote {options.out}")


if __name__ == "__main__":
    main()
