"""`python -m irt.prove.concealed`: makes rigs on request, one line of JSON in, one line out.

    {"make": {"index": 3, "kind": "single", "folder": "rigs/rig-003", "seed": 7}}
    {"made": "rig-003", "label": {...}}

The rig's folder gets the training runs. The label, test runs and all, goes to whoever asked, in memory: what
becomes of it before it leaves this process is `conceal`'s.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable
from typing import Any, TextIO

import numpy as np

from .record import record
from .spec import draw


def make(
    index: int,
    kind: str,
    folder: str,
    seed: int,
    physics: Iterable[str] = (),
) -> tuple[str, dict[str, Any]]:
    """Write the training runs of the rig with that index; return its name and its label."""
    name = f"rig-{index:03d}"
    spec = draw(np.random.default_rng([seed, index]), kind, name, list(physics))
    recorded = record(spec)
    recorded.write(folder)
    return name, recorded.label()


def conceal(label: dict[str, Any]) -> dict[str, Any]:
    """Return what leaves this process of a label: the place where it is to be sealed."""
    return {"label": label}


def serve(requests: Iterable[str], answers: TextIO) -> None:
    """Answer requests until there are no more; one that cannot be met is answered by {"error": "..."}."""
    for line in requests:
        if not line.strip():
            continue
        try:
            name, label = make(**json.loads(line)["make"])
            answer: dict[str, Any] = {"made": name, **conceal(label)}
        except (KeyError, TypeError, ValueError, OSError, ImportError) as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def main() -> None:
    """Serve standard input; whatever else writes to standard output must not reach the one who asks."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    serve(sys.stdin, answers)


if __name__ == "__main__":
    main()
