"""Prove a diagnosis on a real rig: seal the tilt, diagnose without it, open it, compare."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from irt.diagnosis.result import Diagnosis
from irt.diagnosis.run import diagnose
from irt.engine import SUBSTEP_S
from irt.files import make_folder, read_json, write_atomic
from irt.fitting.least_squares import least_squares
from irt.fitting.unfinished import Unfinished
from irt.model import Effect, Model, load_model, save_model
from irt.proof.provenance import this_code
from irt.proof.real.response import Comparison, Response, compared, response, widened
from irt.proof.real.seal import Folders, close, measured, seal
from irt.report.diagnosed import write_diagnosis
from irt.report.tuning_report import untuned
from irt.rig import MOST_ROWS, Rig, load_rig
from irt.tilt_errors import AxisErrors, Predicted, errors, predicted

Progress = Callable[[int, int, str], None]

#: Effects of the fit to the measured tilt: between command and tilt, and the board's own zero.
_EFFECTS = ("delay", "lag", "backlash", "tilt_bias")
#: Starts of that fit; it is not chaotic.
_STARTS = 4
#: Share of the progress bar for the diagnosis [%].
_DIAGNOSIS = 80
#: The models that are compared, by key, with their titles.
MODELS = {
    "untuned": "untuned, no effects",
    "tuned": "tuned, no effects",
    "diagnosed": "diagnosed",
    "fitted": "fitted to the measured tilt",
}


@dataclass(frozen=True, eq=False)
class Run:
    """A recording with its measured tilt, as models predict it that never saw the recording.

    Attributes
    ----------
    name : str
        Its name.
    has_marble : bool
        Whether the diagnosis saw its commands and marble; otherwise nobody saw anything of it.
    held_out : bool
        Whether the models were fitted to other recordings alone.
    predictions : dict of Predicted
        By the keys of `MODELS`.
    """

    name: str
    has_marble: bool
    held_out: bool
    predictions: dict[str, Predicted]

    @property
    def errors(self) -> dict[str, tuple[AxisErrors, AxisErrors]]:
        """Errors about x and y, by the keys of `MODELS`."""
        return {name: errors([one]) for name, one in self.predictions.items()}


@dataclass(frozen=True, eq=False)
class RealProof:
    """The result of a proof on a real rig.

    Attributes
    ----------
    rig : Rig
        The rig with its tilt.
    folders : Folders
        The paths of the proof.
    diagnosis : dict
        Content of ``diagnosis.json``.
    comparisons : list of Comparison
        What describes the response of the board, predicted and measured.
    runs : list of Run
        The recordings.
    """

    rig: Rig
    folders: Folders
    diagnosis: dict[str, Any]
    comparisons: list[Comparison]
    runs: list[Run]

    @property
    def errors(self) -> dict[str, tuple[AxisErrors, AxisErrors]]:
        """Errors about x and y over all recordings, by the keys of `MODELS`."""
        return {name: errors([run.predictions[name] for run in self.runs]) for name in MODELS}

    @property
    def held(self) -> int:
        """How many measured numbers lie in the intervals of the diagnosis."""
        return sum(one.holds for one in self.comparisons)

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``proof.json``; angles in rad, times in s."""

        def shown(of: dict[str, tuple[AxisErrors, AxisErrors]]) -> dict[str, Any]:
            return {name: {"x": x.as_dict(), "y": y.as_dict()} for name, (x, y) in of.items()}

        sealed = read_json(self.folders.seal)
        return {
            "rig": sealed["rig"],
            "code": sealed["code"],
            "recordings": sealed["recordings"],
            "verdict": self.diagnosis["verdict"],
            "effects": [one["name"] for one in self.diagnosis["effects"]],
            "quantities": [one.as_dict() for one in self.comparisons],
            "measured_inside_interval": self.held,
            "rms_rad": shown(self.errors),
            "runs": [
                {
                    "recording": run.name,
                    "has_marble": run.has_marble,
                    "held_out": run.held_out,
                    "rms_rad": shown(run.errors),
                }
                for run in self.runs
            ],
        }


def prove(
    path: Path, out: Path, *, seed: int = 0, threads: int | None = None, progress: Progress | None = None
) -> RealProof:
    """Prove a diagnosis on the rig of a folder; an interrupted proof is resumed.

    Parameters
    ----------
    path : Path
        The rig's folder. Each recording needs stamps and a tilt measured about both axes.
    out : Path
        The folder of the proof.
    seed, threads
        Of the diagnosis and the fit.
    progress : callable, optional
        Called with (done, total, text).

    Raises
    ------
    IrtError
        If the rig has no tilt that could be sealed, or the folder holds another proof.
    """
    report = progress or (lambda *_: None)
    rig = measured(load_rig(path).on_bare_board())
    folders = Folders(out)
    blind = seal(folders, rig, this_code()).first_rows(MOST_ROWS)
    if not folders.answer.exists():
        _diagnose(folders, blind, seed, threads, report)
    # From here on the answer cannot change, and the tilt is used.
    rig = rig.first_rows(MOST_ROWS)
    cache = Unfinished.of(out / "unfinished.jsonl", rig.digest, seed)
    with cache.used():
        fitted, shown = _fit(rig, seed, threads, report)
        found = RealProof(
            rig,
            folders,
            read_json(folders.diagnosis / "diagnosis.json"),
            compared(response(load_model(folders.models / "model.toml")), shown, rig.commands.unit),
            list(_runs(folders, rig, fitted)),
        )
        write_atomic(folders.results, json.dumps(found.as_dict(), indent=2, allow_nan=False) + "\n")
    report(100, 100, "done")
    return found


def _diagnose(folders: Folders, blind: Rig, seed: int, threads: int | None, report: Progress) -> None:
    """Diagnose the rig without its tilt, and write the models of the answer and their hashes."""

    def step(done: int, total: int, text: str) -> None:
        report(_DIAGNOSIS * done // total, 100, text)

    make_folder(folders.diagnosis)
    make_folder(folders.models)
    cache = Unfinished.of(folders.diagnosis / "unfinished.jsonl", blind.digest, seed)
    with cache.used():
        found = diagnose(blind, seed=seed, threads=threads, progress=step)
        write_diagnosis(folders.diagnosis, blind, found)
        for name, model in _models(found):
            save_model(folders.models / f"{name}.toml", model)
        close(folders)


def _models(found: Diagnosis) -> Iterator[tuple[str, Model]]:
    yield "base", found.base
    yield "model", found.model
    for run in found.runs:
        yield f"base-without-{run.recording}", run.base_model
        yield f"model-without-{run.recording}", run.final_model


def _fit(rig: Rig, seed: int, threads: int | None, report: Progress) -> tuple[Model, Response]:
    """Fit command to measured tilt, with all recordings and without each; return model and response."""
    parts = _without_each(rig)

    def fit(number: int, of: Rig, effects: Sequence[Effect]) -> Model:
        done = _DIAGNOSIS + (100 - _DIAGNOSIS) * number // (1 + len(parts))
        report(done, 100, f"fit to the measured tilt, {number + 1} of {1 + len(parts)}")
        return least_squares(of, effects=effects, starts=_STARTS, seed=seed, threads=threads).model

    whole = fit(0, rig, [Effect(name, {}) for name in _EFFECTS])
    # A fit without one recording begins at the fit to all.
    others = [response(fit(number, part, whole.effects)) for number, part in enumerate(parts, start=1)]
    return whole, widened(response(whole), others, SUBSTEP_S * whole.parameters["time_scale"].value)


def _without_each(rig: Rig) -> Sequence[Rig]:
    """Return the rig without each of its recordings; none if it has fewer than three, or one marble alone."""
    others = [tuple(one for one in rig.recordings if one is not left_out) for left_out in rig.recordings]
    if len(others) < 3 or not all(any(one.has_marble for one in each) for each in others):
        return []
    return [replace(rig, recordings=each) for each in others]


def _runs(folders: Folders, rig: Rig, fitted: Model) -> Iterator[Run]:
    """Yield the predictions of each recording by models that were not fitted to it."""
    is_held_out = sum(one.has_marble for one in rig.recordings) > 1
    untouched = untuned(rig)
    for one in rig.recordings:
        without = f"-without-{one.name}" if one.has_marble else ""
        models = {
            "untuned": untouched,
            "tuned": load_model(folders.models / f"base{without}.toml"),
            "diagnosed": load_model(folders.models / f"model{without}.toml"),
            "fitted": fitted,
        }
        yield Run(
            one.name,
            one.has_marble,
            is_held_out or not one.has_marble,
            {name: predicted(model, one) for name, model in models.items()},
        )
