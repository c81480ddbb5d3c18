"""From a spec to recordings on disk and a separate label."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import camera, noise
from .camera import Picture
from .physics import EDGE_X_M, EDGE_Y_M, MASS_KG, RADIUS_M, Array
from .played import Played, play
from .spec import TEST, TRAIN, Spec

#: A tracker of rendered runs. Its arguments are the calibration's picture of the board, one from before the
#: run, the run's pictures, the board's length along x and y, and the marble's radius [board edges]; it
#: returns positions (n, 2), or raises a ValueError with the reason for an unreadable run.
Watch = Callable[[Picture, Picture, Iterable[Picture], tuple[float, float], float], Array]

#: Index of a run that is recorded later, for its random numbers.
FURTHER = TRAIN + TEST

#: Reason for a run that is lost although it was read.
UNSEEN = "no marble in the first picture, where every prediction starts"

RIG_TOML = f"""\
[board]
edge_x_m = {EDGE_X_M}
edge_y_m = {EDGE_Y_M}
wall_restitution = 0.0
wall_friction = 0.25

[marble]
radius_m = {RADIUS_M}
mass_kg = {MASS_KG}
"""


@dataclass(frozen=True)
class Recorded:
    """The runs of a rig, training runs first.

    Attributes
    ----------
    spec : Spec
        The simulated rig.
    commands : (runs, n, 2) array
        Knob angles [rad].
    clean : (runs, n, 2) array
        Positions of a perfect tracker [board edges].
    seen : (runs, n, 2) array
        Tracked positions [board edges], NaN where the tracker lost the marble.
    sigma : float
        Standard deviation of the tracker's noise without outliers [board edges]; NaN if it read nothing.
    signal : float
        Mean absolute difference of paths with and without the hidden physics, divided by the noise.
    refused : mapping of int to str
        Unreadable runs and the reasons.
    """

    spec: Spec
    commands: Array
    clean: Array
    seen: Array
    sigma: float
    signal: float
    refused: Mapping[int, str]

    def names(self) -> list[str]:
        """Return the names of the runs: train-1 and so on, then test-1 and so on."""
        return [f"train-{run + 1}" for run in range(TRAIN)] + [f"test-{run + 1}" for run in range(TEST)]

    def text(self, run: int) -> str:
        """Return a run in the format of recordings."""
        return _csv(self.commands[run], self.seen[run])

    def lost(self) -> dict[str, str]:
        """Return the unreadable runs by name, with the reasons, so that a seal does not pass them as read."""
        return {
            name: self.refused.get(run, UNSEEN)
            for run, name in enumerate(self.names())
            if np.isnan(self.seen[run, 0]).any()
        }

    def label(self) -> dict[str, Any]:
        """Return the truth and the test runs as JSON content."""
        spec = self.spec
        tests = {
            name: {"csv": self.text(run), "clean": self.clean[run].tolist()}
            for run, name in enumerate(self.names())
            if run >= TRAIN
        }
        return {
            "kind": kind(spec),
            "truth": {
                **vars(spec.base),
                "effects": [dict(one) for one in spec.effects],
                "out_of_catalogue": None if spec.out_of_catalogue is None else dict(spec.out_of_catalogue),
                "outliers": spec.outliers,
            },
            "sigma": _known(self.sigma),
            "noise": "tracker" if spec.through_camera else spec.noise,
            "signal": _known(self.signal),
            "drive": spec.drive,
            "starts": spec.starts,
            "through_camera": spec.through_camera,
            "engine": spec.engine,
            "lost": self.lost(),
            "tests": tests,
        }

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write the training runs and `rig.toml` into a folder, and nothing else."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        _write(folder / "rig.toml", RIG_TOML)
        for run, name in enumerate(self.names()[:TRAIN]):
            _write(folder / f"{name}.csv", self.text(run))


def kind(spec: Spec) -> str | list[str]:
    """Return the right answer: one name, two, "none", "outliers" or "unlisted_" and a name."""
    if spec.out_of_catalogue is not None:
        return f"unlisted_{spec.out_of_catalogue['name']}"
    names = [str(one["name"]) for one in spec.effects]
    if not names:
        return "outliers" if spec.outliers else "none"
    return names if len(names) > 1 else names[0]


def record(spec: Spec, watch: Watch | None = None) -> Recorded:
    """Simulate all runs of a rig and track them.

    An unreadable run is lost and the rig is kept. A redrawn rig would be a readable one, which would bias the
    proof towards such rigs.

    Raises
    ------
    ValueError
        If the rig is seen through a camera and there is no tracker.
    """
    if spec.through_camera and watch is None:
        raise ValueError(f"{spec.name} is to be seen through a camera: say what reads its pictures")
    runs = range(TRAIN + TEST)
    played = [spec.play(run) for run in runs]
    refused: dict[int, str] = {}
    if watch is not None and spec.through_camera:
        clean = np.array([camera.perfect(spec, one) for one in played])
        seen, refused = _watched(spec, played, watch)
        # From most samples only: lost rows and outliers do not show the noise.
        missed = np.abs(seen - clean)[~np.isnan(seen)]
        sigma = 1.4826 * float(np.median(missed)) if len(missed) else math.nan
    else:
        clean, sigma = np.array([one.seen for one in played]), spec.sigma
        seen = clean + sigma * np.array(
            [noise.noise(spec.noise, len(clean[run]), spec.random(run, 2)) for run in runs]
        )
    signal = math.nan if math.isnan(sigma) else 0.0
    if spec.hidden and sigma > 0.0:
        signal = float(np.mean([spec.missed(run, played[run]) for run in range(TRAIN)])) / sigma
    return Recorded(
        spec=spec,
        commands=np.array([one.commands for one in played]),
        clean=clean,
        seen=np.array([_jumped(spec, run, seen[run]) for run in runs]),
        sigma=sigma,
        signal=signal,
        refused=refused,
    )


def record_further(spec: Spec, csv: str, watch: Watch | None = None) -> str:
    """Record one more run of a rig from commands and a position in row 0, in the format of recordings.

    Raises
    ------
    ValueError
        If the run is unreadable, or is seen through a camera without a tracker.
    """
    if spec.through_camera and watch is None:
        raise ValueError(f"{spec.name} is to be seen through a camera: say what reads its pictures")
    table = np.genfromtxt(csv.splitlines(), delimiter=",", names=True)
    commands = np.column_stack([table["knob_x_rad"], table["knob_y_rad"]])
    room = np.array([EDGE_X_M, EDGE_Y_M]) / 2.0 - RADIUS_M
    shown = np.array([table["marble_x"][0], table["marble_y"][0]])
    if not (np.isfinite(commands).all() and np.isfinite(shown).all()):
        raise ValueError("a run to record needs a command in every row, and a position in row 0")
    x, y = np.clip(shown * EDGE_X_M / spec.observation_scale, -room, room)
    start_m, random = (float(x), float(y)), spec.random(FURTHER, 1)
    played = play(spec.base, commands, start_m, spec.hidden, random, engine=spec.moved_by)
    if watch is not None and spec.through_camera:
        ((seen,), _) = _watched(spec, [played], watch, FURTHER)
    else:
        seen = played.seen + spec.sigma * noise.noise(spec.noise, len(commands), spec.random(FURTHER, 2))
    return _csv(commands, _jumped(spec, FURTHER, seen))


def _jumped(spec: Spec, run: int, seen: Array) -> Array:
    """Return a run with a rig's outliers; an unreadable run has none."""
    if np.isnan(seen).all():
        return seen
    return noise.outliers(seen, spec.outliers, spec.random(run, 3))


def _watched(spec: Spec, played: list[Played], watch: Watch, first: int = 0) -> tuple[Array, dict[int, str]]:
    """Return tracked positions (runs, n, 2) [board edges] of rendered runs, numbered from a first.

    Also returns the unreadable runs with the reasons; their positions are NaN.
    """
    edges = spec.observation_scale, spec.observation_scale * EDGE_Y_M / EDGE_X_M
    radius = spec.observation_scale * RADIUS_M / EDGE_X_M
    calibration, empty = camera.calibration(spec), camera.empty(spec)
    read, refused = [], {}
    for run, one in enumerate(played, start=first):
        # Rendered before the tracking, so that errors of rendering do not count as the tracker's.
        pictures = list(camera.pictures(spec, run, one))
        try:
            read.append(watch(calibration, empty, pictures, edges, radius))
        except Exception as error:
            # Any exception: a tracker that fails on a run has not read it.
            read.append(np.full_like(one.seen, np.nan))
            refused[run] = f"{error}" if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return np.array(read), refused


def _known(value: float) -> float | None:
    """Return a number as JSON content: None for NaN, which cannot be sealed."""
    return None if math.isnan(value) else value


def _csv(commands: Array, marble: Array) -> str:
    lines = ["step,knob_x_rad,knob_y_rad,marble_x,marble_y"]
    for row, (knob, seen) in enumerate(zip(commands, marble, strict=True)):
        x, y = ("" if np.isnan(value) else f"{value:.6f}" for value in seen)
        lines.append(f"{row},{knob[0]:.6f},{knob[1]:.6f},{x},{y}")
    return "\n".join(lines) + "\n"


def _write(path: Path, text: str) -> None:
    """Write a temporary file and rename it, so that no reader sees a part."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)
