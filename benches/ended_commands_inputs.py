"""The commands that `ended_commands.py` disturbs, and what they work on: as little as they take."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from irt.engine import rollouts
from irt.recording import save_recording
from tracking.board import Paint
from tracking.scene import Look, Scene
from tracking.view import View

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
TRUTH = (0.08, 0.07, 4e-4, 8.0, 1.0)
BACKLASH = {"name": "backlash", "width_x_rad": 0.06, "width_y_rad": 0.05}


@dataclass(frozen=True)
class Case:
    """A command that writes files.

    Attributes
    ----------
    name : str
        In the table.
    words : tuple of str
        Its arguments; inputs are in ``in``, results go to ``out``.
    prepare : callable
        Writes the inputs into a folder.
    needs : str
        A package without which the command is left out.
    """

    name: str
    words: tuple[str, ...]
    prepare: Callable[[Path], None] = lambda to: None
    needs: str = ""


def drive(rows: int, seed: int) -> Array:
    """Return knob angles (rows, 2) [rad]: sums of sines at 30 rows a second, from rest."""
    random = np.random.default_rng(seed)
    time = np.arange(rows)[:, None, None] / 30.0
    waves = np.sin(2 * np.pi * (time * random.uniform(0.2, 0.9, (2, 3)) + random.random((2, 3))))
    moved: Array = 0.05 * waves.sum(axis=2) * np.minimum(4 * time[:, 0], 1.0)
    return moved


def rig(folder: Path, runs: int, rows: int) -> None:
    """Write recordings of a rig with backlash."""
    folder.mkdir()
    for run in range(runs):
        knobs = drive(rows, run)
        marble = rollouts([TRUTH], knobs, effects=[BACKLASH])[0]
        marble[1:] += 0.001 * np.random.default_rng(run).standard_normal((rows - 1, 2))
        save_recording(folder / f"run-{run + 1}.csv", knobs, marble, np.arange(rows) / 30.0)


def rigs(folder: Path) -> None:
    """Write two rigs."""
    rig(folder / "a", 2, 40)
    rig(folder / "b", 2, 50)


def film(folder: Path) -> None:
    """Film 60 pictures of a run, and write its commands."""
    knobs = drive(60, 5)
    places, tilts = rollouts([TRUTH], knobs, tilt=True)
    view = View.above(220.0, lean=(0.05, -0.08), size=(320, 240))
    scene = Scene(view, Paint(lines=2, holes=2), Look("blue"), places[0], tilts[0])
    (folder / "film").mkdir()
    for index, (picture, _) in enumerate(scene.frames()):
        cv2.imwrite(str(folder / "film" / f"{index}.png"), picture)
    rows = [f"{i},{i / 30:.6f},{x!r},{y!r}" for i, (x, y) in enumerate(knobs.tolist())]
    (folder / "commands.csv").write_text("\n".join(["step,t_s,knob_x_rad,knob_y_rad", *rows]) + "\n")


def log(folder: Path) -> None:
    """Write the log of a CyberRunner without ROS, 60 s long."""
    sent = 100.0 * drive(2400, 7)
    places, tilts = rollouts([(0.009, 0.009, 4e-4, 6.0, 1.0)], sent, tilt=True)
    noise = np.random.default_rng(0).standard_normal((2400, 2))
    rows = ["t,episode,step,xb,yb,alpha,beta,a0,a1,ball_found"]
    for i, ((x, y), (a, b), (u, v)) in enumerate(zip(places[0] + 5e-4 * noise, tilts[0], sent, strict=True)):
        place = f"{0.276 * x:.5f},{0.276 * y:.5f}"
        rows.append(f"{i / 40:.3f},{i // 800},{i % 800},{place},{-b:.5f},{a:.5f},{u:.4f},{v:.4f},1")
    (folder / "log.csv").write_text("\n".join(rows) + "\n")


_ONE_THREAD = ("--out", "out", "--threads", "1")
_NETWORK = ("--out", "out/net.safetensors", "--device", "cpu", "--threads", "1")
#: A proof of one rig whose world is the tests' own, of a few rows.
_WORLD = f"{sys.executable} {ROOT / 'tests' / 'unit' / 'proof' / 'fake_world.py'}"
_PROOF = ("prove", "--rigs", "1", "--nulls", "0", "--seed", "3", "--jobs", "1", "--out", "out")

CASES = (
    Case("irt diagnose", ("diagnose", "in/rig", *_ONE_THREAD), lambda to: rig(to / "rig", 2, 40)),
    Case("irt diagnose (two rigs)", ("diagnose", "in/a", "in/b", "--out", "out", "--jobs", "2"), rigs),
    Case("irt prove", (*_PROOF, "--world", _WORLD)),
    Case("irt pretrain", ("pretrain", "--pairs", "4", "--epochs", "2", *_NETWORK), needs="torch"),
    Case("irt track", ("track", "in/film", "--commands", "in/commands.csv", "--out", "out"), film),
    Case("irt import", ("import", "in/log.csv", "--out", "out"), log),
    Case("irt reproduce", ("reproduce", "symmetry", "--targets", "2", "--rigs", "2", *_ONE_THREAD)),
    Case("irt tune", ("tune", "in/rig", *_ONE_THREAD), lambda to: rig(to / "rig", 2, 40)),
)
