"""A path-traced video of a tilting board with a concealed effect: tracked, diagnosed, named.

Runs where Mitsuba 3 is installed (``benches/render_traced.py`` says how); it renders for some minutes.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from filmed_runs import BACKLASH, played, write_commands
from irt.recording import load_recording
from irt.tracking.calibration import save_lens
from irt.tracking.geometry import Lens
from tracking.cases import EDGES_M, Shine, case
from tracking.traced import Traced

pytestmark = pytest.mark.slow

ROWS, RUNS = 60, 3


def filmed(folder: Path, seed: int) -> tuple[Path, Path, Lens, np.ndarray]:
    """Return a video, its commands, the lens and the true tilts (n, 2) [rad] of one run."""
    knobs, places, tilts = played(ROWS, seed, BACKLASH)
    shine = Shine("painted", (0.04, 0.09, 0.45), 0.08)
    run = replace(case(0, ROWS), shine=shine, places=places, tilts=tilts)
    pictures = folder / f"run-{seed}"
    pictures.mkdir()
    for index, (picture, _) in enumerate(Traced(run, samples=0.4).frames()):
        cv2.imwrite(str(pictures / f"{index}.png"), picture)
    commands = write_commands(folder / f"knobs-{seed}.csv", knobs)
    size = run.view.width, run.view.height
    return pictures, commands, Lens(run.view.matrix, run.view.distortion, size, 0.1), tilts


def test_an_effect_concealed_in_a_video_is_named(irt, tmp_path) -> None:
    pytest.importorskip("mitsuba")
    out = tmp_path / "rig"
    out.mkdir()
    (out / "rig.toml").write_text(f"[board]\nedge_x_m = {EDGES_M[0]}\nedge_y_m = {EDGES_M[1]}\n")
    for seed in range(20, 20 + RUNS):
        pictures, commands, lens, tilts = filmed(tmp_path, seed)
        save_lens(out / "camera.toml", lens, 12)
        words = ("--fps", "30", "--commands", commands, "--offset", "0", "--out", out)
        done = irt("track", pictures, *words)
        assert done.status == 0, done.err
        measured = load_recording(out / f"{pictures.name}.csv").tilt
        assert measured is not None
        # The zero is the mean of the run.
        missed = (measured - tilts[: len(measured)]) - np.mean(measured - tilts[: len(measured)], axis=0)
        assert missed.std() < 0.001
    done = irt("diagnose", out, "--out", tmp_path / "diagnosed")
    assert done.status == 0, done.err
    diagnosis = json.loads((tmp_path / "diagnosed" / "diagnosis.json").read_text())
    assert "backlash" in [effect["name"] for effect in diagnosis["effects"]]
