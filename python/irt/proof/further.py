"""Benefit of `irt suggest`: diagnoses with a tie are repeated with one more run, suggested or random."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.files import read_json
from irt.proof.propose import RANDOM, SUGGESTED
from irt.proof.score import RigScore, naming
from irt.proof.world import World
from irt.workers import FAILED, Files, Workers
from irt.workers.processes import files_of

BLIND, PROPOSE = "irt.proof.blind", "irt.proof.propose"
KINDS = (SUGGESTED, RANDOM)
#: Name of the added run.
_NEXT = "train-next.csv"


@dataclass(frozen=True)
class Resolved:
    """A tie before and after one more run.

    Attributes
    ----------
    rig : str
        Its name.
    before : float
        Mean number of effects per name before it.
    after : dict
        The same after a ``suggested`` and after a ``random`` run.
    exact : dict
        Whether then exactly the hidden effects were named, without a tie.
    """

    rig: str
    before: float
    after: dict[str, float | None]
    exact: dict[str, bool]


def in_a_tie(answer: Path) -> bool:
    """Return whether a diagnosis named an effect that is confusable with another."""
    path = answer / "diagnosis.json"
    if not path.exists():
        return False
    content = read_json(path)
    tied = any(one["confusable_with"] for one in content["effects"])
    return bool(content["verdict"] == "missing" and tied)


def propose(workers: Workers, rigs: Mapping[str, Path], answers: Mapping[str, Path]) -> dict[str, Files]:
    """Return the commands of a suggested and of a random run for each rig; failed rigs are left out."""
    inputs = {
        name: {
            **files_of(folder),
            **{f"models/{key}": data for key, data in files_of(answers[name]).items()},
        }
        for name, folder in rigs.items()
    }
    with closing(workers.each(PROPOSE, inputs)) as proposed:
        return {name: files for name, files in proposed if FAILED not in files}


def recorded(world: World, asked: Mapping[str, Any], runs: Mapping[str, bytes]) -> dict[str, str] | None:
    """Return runs of a rig recorded by the concealed world, by kind; None if it supports no further runs.

    `asked` holds index, kind and seed of the rig, as they were when it was made.
    """
    try:
        return {
            kind: str(world.ask({"record": {**asked, "csv": runs[f"{kind}.csv"].decode()}})["csv"])
            for kind in KINDS
        }
    except IrtError:
        return None


def diagnosed(workers: Workers, rigs: Mapping[str, Path], runs: Mapping[str, Mapping[str, str]]) -> Any:
    """Yield (rig, kind, files) of repeated diagnoses with one more run."""
    inputs = {
        f"{name} {kind}": {**files_of(rigs[name]), _NEXT: csv.encode()}
        for name, of_rig in runs.items()
        for kind, csv in of_rig.items()
    }
    with closing(workers.each(BLIND, inputs)) as answers:
        for key, files in answers:
            name, kind = key.split(" ")
            yield name, kind, files


def resolved(score: RigScore, folder: Path) -> Resolved:
    """Return the result for the tie of a rig, from the folders of its further diagnoses."""
    after: dict[str, float | None] = {}
    exact = {}
    for kind in KINDS:
        path = folder / kind / "diagnosis.json"
        content = read_json(path) if path.exists() else {"verdict": "failed", "effects": []}
        again = naming(score.group, score.kinds, content)
        after[kind] = again["tie_size"]
        exact[kind] = bool(again["exact"] and not again["ties"])
    return Resolved(score.rig, score.tie_size or 1.0, after, exact)


def all_resolved(scores: Sequence[RigScore], folder: Path) -> list[Resolved]:
    """Return the results for all ties that contain the truth."""
    return [
        resolved(one, folder / one.rig)
        for one in scores
        if one.found and one.ties and (folder / one.rig).is_dir()
    ]
