"""Write the results of a diagnosis to a folder; run as a module, diagnose one rig in its own process.

    python -m irt.report.diagnosed FOLDER OUT SEED

FOLDER holds the rig's files in a folder ``rig``, and their original path in a file ``path``. OUT receives
``diagnosis.json``, ``model.toml``, a ``plausible-N.toml`` for each plausible model, ``report.html`` and the
pictures.
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
class PlausibleModels:
    """Results of a diagnosis that the design of the next run needs.

    Attributes
    ----------
    summary : str
        The summary of the diagnosis.
    noise : float
        Standard deviation of the tracker [board edges].
    models, probabilities : list
        Plausible models, the reported one first, and their probabilities.
    """

    summary: str
    noise: float
    models: list[Model]
    probabilities: list[float]


def load_plausible(folder: Path) -> PlausibleModels:
    """Read the plausible models from the folder of a diagnosis.

    Raises
    ------
    IrtError
        If the folder holds no diagnosis, or one without plausible models.
    """
    try:
        content = json.loads((folder / "diagnosis.json").read_bytes())
        named = [(str(one["model"]), float(one["probability"])) for one in content["plausible"]]
        summary, noise = str(content["summary"]), float(content["fit"]["noise"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise IrtError(f"{folder}: no diagnosis with plausible models; run irt diagnose again") from error
    return PlausibleModels(
        summary, noise, [load_model(folder / name) for name, _ in named], [one for _, one in named]
    )


def write_diagnosis(folder: Path, rig: Rig, found: Diagnosis, notes: Sequence[str] = ()) -> Path:
    """Write the models, the report and the numbers into a folder, and return the report's path.

    Parameters
    ----------
    folder : Path
        An existing folder.
    rig : Rig
        The diagnosed rig.
    found : Diagnosis
        The diagnosis.
    notes : sequence of str
        Notes to show with the warnings of the check.

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
    # diagnosis.json comes last: its presence marks a complete result.
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
    """Diagnose the rig of one folder, write the results to another, and return the exit status."""
    folder, out, seed = Path(words[0]), Path(words[1]), int(words[2])
    try:
        path = Path((folder / "path").read_text(encoding="utf-8"))
        rig = replace(load_rig(folder / "rig"), path=path).first_rows(MOST_ROWS)
        write_diagnosis(out, rig.of_marbles(with_tilt=True), diagnose(rig, seed=seed, threads=1))
    except IrtError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
