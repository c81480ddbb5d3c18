"""Render path-traced runs into folders, each a video or images and its truth, for `track_traced.py`.

    python benches/render_traced.py --out DIR 0 1 2

Wants the PyPI package mitsuba, in an environment of its own, an LLVM that it can load (19 or later;
``DRJIT_LIBLLVM_PATH`` says where) or ``--variant scalar_rgb``, and imageio-ffmpeg for runs in H.264. A run of
100 pictures takes about two minutes on one core.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracking.cases import KINDS, LOOKS, LOOKS_FROM, PICTURES, Case, case
from tracking.mixed import MIXED_FROM, mixed
from tracking.traced import VARIANT, Traced

RATE = 30.0
#: From one picture of H.264 that stands alone to the next.
KEY = 30


class H264:
    """A video in H.264, at the bit rate of a webcam."""

    def __init__(self, path: Path, size: tuple[int, int], kbps: int) -> None:
        writers = importlib.import_module("imageio_ffmpeg")
        self._writer = writers.write_frames(
            str(path),
            size,
            fps=RATE,
            codec="libx264",
            bitrate=f"{kbps}k",
            macro_block_size=1,
            pix_fmt_in="bgr24",
            output_params=["-g", str(KEY)],
        )
        self._writer.send(None)

    def write(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture."""
        self._writer.send(np.ascontiguousarray(picture))

    def release(self) -> None:
        """End the video."""
        self._writer.close()


def _video(run: Case, folder: Path) -> Any:
    """Return what a run's pictures are written to."""
    size = run.view.width, run.view.height
    if run.codec == "h264":
        return H264(folder / "run.mp4", size, run.kbps)
    suffix = "avi" if run.codec == "MJPG" else "mp4"
    video = cv2.VideoWriter(str(folder / f"run.{suffix}"), cv2.VideoWriter.fourcc(*run.codec), RATE, size)
    if run.codec == "MJPG":
        video.set(cv2.VIDEOWRITER_PROP_QUALITY, run.quality)
    return video


def _break(path: Path, count: int) -> None:
    """Flip bytes of a video's pictures, as a bad line does; the index at its end stays."""
    content = bytearray(path.read_bytes())
    random = np.random.default_rng(len(content))
    for place in random.integers(len(content) // 10, 8 * len(content) // 10, count):
        content[place] ^= 0xFF
    path.write_bytes(content)


def write(number: int, pictures: int, folder: Path, variant: str, samples: float) -> None:
    """Render a run, and write what was shown beside what is true."""
    start = time.monotonic()
    run = (mixed if number >= MIXED_FROM else case)(number, pictures)
    traced = Traced(run, samples, variant)
    folder.mkdir(parents=True, exist_ok=True)
    size = run.view.width, run.view.height
    video = None
    if run.codec != "png":
        video = _video(run, folder)
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
        if run.broken:
            _break(folder / "run.mp4", run.broken)
    known = {
        "kind": run.kind,
        "rim": run.rim,
        "radius_m": run.radius_m,
        "edges_m": run.edges_m,
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
        "numbers",
        type=int,
        nargs="+",
        help=f"runs; their kinds go around {', '.join(KINDS)}, from {LOOKS_FROM} on {', '.join(LOOKS)}, "
        f"from {MIXED_FROM} on drawn independently",
    )
    parser.add_argument("--pictures", type=int, default=PICTURES, help=f"of each run (default: {PICTURES})")
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument(
        "--variant", default=VARIANT, help=f"of Mitsuba; scalar_rgb needs no LLVM (default: {VARIANT})"
    )
    parser.add_argument(
        "--samples", type=float, default=1.0, help="share of the usual samples to a pixel (default: 1)"
    )
    options = parser.parse_args()
    for number in options.numbers:
        write(number, options.pictures, options.out / f"{number:03d}", options.variant, options.samples)


if __name__ == "__main__":
    main()
