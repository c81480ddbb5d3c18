"""Render path-traced runs into folders, each a video or images and its truth, for `track_traced.py`.

    python benches/render_traced.py --out DIR 0 1 2

Wants the PyPI package mitsuba, in an environment of its own, and an LLVM that it can load (19 or later;
``DRJIT_LIBLLVM_PATH`` says where). A run of 100 pictures takes about a minute on one core.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import cv2

from tracking.cases import KINDS, PICTURES, case
from tracking.traced import Traced

RATE = 30.0


def write(number: int, pictures: int, folder: Path) -> None:
    """Render a run, and write what was shown beside what is true."""
    start = time.monotonic()
    run = case(number, pictures)
    traced = Traced(run)
    folder.mkdir(parents=True, exist_ok=True)
    size = run.view.width, run.view.height
    video = None
    if run.codec != "png":
        suffix = "avi" if run.codec == "MJPG" else "mp4"
        video = cv2.VideoWriter(str(folder / f"run.{suffix}"), cv2.VideoWriter.fourcc(*run.codec), RATE, size)
    else:
        (folder / "run").mkdir(exist_ok=True)
    truths = []
    for index, (picture, truth) in enumerate(traced.frames()):
        if video is None:
            cv2.imwrite(str(folder / "run" / f"{index:04d}.png"), picture)
        else:
            video.write(picture)
        truths.append(truth)
    if video is not None:
        video.release()
    known = {
        "kind": run.kind,
        "rim": run.rim,
        "radius_m": run.radius_m,
        "matrix": run.view.matrix.tolist(),
        "size": size,
        "radius_px": run.view.focal * run.radius_m / float((run.view.eye**2).sum() ** 0.5),
        "corners": traced.corners().tolist(),
        "pixels": [one.pixel.tolist() for one in truths],
        "places": [one.place.tolist() for one in truths],
        "tilts": run.tilts.tolist(),
    }
    (folder / "truth.json").write_text(json.dumps(known), encoding="utf-8")
    print(f"{number} ({run.kind}): {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Render path-traced runs.")
    parser.add_argument(
        "numbers", type=int, nargs="+", help=f"runs; their kinds go around {', '.join(KINDS)}"
    )
    parser.add_argument("--pictures", type=int, default=PICTURES, help=f"of each run (default: {PICTURES})")
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    options = parser.parse_args()
    for number in options.numbers:
        write(number, options.pictures, options.out / f"{number:03d}")


if __name__ == "__main__":
    main()
