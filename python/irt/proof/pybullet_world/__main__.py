"""`python -m irt.proof.pybullet_world`: makes rigs on request, one line of JSON in, one line out.

    {"make": {"index": 3, "kind": "single", "folder": "rigs/rig-003", "seed": 7}}
    {"made": "rig-003", "label": {...}}
    {"record": {"index": 3, "kind": "single", "seed": 7, "csv": "step,knob_x_rad,..."}}
    {"csv": "step,knob_x_rad,..."}

Optional keys: "physics": ["lag"] selects the hidden physics, "engine": "mujoco" another engine, and
"tracker": "irt.tracking:positions" renders pictures and tracks them with that function. ``--tracker
MODULE:FUNCTION SHARE`` does so for a share of rigs; ``--thirds MODULE:FUNCTION`` records a third of the rigs
in PyBullet, a third in MuJoCo, and a third in PyBullet through the camera.

The training runs are written into the rig's folder. The label with the test runs is returned in memory;
`conceal` is its last step before it leaves this process. A further run of a rig is recorded from commands and
a start in row 0, with the same physics and the same tracker.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable
from importlib import import_module
from typing import Any, TextIO

import numpy as np

from .record import Watch, record, record_further
from .spec import Spec, draw


def make(
    *,
    index: int,
    kind: str,
    folder: str,
    seed: int,
    physics: Iterable[str] = (),
    tracker: str | None = None,
    engine: str = "pybullet",
) -> tuple[str, dict[str, Any]]:
    """Write the training runs of the rig with that index; return its name and its label.

    A `tracker`, given as "module:function", reads rendered pictures. The caller names it, because this
    package imports none.
    """
    spec = _drawn(index, kind, seed, physics, watched=tracker is not None, engine=engine)
    recorded = record(spec, None if tracker is None else _named(tracker))
    recorded.write(folder)
    return spec.name, recorded.label()


def further(
    *,
    index: int,
    kind: str,
    seed: int,
    csv: str,
    physics: Iterable[str] = (),
    tracker: str | None = None,
    engine: str = "pybullet",
) -> str:
    """Return a requested run of the rig with that index, as tracked."""
    spec = _drawn(index, kind, seed, physics, watched=tracker is not None, engine=engine)
    return record_further(spec, csv, None if tracker is None else _named(tracker))


def _drawn(index: int, kind: str, seed: int, physics: Iterable[str], *, watched: bool, engine: str) -> Spec:
    random = np.random.default_rng([seed, index])
    return draw(random, kind, f"rig-{index:03d}", list(physics), through_camera=watched, engine=engine)


def _named(tracker: str) -> Watch:
    module, _, function = tracker.partition(":")
    try:
        watch: Watch = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"no tracker {tracker!r}: {error}") from error
    return watch


def conceal(label: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a label that leaves this process; the hook for sealing it."""
    return {"label": label}


#: The world of a rig, by its index.
THIRDS = ("pybullet", "mujoco", "camera")


def serve(
    requests: Iterable[str],
    answers: TextIO,
    tracker: str | None = None,
    share: float = 0.0,
    *,
    thirds: bool = False,
) -> None:
    """Answer requests until the input ends; failures are answered by {"error": "..."}.

    A share of the rigs without a requested tracker is rendered and read by this one; with `thirds`, each
    third rig is, and each third is recorded in MuJoCo.
    """
    for line in requests:
        if not line.strip():
            continue
        try:
            ((verb, asked),) = json.loads(line).items()
            if thirds:
                world = THIRDS[asked["index"] % len(THIRDS)]
                more = {"tracker": tracker} if world == "camera" else {"engine": world}
                asked = {**more, **asked}
            elif tracker is not None and _is_watched(asked, share):
                asked = {"tracker": tracker, **asked}
            answers.write(json.dumps(_answered(verb, asked)) + "\n")
        except (KeyError, TypeError, ValueError, OSError, ImportError) as error:
            answers.write(json.dumps({"error": f"{type(error).__name__}: {error}"}) + "\n")
        answers.flush()


def _is_watched(asked: dict[str, Any], share: float) -> bool:
    """Return whether a rig is seen through a camera, the same for each request."""
    return bool(np.random.default_rng([asked["seed"], asked["index"], 1]).random() < share)


def _answered(verb: str, asked: dict[str, Any]) -> dict[str, Any]:
    if verb == "make":
        name, label = make(**asked)
        return {"made": name, **conceal(label)}
    if verb == "record":
        return {"csv": further(**asked)}
    raise ValueError(f"a request must be make or record, not {verb}")


def main() -> None:
    """Serve standard input; PyBullet's greeting must not reach the protocol on standard output."""
    parser = argparse.ArgumentParser(prog="python -m irt.proof.pybullet_world")
    parser.add_argument(
        "--tracker", nargs=2, metavar=("MODULE:FUNCTION", "SHARE"), help="of rigs seen through a camera"
    )
    parser.add_argument(
        "--thirds", metavar="MODULE:FUNCTION", help="a third each in PyBullet, in MuJoCo, through a camera"
    )
    args = parser.parse_args()
    tracker, share = args.tracker or (args.thirds, 0.0)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    serve(sys.stdin, answers, tracker, float(share), thirds=args.thirds is not None)


if __name__ == "__main__":
    main()
