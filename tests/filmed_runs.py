"""Runs on a board that a camera sees: commands, and rendered pictures whose truth is known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from irt.engine import rollouts
from irt.tracking.geometry import Lens
from tracking.board import Paint
from tracking.scene import Look, Scene
from tracking.view import View

VIEW = View.above(300.0, lean=(0.05, -0.08))
LENS = Lens(VIEW.matrix, VIEW.distortion, (640, 480), 0.1)
TRUTH = (0.08, 0.07, 4e-4, 8.0, 1.0)
BACKLASH = {"name": "backlash", "width_x_rad": 0.06, "width_y_rad": 0.05}
RATE = 30.0


def played(rows: int, seed: int, *effects: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return commands, places and tilts (rows, 2) of a marble that rolls at 30 rows a second."""
    random = np.random.default_rng(seed)
    time = np.arange(rows)[:, None, None] / RATE
    waves = np.sin(2 * np.pi * (time * random.uniform(0.2, 0.9, (2, 3)) + random.random((2, 3))))
    knobs = 0.05 * waves.sum(axis=2) * np.minimum(4 * time[:, 0], 1.0)
    places, tilts = rollouts([TRUTH], knobs, effects=effects or None, tilt=True)
    return knobs, places[0], tilts[0]


def film(path: Path, tilts: np.ndarray, places: np.ndarray, **settings: object) -> Scene:
    """Render a run into a folder of images."""
    scene = Scene(VIEW, Paint(lines=2, holes=2), Look("blue"), places, tilts, seed=5, **settings)
    path.mkdir()
    for index, (picture, _) in enumerate(scene.frames()):
        cv2.imwrite(str(path / f"{index}.png"), picture)
    return scene


def write_commands(path: Path, knobs: np.ndarray, first: float = 0.0) -> Path:
    """Write commands with stamps that begin at a time [s]."""
    rows = [f"{i},{first + i / RATE:.6f},{x!r},{y!r}" for i, (x, y) in enumerate(knobs.tolist())]
    path.write_text("\n".join(["step,t_s,knob_x_rad,knob_y_rad", *rows]) + "\n")
    return path
