"""Scores of the other methods on the same rigs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.files import read_json
from irt.proof.metrics import Quantity, Rate, nulls, of_catalogue
from irt.proof.score import RigScore, held_out, label_of
from irt.recording import Recording
from irt.workers import FAILED

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contestant:
    """Score of one method on one rig.

    Attributes
    ----------
    rig, method : str
        Names of the rig and of the method.
    detected : bool or None
        Whether it reports missing physics; None if the method does not report it.
    found : bool or None
        Whether it named the hidden effects; None if the method names no effects.
    error : float or None
        Mean absolute error on the held-out runs [board edges]; None without predictions.
    seconds : float
        CPU time of one core [s].
    missing : str
        Reason for a missing answer; empty otherwise.
    """

    rig: str
    method: str
    detected: bool | None
    found: bool | None
    error: float | None
    seconds: float
    missing: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON content; `detected` has the key ``told``."""
        return {"told" if name == "detected" else name: value for name, value in asdict(self).items()}


@dataclass(frozen=True)
class Standing:
    """Score of a method over all rigs.

    Attributes
    ----------
    title : str
        The method.
    named : Rate or None
        Share of the rigs with hidden effects of the catalogue in which it named them.
    detected : Rate or None
        Share of the rigs with any hidden physics in which it reported missing physics.
    alarms : Rate or None
        Share of the rigs without hidden physics in which it did so.
    closed : Quantity
        Share of the held-out gap closed.
    over_oracle : Quantity
        Ratio of the held-out error to the oracle's.
    seconds : float
        Median CPU time per rig [s].
    missing : str
        Reason for no answer on any rig; empty otherwise.
    """

    title: str
    named: Rate | None
    detected: Rate | None
    alarms: Rate | None
    closed: Quantity
    over_oracle: Quantity
    seconds: float
    missing: str = ""


def contestants(score: RigScore, folder: Path, opened: Path, start: str) -> list[Contestant]:
    """Return the scores of the other methods on a rig; empty without a run to predict.

    Parameters
    ----------
    score : RigScore
        Score of the diagnosis.
    folder, opened : Path
        Folders of the methods' answers, and of the label and the held-out runs.
    start : {"rest", "moving"}
        Start state of the rig's recordings.

    Raises
    ------
    IrtError
        If a file is missing or broken.
    """
    if (folder / FAILED).exists():
        return []
    answers = read_json(folder / "baselines.json")
    tests, _ = held_out(opened, label_of(opened), start)
    if not tests:
        return []
    return [
        Contestant(
            rig=score.rig,
            method=method,
            detected=one["told"],
            found=_found(score, one["named"]),
            error=_error(one["predictions"], tests),
            seconds=one["seconds"],
            missing=one["missing"],
        )
        for method, one in answers.items()
    ]


def of_diagnosis(score: RigScore) -> Contestant:
    """Return the score of the diagnosis in the same form."""
    failed = score.verdict == "failed"
    return Contestant(
        rig=score.rig,
        method="irt",
        detected=None if failed else score.verdict != "sufficient",
        found=score.found,
        error=None if score.errors is None else score.errors.final,
        seconds=score.seconds,
        missing=score.reason,
    )


def standing(title: str, scores: Sequence[RigScore], entries: Sequence[Contestant]) -> Standing:
    """Return the score of a method over all rigs; a failed run counts as no name and no report."""
    of = {one.rig: one for one in entries}
    known = [one for one in of_catalogue(scores) if one.rig in of]
    hidden = known + [one for one in scores if one.group == "unlisted" and one.rig in of]
    quiet = [one for one in nulls(scores) if one.rig in of]
    answered = [one for one in entries if not one.missing]
    names = any(one.found is not None for one in answered)
    says = any(one.detected is not None for one in answered)
    # A failed diagnosis has no CPU time.
    seconds = [one.seconds for one in entries if math.isfinite(one.seconds)]
    closed, over = [], []
    for one in hidden:
        error = of[one.rig].error
        if error is None or one.errors is None:
            continue
        over.append(error / one.errors.oracle)
        if one.closed is not None:
            closed.append(one.errors.closed(error) or 0.0)
    return Standing(
        title,
        Rate.over(known, lambda one: bool(of[one.rig].found)) if names else None,
        Rate.over(hidden, lambda one: bool(of[one.rig].detected)) if says else None,
        Rate.over(quiet, lambda one: bool(of[one.rig].detected)) if says else None,
        Quantity.median(closed),
        Quantity.median(over),
        float(np.median(seconds)) if seconds else math.nan,
        "" if answered or not entries else entries[0].missing,
    )


def is_ahead(ours: Standing, others: Sequence[Standing]) -> bool | None:
    """Return whether the diagnosis names more and has a smaller held-out error than each other method."""
    judged = [
        ours.named.share > other.named.share
        for other in others
        if ours.named is not None and ours.named.of and other.named is not None
    ]
    judged += [ours.over_oracle.value < other.over_oracle.value for other in others if other.over_oracle.of]
    return all(judged) if judged else None


def _found(score: RigScore, named: Sequence[str] | None) -> bool | None:
    if named is None:
        return None
    return not named if not score.kinds else set(named) == set(score.kinds)


def _error(predictions: dict[str, Any], tests: Sequence[Recording]) -> float | None:
    """Return the mean over runs of the mean absolute error; None where a path is missing or not finite."""
    paths = [predictions.get(test.name) for test in tests]
    if not paths or any(path is None for path in paths):
        return None
    return float(
        np.mean([np.nanmean(np.abs(np.array(p) - t.marble)) for p, t in zip(paths, tests, strict=True)])
    )
