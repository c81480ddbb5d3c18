"""From a spec to recordings on the disk and a label that never lies beside them."""

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
from .engine import Played, play
from .physics import EDGE_X_M, EDGE_Y_M, MASS_KG, RADIUS_M, Array
from .spec import TEST, TRAIN, Spec

#: What reads rendered runs: a picture of the board at the calibration, one from before the run, the
#: run's pictures, the board's length along x and y, the marble's radius [board edges]; to positions (n, 2).
#: Where it can make nothing of a run it raises a ValueError that says why.
Watch = Callable[[Picture, Picture, Iterable[Picture], tuple[float, float], float], Array]

#: Index of a run that is recorded later, for what is drawn in it.
FURTHER = TRAIN + TEST

#: Why a run that was read is lost all the same.
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
        What was simulated.
    commands : (runs, n, 2) array
        Knob angles [rad].
    clean : (runs, n, 2) array
        What a perfect tracker would have read [board edges].
    seen : (runs, n, 2) array
        What the tracker read [board edges], NaN where it lost the marble.
    sigma : float
        Standard deviation of what the tracker adds, but for outliers [board edges]; NaN if it read nothing.
    signal : float
        Mean absolute difference of paths with and without what is hidden, over the noise.
    refused : mapping of int to str
        Runs of which the tracker could make nothing, and why.
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
        """Return the runs that are no recordings, by name, and why: nothing sealed may look as if read."""
        return {
            name: self.refused.get(run, UNSEEN)
            for run, name in enumerate(self.names())
            if np.isnan(self.seen[run, 0]).any()
        }

    def label(self) -> dict[str, Any]:
        """Return the truth, and the test runs, as what JSON can hold."""
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
                "beyond": None if spec.beyond is None else dict(spec.beyond),
                "outliers": spec.outliers,
            },
            "sigma": _known(self.sigma),
            "noise": "tracker" if spec.through_camera else spec.noise,
            "signal": _known(self.signal),
            "drive": spec.drive,
            "starts": spec.starts,
            "through_camera": spec.through_camera,
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
    """Return what a diagnosis should say: a name, two, "none", "outliers" or "unlisted_" and a name."""
    if spec.beyond is not None:
        return f"unlisted_{spec.beyond['name']}"
    names = [str(one["name"]) for one in spec.effects]
    if not names:
        return "outliers" if spec.outliers else "none"
    return names if len(names) > 1 else names[0]


def record(spec: Spec, watch: Watch | None = None) -> Recorded:
    """Simulate all runs of a rig and read them as its tracker does.

    A run that the tracker cannot read is lost, and the rig stays: one drawn instead would be one that the
    tracker can read, and the proof would tell of such rigs alone.

    Raises
    ------
    ValueError
        If the rig is to be seen through a camera and nobody watches.
    """
    if spec.through_camera and watch is None:
        raise ValueError(f"{spec.name} is to be seen through a camera: say what reads its pictures")
    runs = range(TRAIN + TEST)
    played = [spec.play(run) for run in runs]
    refused: dict[int, str] = {}
    if watch is not None and spec.through_camera:
        clean = np.array([camera.perfect(spec, one) for one in played])
        seen, refused = _watched(spec, played, watch)
        # Of most samples: where the marble was lost or taken for another there is no noise to tell.
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
        commands=np.array([spec.excitation(run)[0] for run in runs]),
        clean=clean,
        seen=np.array([_jumped(spec, run, seen[run]) for run in runs]),
        sigma=sigma,
        signal=signal,
        refused=refused,
    )


def record_further(spec: Spec, csv: str, watch: Watch | None = None) -> str:
    """Record one more run of a rig, in the format of recordings: commands, and where row 0 shows the marble.

    Raises
    ------
    ValueError
        If the run cannot be read, or is to be seen through a camera and nobody watches.
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
    played = play(spec.base, commands, (float(x), float(y)), spec.hidden, spec.random(FURTHER, 1))
    if watch is not None and spec.through_camera:
        ((seen,), _) = _watched(spec, [played], watch, FURTHER)
    else:
        seen = played.seen + spec.sigma * noise.noise(spec.noise, len(commands), spec.random(FURTHER, 2))
    return _csv(commands, _jumped(spec, FURTHER, seen))


def _jumped(spec: Spec, run: int, seen: Array) -> Array:
    """Return a run with a rig's outliers; where nothing at all was read, nothing was taken for the marble."""
    if np.isnan(seen).all():
        return seen
    return noise.outliers(seen, spec.outliers, spec.random(run, 3))


def _watched(spec: Spec, played: list[Played], watch: Watch, first: int = 0) -> tuple[Array, dict[int, str]]:
    """Return what a tracker reads (runs, n, 2) [board edges] off pictures of runs, numbered from a first.

    Besides, the runs of which it can make nothing, and why: their positions are NaN.
    """
    edges = spec.observation_scale, spec.observation_scale * EDGE_Y_M / EDGE_X_M
    radius = spec.observation_scale * RADIUS_M / EDGE_X_M
    calibration, empty = camera.calibration(spec), camera.empty(spec)
    read, refused = [], {}
    for run, one in enumerate(played, start=first):
        # Rendered before they are read: what goes wrong there is no fault of the tracker's.
        pictures = list(camera.pictures(spec, run, one))
        try:
            read.append(watch(calibration, empty, pictures, edges, radius))
        except Exception as error:
            # Whatever it is: a tracker that breaks on a run has not read it, and that counts.
            read.append(np.full_like(one.seen, np.nan))
            refused[run] = f"{error}" if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return np.array(read), refused


def _known(value: float) -> float | None:
    """Return a number as JSON takes it: None for NaN, on which no seal can be put."""
    return None if math.isnan(value) else value


def _csv(commands: Array, marble: Array) -> str:
    lines = ["step,knob_x_rad,knob_y_rad,marble_x,marble_y"]
    for row, (knob, seen) in enumerate(zip(commands, marble, strict=True)):
        x, y = ("" if np.isnan(value) else f"{value:.6f}" for value in seen)
        lines.append(f"{row},{knob[0]:.6f},{knob[1]:.6f},{x},{y}")
    return "\n".join(lines) + "\n"


def _write(path: Path, text: str) -> None:
    """Write beside and move there, so that nobody reads half of it."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)
