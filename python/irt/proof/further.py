"""What `irt suggest` is worth: diagnoses that ended in a tie get one more run, suggested or drawn blindly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.proof.hash_chain import read_json
from irt.proof.pipe import Pipe
from irt.proof.propose import RANDOM, SUGGESTED
from irt.proof.score import RigScore, naming
from irt.workers import FAILED, Files, Workers
from irt.workers.processes import files_of

BLIND, PROPOSE = "irt.proof.blind", "irt.proof.propose"
KINDS = (SUGGESTED, RANDOM)
#: Name of the run that is added.
_NEXT = "train-next.csv"


@dataclass(frozen=True)
class Resolved:
    """What became of a tie.

    Attributes
    ----------
    rig : str
        Its name.
    before : float
        Effects that a name stood for.
    after : dict
        The same after a ``suggested`` and after a ``random`` run.
    exact : dict
        Whether exactly what was hidden was named then, without a tie.
    """

    rig: str
    before: float
    after: dict[str, float | None]
    exact: dict[str, bool]


def in_a_tie(answer: Path) -> bool:
    """Whether a diagnosis named an effect and said that another would do as well."""
    path = answer / "diagnosis.json"
    if not path.exists():
        return False
    told = read_json(path)
    return bool(told["verdict"] == "missing" and any(one["confusable_with"] for one in told["effects"]))


def propose(workers: Workers, rigs: Mapping[str, Path], answers: Mapping[str, Path]) -> dict[str, Files]:
    """Return the commands of a suggested and of a random run for each rig; rigs that fail are left out."""
    inputs = {
        name: {
            **files_of(folder),
            **{f"models/{key}": data for key, data in files_of(answers[name]).items()},
        }
        for name, folder in rigs.items()
    }
    with closing(workers.each(PROPOSE, inputs)) as told:
        return {name: files for name, files in told if FAILED not in files}


def recorded(sealer: Pipe, index: int, runs: Mapping[str, bytes]) -> dict[str, str] | None:
    """Have the concealed world record runs, by kind; None where it can record no further ones."""
    try:
        return {
            kind: str(sealer.ask({"record": {"index": index, "csv": runs[f"{kind}.csv"].decode()}})["csv"])
            for kind in KINDS
        }
    except IrtError:
        return None


def diagnosed(workers: Workers, rigs: Mapping[str, Path], runs: Mapping[str, Mapping[str, str]]) -> Any:
    """Yield (rig, kind, files) for rigs that are diagnosed again, with one run more."""
    inputs = {
        f"{name} {kind}": {**files_of(rigs[name]), _NEXT: csv.encode()}
        for name, of_rig in runs.items()
        for kind, csv in of_rig.items()
    }
    with closing(workers.each(BLIND, inputs)) as told:
        for key, files in told:
            name, kind = key.split(" ")
            yield name, kind, files


def resolved(score: RigScore, folder: Path) -> Resolved:
    """Return what became of the tie of a rig, from the folders of its further diagnoses."""
    after: dict[str, float | None] = {}
    exact = {}
    for kind in KINDS:
        path = folder / kind / "diagnosis.json"
        told = read_json(path) if path.exists() else {"verdict": "failed", "effects": []}
        again = naming(score.group, score.kinds, told)
        after[kind] = again["tie_size"]
        exact[kind] = bool(again["exact"] and not again["ties"])
    return Resolved(score.rig, score.tie_size or 1.0, after, exact)


def all_resolved(scores: Sequence[RigScore], folder: Path) -> list[Resolved]:
    """Return what became of each tie that held the truth."""
    return [
        resolved(one, folder / one.rig)
        for one in scores
        if one.found and one.ties and (folder / one.rig).is_dir()
    ]
