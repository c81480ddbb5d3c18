"""What a diagnosis leaves behind, and the diagnosis as a process of its own, one of many.

    python -m irt.report.diagnosed FOLDER OUT SEED

FOLDER holds the rig's files in a folder ``rig``, and in a file ``path`` where the user has them. OUT gets
``diagnosis.json``, ``model.toml``, ``report.html`` and the pictures.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from irt.checking import check
from irt.diagnosis.result import Diagnosis
from irt.diagnosis.run import diagnose
from irt.errors import IrtError
from irt.files import write_atomic
from irt.model import save_model
from irt.report.diagnosis_report import write_diagnosis_report
from irt.rig import MOST_ROWS, Rig, load_rig


def write_diagnosis(folder: Path, rig: Rig, found: Diagnosis, warnings: Sequence[str] = ()) -> Path:
    """Write model, page and numbers into a folder, and return the page's path.

    Parameters
    ----------
    folder : Path
        One that is there.
    rig : Rig
        What was diagnosed.
    found : Diagnosis
        The outcome.
    warnings : sequence of str
        What a check of the recordings warned of.

    Raises
    ------
    IrtError
        If a file cannot be written.
    """
    save_model(folder / "model.toml", found.model)
    page = write_diagnosis_report(folder, rig, found, warnings)
    # The numbers come last: where they are, the rest is whole.
    stamped = all(recording.stamps is not None for recording in rig.recordings)
    content = {
        **found.as_dict(),
        "time_base": "stamps" if stamped else "unknown: no stamps",
        "warnings": warnings,
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
        checked = check(rig, threads=1)
        checked.require()
        rig = rig.of_marbles()
        write_diagnosis(out, rig, diagnose(rig, seed=seed, threads=1), checked.warnings)
    except IrtError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
