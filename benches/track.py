"""Compare the tracker with other ball detectors on rendered runs, into ``target/tracking.json``.

    python benches/track.py && python benches/write_table.py

The sets are described in `tracking.sets`. Reported runs begin at number 300 (``--first``); the tracker was
developed on others. CPU time on one core. Needs trackpy of ``benches/requirements.txt``, and cyclonedds for
the time from a picture to its published point; without them these are left out, as the table says.
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
from irt.tracking.blob_detector import Box
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
#: Distance, in radii of the marble, above which a position is false; so is any position of a hidden marble.
FALSE_RADII = 1.0
#: A marble is visible if this share of it is.
VISIBLE = 0.75
#: Number of pictures for which the others get the marble's position.
GIVEN = 10
#: Interval of pictures that are also searched as a whole, to time it.
WHOLE_EVERY = 20
#: Topic of the published points.
TOPIC, DOMAIN = "/bench/marble/position", 87


@dataclass
class Score:
    """Scores of one method on one run; times in seconds."""

    name: str
    set: str
    clip: int
    radius: float
    squares: float = 0.0
    given: int = 0
    false: int = 0
    visible: int = 0
    found: int = 0
    pictures: int = 0
    farthest: float = 0.0
    seconds: float = 0.0
    window: list[float] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)
    whole: list[float] = field(default_factory=list)
    published: list[float] = field(default_factory=list)
    failed: str = ""

    def add(self, seen: Array, truth: Array, visible: float) -> None:
        """Count a picture."""
        self.pictures += 1
        apart = float(np.hypot(*(seen - truth)))
        there = not np.isnan(seen[0])
        wrong = there and not (apart <= FALSE_RADII * self.radius and visible > 0.0)
        self.false += wrong
        self.visible += visible >= VISIBLE
        self.found += visible >= VISIBLE and there and not wrong
        if there and not wrong:
            self.given += 1
            self.squares += apart**2
            self.farthest = max(self.farthest, apart)


class Taker:
    """Processes pictures like `irt track --publish`, with the time of each."""

    def __init__(
        self, tracker: Tracker, pose: Pose, score: Score, publish: Callable[..., None] | None
    ) -> None:
        self._tracker, self._pose, self._score, self._publish = tracker, pose, score, publish

    def see(self, picture: Picture) -> tuple[float, float]:
        """Return the marble's centre [pixels]."""
        start, wall = time.process_time(), time.perf_counter()
        found = self._tracker.see(picture)
        (self._score.window if found.in_window else self._score.lost).append(time.process_time() - start)
        if found.seen and self._publish is not None:
            x, y = self._pose.positions(np.array([[found.x, found.y]]))[0]
            self._publish(float(x), float(y), time.time())
            self._score.published.append(time.perf_counter() - wall)
        return found.x, found.y


def progress(text: str) -> None:
    """Print progress to stderr."""
    print(text, file=sys.stderr, flush=True)


def publisher(absent: dict[str, str]) -> Callable[..., None] | None:
    """Return a publisher of points; None if unavailable."""
    try:
        from irt.tracking.live import Publisher  # noqa: PLC0415

        return Publisher(TOPIC, DOMAIN).publish
    except IrtError as error:
        absent["publishing"] = str(error)
        return None


def run_clip(
    name: str,
    clip: int,
    options: argparse.Namespace,
    absent: dict[str, str],
    publish: Callable[..., None] | None,
) -> list[Score]:
    """Return the scores of all methods on one run."""
    scene = SETS[name](clip, options.rows)
    frames = [scene.frame(index) for index in range(options.rows)]
    pictures = [picture for picture, _ in frames]
    truths = np.array([truth.pixel for _, truth in frames])
    visible = [truth.visible for _, truth in frames]
    radius = scene.view.focal * RADIUS_M / float(np.linalg.norm(scene.view.eye))
    score = Score(OURS, name, clip, radius)
    _count(score, _ours(scene, pictures, score, publish), pictures, truths, visible)
    scores = [score]
    few = slice(0, options.others)
    for rival, way in rivals(pictures[:GIVEN], truths[:GIVEN], radius, _box(scene), absent).items():
        score = Score(rival, name, clip, radius)
        _count(score, way.see, pictures[few], truths[few], visible[few])
        scores.append(score)
    return scores


def _box(scene: Scene) -> Box:
    """Return the board's box in the pictures, with some margin."""
    low, high = scene.corners().min(axis=0) - 20.0, scene.corners().max(axis=0) + 20.0
    left, top, right, bottom = (int(one) for one in np.clip([*low, *high], 0, [640, 480, 640, 480]))
    return Box(left, top, right, bottom)


def _ours(
    scene: Scene, pictures: list[Picture], score: Score, publish: Callable[..., None] | None
) -> Callable[[Picture], tuple[float, float]]:
    """Return the tracker, prepared on a run like `irt track`."""
    lens = Lens(scene.view.matrix, scene.view.distortion, (scene.view.width, scene.view.height), 0.0)
    sample = [pictures[one] for one in np.linspace(0, len(pictures) - 1, SAMPLE).astype(int)]
    try:
        corners = ordered(find_corners(pictures[0], lens), SIZE)
        pose = Pose.of(lens, corners, SIZE.corners, SIZE.radius)
        learned = learn(sample, pose, board_box(corners, pose, lens.size))
    except IrtError as error:
        score.failed = str(error)
        return lambda picture: (np.nan, np.nan)
    tracker = Tracker(learned, scale_of(pose, learned.finder.middle))
    for picture in pictures[::WHOLE_EVERY]:
        start = time.process_time()
        tracker.everywhere(picture)
        score.whole.append(time.process_time() - start)
    if learned.first is not None:
        tracker.expect(*learned.first)
    return Taker(tracker, pose, score, publish).see


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
    parser = argparse.ArgumentParser(description="Compare the tracker with other ball detectors.")
    parser.add_argument("--clean", type=int, default=6, help="runs of the clean set (default: 6)")
    parser.add_argument("--hard", type=int, default=14, help="runs of the hard set (default: 14)")
    parser.add_argument("--first", type=int, default=300, help="number of the first run (default: 300)")
    parser.add_argument("--rows", type=int, default=500, help="pictures of each run (default: 500)")
    parser.add_argument("--others", type=int, default=40, help="of these, for the others (default: 40)")
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "tracking.json", help="file to write")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    busy = busy_cores()
    absent: dict[str, str] = {}
    publish = publisher(absent)
    scores: list[dict[str, Any]] = []
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for count in range(max(options.clean, options.hard)):
        clip = options.first + count
        for name, runs in (("clean", options.clean), ("hard", options.hard)):
            if count >= runs:
                continue
            found = run_clip(name, clip, options, absent, publish)
            scores += [asdict(one) for one in found]
            progress(
                f"{name} {clip}: "
                + ", ".join(f"{one.name} {one.found}/{one.visible} {one.false} false" for one in found)
            )
        results = {"machine": machine(), "busy": busy, "absent": absent, "scores": scores}
        unfinished = options.out.with_suffix(".part")
        unfinished.write_text(json.dumps(results), encoding="utf-8")
        unfinished.replace(options.out)
    progress(f"wrote {options.out}")


if __name__ == "__main__":
    main()
