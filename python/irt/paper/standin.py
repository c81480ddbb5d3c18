"""Experiment 2 (paper, section 6.2) on a simulated laboratory, because the recordings are not public."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.run import diagnose
from irt.extras import require
from irt.files import read_text, write_atomic
from irt.fitting.fit import Progress
from irt.fitting.least_squares import least_squares
from irt.model import Effect, Model
from irt.paper.contenders import METHODS, Held, Trials, available
from irt.paper.errors import median_interval
from irt.paper.setting import ROLLOUTS, Setting, digest, within
from irt.proof.world import World
from irt.residual import evaluate
from irt.rig import PARAMETERS, Rig, load_rig

Array = NDArray[np.float64]

#: The paper's Table 1: minimum state MAE, and rollouts to reach it.
PAPERS_TABLE = {"cma-es": (0.0668, 30), "direct": (0.346, 0), "irt-paper": (0.0402, 5)}
#: Number of rollouts for this project's promises.
FEW = 5
_STARTS = 7
#: An effect of the laboratory that is random in every run, so that it cannot be fitted.
_BY_CHANCE = "delay_jitter"
#: The process that records the rigs.
LABORATORY = (sys.executable, "-m", "irt.paper.laboratory")


@dataclass(frozen=True)
class Diagnosed:
    """Result of a rig's diagnosis: mean absolute errors of free runs [board edges].

    Attributes
    ----------
    names : tuple of str
        The effects that it named.
    verdict : str
        "sufficient", "missing" or "unlisted".
    plain, plain_again : float
        Errors of five parameters fitted to the first run alone: on that run, and on the repeated drive.
    full, full_again : float
        The same of the model that the diagnosis left behind.
    oracle, oracle_again : float
        The same of a model that is given the effects that the rig has, and fitted to all of its recordings;
        delays that differ by chance cannot be fitted. No diagnosis can be expected to get below that.
    """

    names: tuple[str, ...]
    verdict: str
    plain: float
    plain_again: float
    full: float
    full_again: float
    oracle: float
    oracle_again: float


@dataclass(frozen=True, eq=False)
class Experiment2:
    """Results of Experiment 2.

    Attributes
    ----------
    setting : Setting
        The settings.
    truths : list of dict
        True parameters and effects of each rig.
    random, middle : dict of Held
        Proposals of each method, by its key: from random starts (Table 1), and from the middle (Fig. 8).
    trials : Trials
        Observations of the rigs, and the random start points.
    diagnosed : list of Diagnosed
        Diagnoses of the first rigs.
    """

    setting: Setting
    truths: list[dict[str, Any]]
    trials: Trials
    random: Mapping[str, Held]
    middle: Mapping[str, Held]
    diagnosed: list[Diagnosed]

    def rows(self) -> list[Row]:
        """Return the rows of Table 1."""
        return [Row.of(name, held) for name, held in self.random.items()]

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers as JSON content."""
        return {
            "rigs": len(self.truths),
            "table1": {row.name: vars(row) for row in self.rows()},
            "papers_table1": {name: list(row) for name, row in PAPERS_TABLE.items()},
            "diagnosed": [vars(one) for one in self.diagnosed],
        }


@dataclass(frozen=True)
class Row:
    """A row of Table 1: medians over the rigs, each with the ends of its 95 % interval.

    Attributes
    ----------
    name : str
        Key of the method.
    minimum, rollouts, final, early : tuple
        Smallest state MAE over all rollouts, number of rollouts to reach it, state MAE at the end, and the
        best one after `FEW` rollouts [board edges].
    failures : int
        Number of rigs on which the error grew.
    """

    name: str
    minimum: tuple[float, float, float]
    rollouts: tuple[float, float, float]
    final: tuple[float, float, float]
    early: tuple[float, float, float]
    failures: int

    @classmethod
    def of(cls, name: str, held: Held) -> Row:
        """Return the row of a method."""
        best = np.minimum.accumulate(held.mae, axis=1)
        return cls(
            name,
            _median(held.mae.min(axis=1)),
            _median(held.mae.argmin(axis=1).astype(np.float64)),
            _median(held.mae[:, -1]),
            _median(best[:, FEW]),
            int((held.mae[:, -1] > held.mae[:, 0]).sum()),
        )


def experiment2(
    setting: Setting, methods: Sequence[str] | None = None, progress: Progress | None = None
) -> Experiment2:
    """Record rigs, tune to each by every method, diagnose some; existing results are reused.

    Raises
    ------
    IrtError
        If a package is missing, or a file cannot be read or written.
    """
    truths = _recorded(setting, progress)
    folders = [_folder(setting, rig) for rig in range(setting.rigs)]
    observed = np.array([_target(folder).recordings[0].marble for folder in folders])
    random = np.random.default_rng([setting.seed, _STARTS]).random((setting.rigs, len(PARAMETERS)))
    trials = Trials(observed, random)
    held: dict[str, dict[str, Held]] = {"random": {}, "middle": {}}
    for start, chosen in (("random", trials), ("middle", replace(trials, start=np.full_like(random, 0.5)))):
        of = digest(chosen.observed, chosen.start)
        for name in available() if methods is None else methods:
            kept = setting.kept(
                setting.folder("experiment-2") / f"{name}-{start}.npz",
                lambda name=name, chosen=chosen: vars(  # type: ignore[misc]
                    METHODS[name].tune(setting, chosen, within(progress, f"{name}, rigs"))
                ),
                of=of,
                rollouts=ROLLOUTS,
            )
            held[start][name] = Held(**kept)
    diagnosed = [
        _diagnosed(setting, rig, within(progress, f"diagnosis {rig + 1} of {setting.diagnosed}"))
        for rig in range(min(setting.diagnosed, setting.rigs))
    ]
    return Experiment2(setting, truths, trials, held["random"], held["middle"], diagnosed)


def _folder(setting: Setting, rig: int) -> Path:
    return setting.out / "rigs" / f"rig-{setting.seed}-{rig:03d}"


def _target(folder: Path) -> Rig:
    """Return a rig with only the recording to tune to."""
    rig = load_rig(folder)
    return replace(rig, recordings=tuple(one for one in rig.recordings if one.name == "paper-1"))


def _recorded(setting: Setting, progress: Progress | None) -> list[dict[str, Any]]:
    """Record missing rigs in the laboratory; return the truths.

    Rigs to be diagnosed need more than the run to tune to.
    """

    def there(rig: int) -> bool:
        last = "heldout/paper-3.csv" if rig < setting.diagnosed else "paper-1.csv"
        return all((_folder(setting, rig) / name).exists() for name in (last, "truth.json"))

    missing = [rig for rig in range(setting.rigs) if not there(rig)]
    if missing:
        require("pybullet", "the laboratory")
        with World(LABORATORY, "the laboratory") as laboratory:
            for done, rig in enumerate(missing):
                folder = _folder(setting, rig)
                asked = {"rig": rig, "seed": setting.seed, "folder": str(folder)}
                answer = laboratory.ask({"record": {**asked, "whole": rig < setting.diagnosed}})
                write_atomic(folder / "truth.json", json.dumps(answer["truth"], indent=1) + "\n")
                if progress:
                    progress(done + 1, len(missing), "recording in PyBullet")
    return [json.loads(read_text(_folder(setting, rig) / "truth.json")) for rig in range(setting.rigs)]


def _diagnosed(setting: Setting, rig: int, progress: Progress | None) -> Diagnosed:
    """Diagnose a rig from all recordings except the held-out one; return the errors."""
    folder = _folder(setting, rig)
    kept = folder / "diagnosed.json"
    target, again = _target(folder), load_rig(folder / "heldout")
    found: dict[str, Any] = json.loads(read_text(kept)) if kept.exists() else {}
    if "full" not in found:
        plain = least_squares(target, seed=setting.seed, threads=setting.threads).model
        answer = diagnose(load_rig(folder), seed=setting.seed, threads=setting.threads, progress=progress)
        found = {"names": [one.name for one in answer.effects], "verdict": answer.verdict}
        for name, model in (("plain", plain), ("full", answer.model)):
            found |= {name: _mae(model, target), f"{name}_again": _mae(model, again)}
        write_atomic(kept, json.dumps(found, indent=1) + "\n")
    if "oracle" not in found:
        oracle = _oracle(setting, folder)
        found |= {"oracle": _mae(oracle, target), "oracle_again": _mae(oracle, again)}
        write_atomic(kept, json.dumps(found, indent=1) + "\n")
    # A file of an earlier version holds other keys besides.
    known = {one.name: found[one.name] for one in fields(Diagnosed)}
    return Diagnosed(**{**known, "names": tuple(known["names"])})


def _oracle(setting: Setting, folder: Path) -> Model:
    """Fit a rig with the effects that it truly has, from their true values; delays by chance are left out."""
    true = json.loads(read_text(folder / "truth.json"))["effects"]
    effects = [
        Effect(one["name"], {name: value for name, value in one.items() if name != "name"})
        for one in true
        if one["name"] != _BY_CHANCE
    ]
    rig = load_rig(folder)
    return least_squares(rig, effects=effects, seed=setting.seed, threads=setting.threads).model


def _mae(model: Model, rig: Rig) -> float:
    return evaluate(model, rig.recordings).mae


def _median(values: Array) -> tuple[float, float, float]:
    return (float(np.median(values)), *median_interval(values))
