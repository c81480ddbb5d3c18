"""The blind diagnosis: a separate process that receives only a rig's recordings.

    python -m irt.proof.blind FOLDER OUT

FOLDER is a copy of a rig's folder under a neutral name. The process writes into OUT: ``diagnosis.json``,
``base.toml``, ``model.toml``, a ``plausible-N.toml`` for each plausible model, their probabilities
(``plausible.json``), the code that found them (``code.json``), and ``seconds.json``. Except for the last, the
same recordings give the same bytes.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from irt.errors import IrtError
from irt.files import write_atomic
from irt.proof.provenance import this_code
from irt.proof.seal import canonical

#: CPU time of one core [s]; not reproducible, so it has its own file.
SECONDS = "seconds.json"
#: Version and digest of the code.
CODE = "code.json"
#: Probabilities of the plausible models, in order.
CHANCES = "plausible.json"


def main(words: Sequence[str]) -> int:
    """Diagnose the rig of one folder into another; return the exit status."""
    from irt.diagnosis.run import diagnose  # noqa: PLC0415
    from irt.model import save_model  # noqa: PLC0415

    folder, out = (Path(word) for word in words)
    began = time.process_time()
    try:
        found = diagnose(folder, seed=0, threads=1)
    except IrtError as error:
        print(error, file=sys.stderr)
        return 1
    content = found.as_dict()
    del content["settings"]["seconds"]
    save_model(out / "base.toml", found.base)
    save_model(out / "model.toml", found.model)
    for number, one in enumerate(found.plausible, start=1):
        save_model(out / f"plausible-{number}.toml", one.model)
    write_atomic(out / CHANCES, canonical({"probabilities": [one.probability for one in found.plausible]}))
    write_atomic(out / CODE, canonical({"code": this_code()}))
    write_atomic(out / SECONDS, canonical({"seconds": time.process_time() - began}))
    write_atomic(out / "diagnosis.json", canonical(content))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
