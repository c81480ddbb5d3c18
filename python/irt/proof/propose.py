"""The next run for a diagnosis with a tie, in a separate process: one suggested, one random.

    python -m irt.proof.propose FOLDER OUT

FOLDER holds the recordings and, under ``models/``, the diagnosis' output. The process writes the commands of
two runs into OUT, with the marble's start in row 0: ``suggested.csv`` by `irt suggest`, ``random.csv`` from
the same families.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from irt.engine import SUBSTEP_S
from irt.errors import IrtError
from irt.files import read_json
from irt.fitting.least_squares import stamped_time_scale
from irt.model import load_model
from irt.proof.blind import CHANCES
from irt.recording import save_recording
from irt.rig import Rig, load_rig
from irt.suggestion import suggest
from irt.suggestion.excitations import FAMILIES, GENES, Excitation, Limits, draw

SUGGESTED, RANDOM = "suggested", "random"


def main(words: Sequence[str]) -> int:
    """Write the commands of two runs; return the exit status."""
    folder, out = (Path(word) for word in words)
    try:
        rig = load_rig(folder)
        diagnosis = read_json(folder / "models" / "diagnosis.json")
        chances = read_json(folder / "models" / CHANCES)["probabilities"]
        models = [
            load_model(folder / "models" / f"plausible-{number}.toml")
            for number in range(1, len(chances) + 1)
        ]
        found = suggest(rig, models, diagnosis["fit"]["noise"], probabilities=chances, seed=0, threads=1)
        found.save(out / f"{SUGGESTED}.csv")
        save_random(rig, out / f"{RANDOM}.csv")
    except IrtError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def save_random(rig: Rig, path: Path) -> None:
    """Write a random run from the families of `irt suggest`, within the rig's limits."""
    run = random_run(rig, np.random.default_rng(0))
    save_recording(path, run.commands, np.vstack([run.start, np.full_like(run.commands[1:], np.nan)]))


def random_run(rig: Rig, random: np.random.Generator) -> Excitation:
    """Draw a run from the families of `irt suggest`, within the rig's limits."""
    stamped = stamped_time_scale(rig)
    family = str(random.choice(list(FAMILIES)))
    limits = Limits.of(rig, None if stamped is None else stamped * SUBSTEP_S)
    return draw(family, random.random(GENES), limits)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
