"""Score of a diagnosis against the opened label of its rig."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from irt.diagnosis.budget import REST, TRACKER
from irt.diagnosis.result import UNLISTED
from irt.files import read_json
from irt.model import Model, load_model
from irt.proof.blind import SECONDS
from irt.proof.plan import SIZES, group_of
from irt.recording import Recording, load_recording
from irt.residual import evaluate, free_run_error
from irt.segments import LEAD_ROWS
from irt.workers import FAILED

NOTHING = "nothing"
#: A rig has a gap if the base model's error exceeds the oracle's by at least this share.
GAP = 0.1
#: Digits of inclusion probabilities in scores, which each effect of the catalogue has in each rig.
_DIGITS = 4
#: Angles that are periodic, with their periods [rad].
TURNS = {"grain_rad": math.pi, "phase_rad": 2.0 * math.pi}
#: Effects that vary at random from run to run, so that no model predicts them: left out of gaps.
CHANCE = "delay_jitter"


@dataclass(frozen=True)
class Errors:
    """Mean absolute errors on held-out runs [board edges].

    Attributes
    ----------
    base, final : float
        Of the five parameters alone, and of the final model; free runs.
    oracle : float
        Of the true path, i.e. the tracker's noise alone.
    signal : float
        Distance of the refitted base model from the true path, in units of the tracker's noise.
    """

    base: float
    final: float
    oracle: float
    signal: float

    def closed(self, error: float | None = None) -> float | None:
        """Return the share of the gap between base and oracle that an error closes; None without a gap."""
        gap = self.base - self.oracle
        if not gap > GAP * self.oracle:
            return None
        return (self.base - (self.final if error is None else error)) / gap


@dataclass(frozen=True)
class Budget:
    """Shares of the base model's squared error in complete runs that it was not fitted to.

    Attributes
    ----------
    effects, tracker : float
        Shares of all named effects and of the tracker, by the diagnosis.
    true_effects, true_tracker : float
        Shares of the hidden effects and of the tracker's noise, by the true paths.
    """

    effects: float
    tracker: float
    true_effects: float
    true_tracker: float


@dataclass(frozen=True)
class RigScore:
    """The score of one rig.

    Attributes
    ----------
    rig : str
        Its name.
    group : {"none", "outliers", "single", "pair", "triple", "several", "unlisted"}
        Kind of rig; "several" for more than three effects.
    kinds : tuple of str
        Hidden physics: effects, or one ``unlisted_...``; empty without any.
    verdict : str
        Verdict of the diagnosis; "failed" without one.
    named : tuple of str
        Named effects, the most important first.
    ties : dict
        Effects that each of them was declared confusable with.
    exact, found : bool
        Whether exactly the hidden effects were named, and whether the declared ties contain them.
    tie_size : float or None
        Mean number of effects that a name stands for.
    false_alarm : bool
        Whether an effect was named without hidden physics.
    errors : Errors or None
        On held-out runs; None if the diagnosis failed or the tracker saw none of them.
    intervals : dict
        Whether the 95 % interval of each parameter contains the truth: "yes", "no", or "open" if it has an
        infinite end and so cannot fail on that side.
    inclusion : dict
        Probability that each effect of the catalogue acts, by the diagnosis.
    budget : Budget or None
        Where the base model's error goes; None without hidden effects of the catalogue, with random ones, or
        if the diagnosis has no budget of complete runs.
    noise, sigma, through_camera, engine, drive
        Kind of tracker noise, its standard deviation [board edges], whether pictures were tracked, the engine
        that recorded it, and what commanded its knobs; the last two are empty if the world does not say.
    seconds : float
        CPU time of the diagnosis on one core [s].
    reason : str
        Reason of a failure; empty otherwise.
    unread : tuple of str
        Runs in which the tracker lost the marble, so that no diagnosis was possible.
    left_out : tuple of str
        Held-out runs that are not in the errors, because the tracker saw nothing after the rows where
        predictions start.
    """

    rig: str
    group: str
    kinds: tuple[str, ...]
    verdict: str
    named: tuple[str, ...] = ()
    ties: dict[str, list[str]] = field(default_factory=dict)
    exact: bool = False
    found: bool = False
    tie_size: float | None = None
    false_alarm: bool = False
    errors: Errors | None = None
    intervals: dict[str, str] = field(default_factory=dict)
    inclusion: dict[str, float] = field(default_factory=dict)
    budget: Budget | None = None
    noise: str = "white"
    sigma: float = math.nan
    through_camera: bool = False
    engine: str = ""
    drive: str = ""
    seconds: float = math.nan
    reason: str = ""
    unread: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def closed(self) -> float | None:
        """Closed share of the held-out gap; None without a gap, or with random effects."""
        if self.errors is None or not self.kinds or CHANCE in self.kinds:
            return None
        return self.errors.closed()

    def as_dict(self) -> dict[str, Any]:
        """Return the score as JSON content, with None for NaN and infinities."""
        content: dict[str, Any] = _finite({**asdict(self), "closed": self.closed})
        return content


def score_rig(rig: str, answer: Path, opened: Path) -> RigScore:
    """Score the answer of one rig.

    Parameters
    ----------
    rig : str
        Its name.
    answer : Path
        Folder of the diagnosis' output.
    opened : Path
        Folder of the label and the held-out runs.

    Raises
    ------
    IrtError
        If a file is missing or broken.
    """
    label = label_of(opened)
    group, kinds = group_of(label)
    seen: dict[str, Any] = {
        "noise": str(label.get("noise", "white")),
        "sigma": math.nan if label["sigma"] is None else float(label["sigma"]),
        "through_camera": bool(label.get("through_camera", False)),
        "engine": str(label.get("engine", "")),
        "drive": str(label.get("drive", "")),
    }
    if (answer / FAILED).exists():
        unread, why = _unread(label)
        reason = why or str(read_json(answer / FAILED)["error"])
        return RigScore(rig, group, kinds, "failed", reason=reason, unread=unread, **seen)
    diagnosis = read_json(answer / "diagnosis.json")
    base, final = load_model(answer / "base.toml"), load_model(answer / "model.toml")
    tests, true = held_out(opened, label, base.start)
    kept = {one.name for one in tests}
    return judged(
        RigScore(
            rig,
            group,
            kinds,
            diagnosis["verdict"],
            errors=errors_of(base, final, tests, true, seen["sigma"]),
            budget=budget_of(kinds, diagnosis, base, tests, true) if group in SIZES else None,
            seconds=float(read_json(answer / SECONDS)["seconds"]),
            left_out=tuple(name for name in label["tests"] if name not in kept),
            **seen,
        ),
        diagnosis,
        label["truth"],
    )


def judged(score: RigScore, diagnosis: Mapping[str, Any], truth: Mapping[str, Any]) -> RigScore:
    """Return a score with all that a diagnosis says of names, intervals and probabilities.

    Parameters
    ----------
    score : RigScore
        With kind, hidden physics and errors of the rig.
    diagnosis : mapping
        Content of ``diagnosis.json``.
    truth : mapping
        True values of the parameters by name, and the true ``effects``.
    """
    return replace(
        score,
        **naming(score.group, score.kinds, diagnosis),
        intervals=intervals(diagnosis, truth),
        inclusion={
            name: round(value, _DIGITS)
            for name, value in diagnosis.get("inclusion", {}).items()
            if value is not None
        },
    )


def label_of(opened: Path) -> dict[str, Any]:
    """Return the opened label of a rig."""
    return read_json(opened / "label.json")


def naming(group: str, kinds: Sequence[str], diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a score about names: ``named``, ``ties``, ``exact``, ``found`` and so on."""
    ties = {one["name"]: sorted(one["confusable_with"]) for one in diagnosis["effects"]}
    verdict, named = diagnosis["verdict"], tuple(ties)
    if not kinds:
        exact = found = verdict == "sufficient"
    elif group == UNLISTED:
        exact = found = verdict == UNLISTED
    else:
        exact = verdict == "missing" and set(kinds) == set(named)
        found = verdict == "missing" and len(named) == len(kinds) == len(matched(kinds, ties))
    return {
        "named": named,
        "ties": {name: rest for name, rest in ties.items() if rest},
        "exact": exact,
        "found": found,
        "tie_size": float(np.mean([1 + len(rest) for rest in ties.values()])) if ties else None,
        "false_alarm": not kinds and verdict != "sufficient",
    }


def matched(kinds: Sequence[str], ties: Mapping[str, Collection[str]]) -> dict[str, str]:
    """Match each hidden effect to at most one name that is equal to it or tied with it.

    The matching is a largest one, with exact names first.
    """
    if not kinds or not ties:
        return {}
    names = list(ties)
    worth = np.array(
        [[1.1 if name == kind else float(kind in ties[name]) for name in names] for kind in kinds]
    )
    pairs = zip(*linear_sum_assignment(worth, maximize=True), strict=True)
    return {kinds[kind]: names[name] for kind, name in pairs if worth[kind, name] > 0.0}


def errors_of(
    base: Model, final: Model, tests: Sequence[Recording], true: Sequence[Recording], sigma: float
) -> Errors | None:
    """Return the errors of two models on tracked runs and on their true paths; None without a run.

    `sigma` is the tracker's noise [board edges].
    """
    if not tests:
        return None
    missed = [np.nanmean(np.abs(t.marble - seen.marble)) for t, seen in zip(true, tests, strict=True)]
    return Errors(
        base=mean_error(base, tests),
        final=mean_error(final, tests),
        oracle=float(np.mean(missed)),
        signal=mean_error(base, true) / sigma,
    )


def budget_of(
    kinds: Sequence[str],
    diagnosis: Mapping[str, Any],
    base: Model,
    tests: Sequence[Recording],
    true: Sequence[Recording],
) -> Budget | None:
    """Return the shares of the base model's squared error by the diagnosis, and by the true paths."""
    said = {one["what"]: one["share"] for one in diagnosis.get("budget", []) if one["horizon_s"] is None}
    if not said or not tests or CHANCE in kinds:
        return None
    seen, clean = (np.concatenate([one.marble for one in runs]) for runs in (tests, true))
    predicted = np.concatenate([one.free_prediction for one in evaluate(base, tests).runs])
    tracker = min(float(np.nanmean((seen - clean) ** 2) / np.nanmean((seen - predicted) ** 2)), 1.0)
    effects = sum(share for what, share in said.items() if what not in (TRACKER, REST))
    return Budget(effects, said.get(TRACKER, 0.0), 1.0 - tracker, tracker)


def held_out(opened: Path, label: Mapping[str, Any], start: str) -> tuple[list[Recording], list[Recording]]:
    """Return the held-out runs: tracked, and their true paths.

    The rows from which a prediction starts are the true ones in both, because noise there shifts a whole path
    and would count against every model but the oracle. Runs without tracked rows after these are left out.
    """
    tests, true = [], []
    lead = LEAD_ROWS if start == "moving" else 1
    for path in sorted(opened.glob("test-*.csv"), key=lambda path: (len(path.name), path.name)):
        clean = np.array(label["tests"][path.stem]["clean"], dtype=np.float64)
        seen = load_recording(path, begun=clean[:lead])
        if seen.seen[lead:].any():
            tests.append(seen)
            true.append(Recording(seen.name, path, seen.knobs, clean, seen.stamps))
    return tests, true


def _unread(label: Mapping[str, Any]) -> tuple[tuple[str, ...], str]:
    """Return the recordings that the tracker could not read, and the reason in words; empty if none."""
    lost = {name: why for name, why in label.get("lost", {}).items() if name not in label["tests"]}
    if not lost:
        return (), ""
    name, why = next(iter(lost.items()))
    more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
    return tuple(lost), f"the tracker lost the marble in {name}{more}: {why}"


def mean_error(model: Model, runs: Sequence[Recording]) -> float:
    """Return the mean absolute error [board edges] of free runs, averaged over runs."""
    return float(np.mean([free_run_error(model, run) for run in runs]))


def intervals(diagnosis: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, str]:
    """Return whether the intervals of the base and of rightly named effects contain the truth.

    Without stamps the recordings do not determine the time scale: slower motion under weaker pushes looks the
    same. Intervals along that direction are as wide as the rig's ranges, and are compared as they are.
    """
    held = {
        name: _holds(name, one, truth[name])
        for name, one in diagnosis["parameters"].items()
        if truth.get(name) is not None
    }
    hidden = {one["name"]: one for one in truth.get("effects", [])}
    for effect in diagnosis["effects"]:
        known = hidden.get(effect["name"], {})
        for name, one in effect["parameters"].items():
            if known.get(name) is not None:
                held[f"{effect['name']}.{name}"] = _holds(name, one, known[name])
    return held


def _holds(name: str, one: Mapping[str, Any], value: float) -> str:
    low, high = (math.nan if one.get(end) is None else float(one[end]) for end in ("low", "high"))
    turn = TURNS.get(name, 0.0)
    if all(same < low or same > high for same in (value, value - turn, value + turn)):
        return "no"
    return "open" if math.isnan(low) or math.isnan(high) else "yes"


def _finite(content: Any) -> Any:
    """Return content with None for numbers that JSON does not have."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    return None if isinstance(content, float) and not math.isfinite(content) else content
