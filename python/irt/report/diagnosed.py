"""What a diagnosis leaves behind, and the diagnosis as a process of its own, one of many.

    python -m irt.report.diagnosed FOLDER OUT SEED

FOLDER holds the rig's files in a folder ``rig``, and in a file ``path`` where the user has them. OUT gets
``diagnosis.json``, ``model.toml``, a ``plausible-N.toml`` for each model that may be the true one,
``report.html`` and the pictures.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from irt.diagnosis.result import Diagnosis
from irt.diagnosis.run import diagnose
from irt.errors import IrtError
from irt.files import write_atomic
from irt.model import Model, load_model, save_model
from irt.report.diagnosis_report import write_diagnosis_report
from irt.rig import MOST_ROWS, Rig, load_rig


@dataclass(frozen=True)
class Left:
    """What a diagnosis left for the design of the next run.

    Attributes
    ----------
    summary : str
        The answer.
    noise : float
        Standard deviation of the tracker [board edges].
    models, probabilities : list
        Models that may be the true one, the answer first, and how probable each is.
    """

    summary: str
    noise: float
    models: list[Model]
    probabilities: list[float]


def load_plausible(folder: Path) -> Left:
    """Read from the folder of a diagnosis which models may be the true one.

    Raises
    ------
    IrtError
        If no diagnosis was written there, or it names no such models.
    """
    try:
        content = json.loads((folder / "diagnosis.json").read_bytes())
        named = [(str(one["model"]), float(one["probability"])) for one in content["plausible"]]
        summary, noise = str(content["summary"]), float(content["fit"]["noise"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise IrtError(f"{folder}: no diagnosis with plausible models: run irt diagnose again") from error
    return Left(summary, noise, [load_model(folder / name) for name, _ in named], [one for _, one in named])


def write_diagnosis(folder: Path, rig: Rig, found: Diagnosis, notes: Sequence[str] = ()) -> Path:
    """Write model, page and numbers into a folder, and return the page's path.

    Parameters
    ----------
    folder : Path
        One that is there.
    rig : Rig
        What was diagnosed.
    found : Diagnosis
        The outcome.
    notes : sequence of str
        What to say beside the warnings of the check.

    Raises
    ------
    IrtError
        If a file cannot be written.
    """
    warnings = (*notes, *found.warnings)
    save_model(folder / "model.toml", found.model)
    names = [f"plausible-{number}.toml" for number in range(1, len(found.plausible) + 1)]
    for name, one in zip(names, found.plausible, strict=True):
        save_model(folder / name, one.model)
    for path in set(folder.glob("plausible-*.toml")) - {folder / name for name in names}:
        path.unlink()
    page = write_diagnosis_report(folder, rig, found, warnings)
    # The numbers come last: where they are, the rest is whole.
    stamped = all(recording.stamps is not None for recording in rig.recordings)
    content = {
        **found.as_dict(),
        "time_base": "stamps" if stamped else "unknown: no stamps",
        "warnings": warnings,
        "plausible": [
            {"model": name, "probability": one.probability}
            for name, one in zip(names, found.plausible, strict=True)
        ],
    }
    numbers = json.dumps(content, indent=2, allow_nan=False)
    write_atomic(folder / "diagnosis.json", f"{numbers}\n")
    return page


def main(words: Sequence[str]) -> int:
    """Diagnose the one rig of a folder into another; return the exit status."""
    folder, out, seed = Path(words[0]), Path(words[1]), int(words[2])
    try:
        path = Path((folder / "path").read_text(encoding="utf-8"))
        rig = replace(load_rig(folder / "rig"), path=path).first_rows(MOST_ROWS)
        write_diagnosis(out, rig.of_marbles(), diagnose(rig, seed=seed, threads=1))
    except IrtError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
