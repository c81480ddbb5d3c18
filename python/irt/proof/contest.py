"""The other methods: a separate process that receives the diagnosis' input and the commands to predict.

    python -m irt.proof.contest FOLDER OUT

FOLDER holds the recordings, ``models/base.toml`` and ``tests/*.csv``, which contain the commands and the
rows where a prediction starts. The process writes ``baselines.json`` into OUT.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from irt.errors import IrtError
from irt.files import write_atomic
from irt.proof.baselines import alone, gaussian, neural, sindy, single, sysid, whiteness
from irt.proof.baselines.entry import Entry, Method, Task
from irt.proof.seal import canonical

#: By name, in the order of the tables.
METHODS: dict[str, tuple[str, Method]] = {
    one.__name__.rpartition(".")[2]: (one.TITLE, one.enter)
    for one in (alone, single, gaussian, neural, sysid, sindy, whiteness)
}


def main(words: Sequence[str]) -> int:
    """Run every method; return the exit status."""
    folder, out = (Path(word) for word in words)
    try:
        task = Task.load(folder)
    except IrtError as error:
        print(error, file=sys.stderr)
        return 1
    answers = {}
    for name, (_, method) in METHODS.items():
        began = time.process_time()
        entry = _entered(method, task)
        answers[name] = {**entry.as_dict(), "seconds": time.process_time() - began}
    write_atomic(out / "baselines.json", canonical(answers))
    return 0


def _entered(method: Method, task: Task) -> Entry:
    """Return a method's answer, or an empty one with the error if it fails."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            return method(task)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
            return Entry(missing=f"broke down: {error}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
