"""Methods on a real recording, scored on held-out runs."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from irt.diagnosis.run import diagnose
from irt.errors import IrtError
from irt.files import read_text, write_atomic
from irt.fitting.fit import Progress
from irt.model import Model
from irt.paper.setting import Setting, within
from irt.report.tuning_report import untuned
from irt.residual import evaluate
from irt.rig import Rig, load_rig
from irt.tuning import tune

#: Methods of `irt tune` with default settings that need no network; its training for a drive of many windows
#: would take longer than the rest of the page.
METHODS = ("cma-es", "least-squares")
#: Share of the recordings that is held out, from the end.
_HELD_OUT = 1 / 3
#: Length of the predicted windows [s].
WINDOW_S = 2.0


@dataclass(frozen=True)
class Judged:
    """Mean absolute errors over windows [board edges], and the number of simulated rollouts.

    Attributes
    ----------
    name : str
        "untuned", a method, or "diagnosed: ..." with the named effects, or the verdict without any.
    tuned, heldout : float
        On the recordings used for tuning, and on the held-out ones.
    rollouts : int
    """

    name: str
    tuned: float
    heldout: float
    rollouts: int


def judge(setting: Setting, folder: Path, progress: Progress | None = None) -> list[Judged]:
    """Tune to a rig by several methods and diagnose it; stored results are reused.

    Raises
    ------
    IrtError
        If the rig has fewer than two recordings, or is invalid.
    """
    rig = load_rig(folder)
    count = len(rig.recordings)
    if count < 2:
        raise IrtError(f"{folder}: expected at least two recordings, one to tune to and one held out")
    first = count - max(1, round(_HELD_OUT * count))
    given, heldout = (
        replace(rig, recordings=part) for part in (rig.recordings[:first], rig.recordings[first:])
    )
    kept = setting.out / "real" / f"{folder.resolve().name}.json"
    errors: dict[str, dict[str, Any]] = json.loads(read_text(kept)) if kept.exists() else {}
    if "untuned" not in errors:
        errors["untuned"] = _errors(untuned(given), given, heldout, 0)
        _keep(kept, errors)
    for name in METHODS:
        if name not in errors:
            result = tune(given, name, threads=setting.threads, progress=within(progress, name))
            errors[name] = _errors(result.model, given, heldout, result.rollouts)
            _keep(kept, errors)
    if not any(name.startswith("diagnosed") for name in errors):
        found = diagnose(given, threads=setting.threads, progress=within(progress, "diagnosis"))
        named = ", ".join(one.name for one in found.effects) or found.verdict
        errors[f"diagnosed: {named}"] = _errors(found.model, given, heldout, 0)
        _keep(kept, errors)
    return [Judged(name, **numbers) for name, numbers in errors.items()]


def _keep(path: Path, errors: dict[str, dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, json.dumps(errors, indent=1) + "\n")


def _errors(model: Model, given: Rig, heldout: Rig, rollouts: int) -> dict[str, Any]:
    tuned, unseen = (evaluate(model, rig.recordings, WINDOW_S).windowed for rig in (given, heldout))
    if tuned is None or unseen is None:
        raise IrtError(f"{given.path}: no window of {WINDOW_S:g} s fits into its recordings")
    return {"tuned": tuned.mae, "heldout": unseen.mae, "rollouts": rollouts}
