"""What other methods made of the same rigs, in the terms of a score."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.proof.hash_chain import read_json
from irt.proof.metrics import Quantity, Rate, nulls, of_catalogue
from irt.proof.score import RigScore, held_out, label_of
from irt.recording import Recording
from irt.workers import FAILED

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contestant:
    """What one method made of one rig.

    Attributes
    ----------
    rig, method : str
        Which.
    told : bool or None
        Whether it says that something is missing; None where it does not say.
    found : bool or None
        Whether it named what was hidden; None where it names nothing.
    error : float or None
        Mean absolute error on the runs held out [board edges]; None where it predicts nothing.
    seconds : float
        What it took of one core.
    missing : str
        Why there is no answer, if there is none.
    """

    rig: str
    method: str
    told: bool | None
    found: bool | None
    error: float | None
    seconds: float
    missing: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON takes it."""
        return asdict(self)


@dataclass(frozen=True)
class Standing:
    """How a method did over all rigs.

    Attributes
    ----------
    title : str
        The method.
    named : Rate or None
        Rigs with hidden effects of the catalogue in which it named them.
    told : Rate or None
        Such rigs, and those with physics that is not in it, in which it said that something is missing.
    alarms : Rate or None
        Rigs with nothing hidden in which it said so too.
    closed : Quantity
        Share of the held-out gap closed.
    over_oracle : Quantity
        Held-out error over the oracle's.
    seconds : float
        Median time a rig.
    missing : str
        Why it gave no answer, where it gave none at all.
    """

    title: str
    named: Rate | None
    told: Rate | None
    alarms: Rate | None
    closed: Quantity
    over_oracle: Quantity
    seconds: float
    missing: str = ""


def contestants(score: RigScore, folder: Path, opened: Path, start: str) -> list[Contestant]:
    """Return what other methods made of a rig; nothing where they were given no run to predict.

    Parameters
    ----------
    score : RigScore
        What was hidden in it.
    folder, opened : Path
        What the methods wrote; label and runs held out.
    start : {"rest", "moving"}
        How the rig's recordings begin.

    Raises
    ------
    IrtError
        If a file is missing or broken.
    """
    if (folder / FAILED).exists():
        return []
    told = read_json(folder / "baselines.json")
    tests, _ = held_out(opened, label_of(opened), start)
    if not tests:
        return []
    return [
        Contestant(
            rig=score.rig,
            method=method,
            told=one["told"],
            found=_found(score, one["named"]),
            error=_error(one["predictions"], tests),
            seconds=one["seconds"],
            missing=one["missing"],
        )
        for method, one in told.items()
    ]


def of_diagnosis(score: RigScore) -> Contestant:
    """Return the diagnosis itself as one of them."""
    failed = score.verdict == "failed"
    return Contestant(
        rig=score.rig,
        method="irt",
        told=None if failed else score.verdict != "sufficient",
        found=score.found,
        error=None if score.errors is None else score.errors.final,
        seconds=score.seconds,
        missing=score.reason,
    )


def standing(title: str, scores: Sequence[RigScore], entries: Sequence[Contestant]) -> Standing:
    """Return how a method did over all rigs; one that broke down has neither named nor told anything."""
    of = {one.rig: one for one in entries}
    known = [one for one in of_catalogue(scores) if one.rig in of]
    hidden = known + [one for one in scores if one.group == "unlisted" and one.rig in of]
    quiet = [one for one in nulls(scores) if one.rig in of]
    answered = [one for one in entries if not one.missing]
    names = any(one.found is not None for one in answered)
    says = any(one.told is not None for one in answered)
    # A diagnosis that failed has no time.
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
        Rate.over(hidden, lambda one: bool(of[one.rig].told)) if says else None,
        Rate.over(quiet, lambda one: bool(of[one.rig].told)) if says else None,
        Quantity.median(closed),
        Quantity.median(over),
        float(np.median(seconds)) if seconds else math.nan,
        "" if answered or not entries else entries[0].missing,
    )


def is_ahead(ours: Standing, others: Sequence[Standing]) -> bool | None:
    """Whether the diagnosis names more, and errs less on runs held out, than each other method."""
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
