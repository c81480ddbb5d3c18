"""`python -m irt.paper.laboratory`: a stand-in for the paper's laboratory, in another engine (PyBullet).

    {"record": {"rig": 3, "seed": 7, "folder": "rigs/rig-003", "whole": true}}
    {"truth": {"gear_x": ..., "effects": [{"name": "lag", ...}, ...], "sigma": ...}}

A process of its own, on the physics of `irt.proof.pybullet_world`, which shares no line with this package's
simulator. Every rig has what the paper names of its real one (section 7): friction with a grain, delays of
the motor that differ from command to command, and a marble that is not quite round; and besides a controller
that lags, a board that lies above its axes, so that the picture shifts as it tilts, and a camera with noise.
Sizes are drawn for each rig.

The folder gets the run to tune to, of the paper's drive (``paper-1``). For a diagnosis the whole rig is
recorded: the same drive again (``paper-2``), runs of other drives, and in a folder ``heldout`` the paper's
drive a third time.
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
from irt.proof.pybullet_world.engine import play
from irt.proof.pybullet_world.record import RIG_TOML
from irt.proof.pybullet_world.spec import Spec
from irt.recording import save_recording

Array = NDArray[np.float64]

#: What every rig has, and between which strengths of `irt.proof.pybullet_world` it is drawn: from hardly
#: there to what the marble shows at once.
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
#: Runs of other drives, and how the kinds of `irt.proof.pybullet_world.drives` are drawn for them.
OTHERS = 6
_RUNS = ("paper-1", "paper-2", *(f"other-{run + 1}" for run in range(OTHERS)))
_HELDOUT = "paper-3"


def draw(rig: int, seed: int) -> Spec:
    """Draw a rig; its five parameters move the marble well about the board, as the paper's do."""
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
    """Write the recordings of a rig, all or the first alone; return what it truly is."""
    spec = draw(rig, seed)
    places = [*((name, folder) for name in _RUNS), (_HELDOUT, folder / "heldout")]
    for name, place in places if whole else places[:1]:
        make_folder(place)
        write_atomic(place / "rig.toml", RIG_TOML)
        commands, seen = _run(spec, (*_RUNS, _HELDOUT).index(name), paper=name.startswith("paper"))
        save_recording(place / f"{name}.csv", commands, seen)
    return {**vars(spec.base), "effects": [dict(one) for one in spec.effects], "sigma": spec.sigma}


def _run(spec: Spec, run: int, *, paper: bool) -> tuple[Array, Array]:
    """Return the commands and what the camera saw of a run."""
    if paper:
        phase = 2.0 * np.pi * np.arange(ROWS) / ROWS
        commands, start = AMPLITUDE * np.stack([np.sin(phase), np.cos(phase)], axis=1), (0.0, 0.0)
    else:
        commands, start = replace(spec, starts="anywhere").excitation(run)
    played = play(spec.base, commands, start, spec.hidden, spec.random(run, 1))
    return commands, played.seen + spec.sigma * noise.noise("white", len(commands), spec.random(run, 2))


def serve(requests: Iterable[str], answers: TextIO) -> None:
    """Answer requests until there are no more."""
    for line in requests:
        asked = json.loads(line)["record"]
        truth = record(
            int(asked["rig"]), int(asked["seed"]), Path(asked["folder"]), whole=bool(asked["whole"])
        )
        answers.write(json.dumps({"truth": truth}) + "\n")
        answers.flush()


def main() -> None:
    """Serve standard input; PyBullet's greeting on standard output must not reach the one who asks."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    serve(sys.stdin, answers)


if __name__ == "__main__":
    main()
