"""`python -m irt.paper.laboratory`: a stand-in for the paper's laboratory, in another engine (PyBullet).

    {"record": {"rig": 3, "seed": 7, "folder": "rigs/rig-003", "whole": true}}
    {"truth": {"gear_x": ..., "effects": [{"name": "lag", ...}, ...], "sigma": ...}}

A separate process with the physics of `irt.proof.pybullet_world`, which is independent of this package's
simulator. Every rig has the effects that the paper names for its real one (section 7): anisotropic friction,
motor delays that vary from command to command, and an uneven marble. It also has a controller lag, parallax
of a board above its axes, and camera noise. Sizes are drawn for each rig.

The run to tune to, with the paper's drive, is written into the folder (``paper-1``). For a diagnosis the
whole rig is recorded: the same drive again (``paper-2``), runs of other drives, and the paper's drive a third
time in a folder ``heldout``.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from irt.files import make_folder, write_atomic
from irt.proof.pybullet_world import noise
from irt.proof.pybullet_world.effects import EFFECTS
from irt.proof.pybullet_world.played import Commands, play
from irt.proof.pybullet_world.record import RIG_TOML
from irt.proof.pybullet_world.spec import Spec
from irt.recording import save_recording

Array = NDArray[np.float64]

#: Effects of every rig, and the range of strengths in `irt.proof.pybullet_world`: from hardly noticeable to
#: obvious.
EFFECTS_DRAWN = {
    "delay_jitter": (0.2, 0.6),
    "lag": (0.5, 0.9),
    "eccentric_marble": (0.4, 0.9),
    "anisotropic_friction": (0.4, 0.9),
    "parallax": (0.3, 0.8),
}
#: Noise of the camera [board edges]: 0.2 to 0.8 mm.
SIGMA = (0.0007, 0.003)
#: The paper's drive: rows and amplitude [rad].
ROWS, AMPLITUDE = 100, 0.1
#: Number of runs of other drives, and the weights of the kinds of `irt.proof.pybullet_world.drives`.
OTHERS = 6
_RUNS = ("paper-1", "paper-2", *(f"other-{run + 1}" for run in range(OTHERS)))
_HELDOUT = "paper-3"


def draw(rig: int, seed: int) -> Spec:
    """Draw a rig; with its five parameters the marble moves over most of the board, as in the paper."""
    random = np.random.default_rng([seed, rig])
    known = {one.name: one for one in EFFECTS}
    gear_x, gear_y = random.uniform(0.02, 0.08, 2).tolist()
    return Spec(
        name=f"rig-{rig:03d}",
        seed=int(random.integers(2**62)),
        gear_x=gear_x,
        gear_y=gear_y,
        rolling_friction=float(random.uniform(1e-4, 6e-4)),
        time_scale=float(random.integers(12, 30)),
        observation_scale=float(random.uniform(0.94, 1.06)),
        effects=tuple(
            known[name].draw(random, float(random.uniform(*strengths))).parameters()
            for name, strengths in EFFECTS_DRAWN.items()
        ),
        sigma=float(np.exp(random.uniform(*np.log(SIGMA)))),
        drive="mixed",
        starts="anywhere",
    )


def record(rig: int, seed: int, folder: Path, *, whole: bool) -> dict[str, Any]:
    """Write the recordings of a rig, all or only the first one; return the truth."""
    spec = draw(rig, seed)
    places = [*((name, folder) for name in _RUNS), (_HELDOUT, folder / "heldout")]
    for name, place in places if whole else places[:1]:
        make_folder(place)
        write_atomic(place / "rig.toml", RIG_TOML)
        commands, seen = _run(spec, (*_RUNS, _HELDOUT).index(name), paper=name.startswith("paper"))
        save_recording(place / f"{name}.csv", commands, seen)
    return {**vars(spec.base), "effects": [dict(one) for one in spec.effects], "sigma": spec.sigma}


def _run(spec: Spec, run: int, *, paper: bool) -> tuple[Array, Array]:
    """Return the commands and the tracked positions of a run."""
    commands: Commands
    if paper:
        phase = 2.0 * np.pi * np.arange(ROWS) / ROWS
        commands, start = AMPLITUDE * np.stack([np.sin(phase), np.cos(phase)], axis=1), (0.0, 0.0)
    else:
        commands, start = replace(spec, starts="anywhere").excitation(run)
    played = play(spec.base, commands, start, spec.hidden, spec.random(run, 1))
    noisy = played.seen + spec.sigma * noise.noise("white", len(played.seen), spec.random(run, 2))
    return played.commands, noisy


def serve(requests: Iterable[str], answers: TextIO) -> None:
    """Answer requests until the input ends."""
    for line in requests:
        asked = json.loads(line)["record"]
        truth = record(
            int(asked["rig"]), int(asked["seed"]), Path(asked["folder"]), whole=bool(asked["whole"])
        )
        answers.write(json.dumps({"truth": truth}) + "\n")
        answers.flush()


def main() -> None:
    """Serve standard input; PyBullet's greeting must not reach the protocol on standard output."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    serve(sys.stdin, answers)


if __name__ == "__main__":
    main()
