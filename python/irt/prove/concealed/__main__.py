"""`python -m irt.prove.concealed`: makes rigs on request, one line of JSON in, one line out.

    {"make": {"index": 3, "kind": "single", "folder": "rigs/rig-003", "seed": 7}}
    {"made": "rig-003", "label": {...}}

Besides, "physics": ["lag"] says what to hide, and "tracker": "irt.tracking:positions" has the rig seen
through a camera and read by that function.

The rig's folder gets the training runs. The label, test runs and all, goes to whoever asked, in memory: what
becomes of it before it leaves this process is `conceal`'s.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable
from importlib import import_module
from typing import Any, TextIO

import numpy as np

from .record import Watch, record
from .spec import draw


def make(
    *,
    index: int,
    kind: str,
    folder: str,
    seed: int,
    physics: Iterable[str] = (),
    tracker: str | None = None,
) -> tuple[str, dict[str, Any]]:
    """Write the training runs of the rig with that index; return its name and its label.

    A `tracker`, named as "module:function", reads the rig off rendered pictures. It is named by who asks, as
    this package knows of none.
    """
    name = f"rig-{index:03d}"
    through_camera = tracker is not None
    spec = draw(np.random.default_rng([seed, index]), kind, name, list(physics), through_camera)
    recorded = record(spec, None if tracker is None else _named(tracker))
    recorded.write(folder)
    return name, recorded.label()


def _named(tracker: str) -> Watch:
    module, _, function = tracker.partition(":")
    try:
        watch: Watch = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"no tracker {tracker!r}: {error}") from error
    return watch


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
