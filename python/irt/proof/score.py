"""What an answer is worth, once the label of its rig is open."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from irt.diagnosis.result import UNLISTED
from irt.errors import IrtError
from irt.model import Model, load_model
from irt.proof.blind import SECONDS
from irt.proof.hash_chain import read_json
from irt.recording import Recording, load_recording
from irt.residual import free_run_error
from irt.segments import LEAD_ROWS
from irt.workers import FAILED

NOTHING = "nothing"
#: A gap is one to close where the base model errs by this share more than the oracle, at least.
GAP = 0.1
#: Angles that say the same after a turn [rad].
TURNS = {"grain_rad": math.pi, "phase_rad": 2.0 * math.pi}
#: Differs from run to run by chance, so that no model can predict it: left out where gaps count.
CHANCE = "delay_jitter"


@dataclass(frozen=True)
class Errors:
    """Mean absolute errors on runs held out [board edges].

    Attributes
    ----------
    base, final : float
        Of the five parameters alone, and of the final model; free runs.
    oracle : float
        Of the true path: what the tracker's noise makes.
    signal : float
        How far the base model, once refitted, strays from the true path, in tracker noises.
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
class RigScore:
    """The score of one rig.

    Attributes
    ----------
    rig : str
        Its name.
    group : {"none", "outliers", "single", "pair", "unlisted"}
        What kind of rig it was.
    kinds : tuple of str
        What was hidden: effects, or one ``unlisted_...``; empty where nothing was.
    verdict : str
        Of the diagnosis; "failed" where there is none.
    named : tuple of str
        Effects named, the most important first.
    ties : dict
        What each of them was said to be confusable with.
    exact, found : bool
        Whether exactly what was hidden was named, and whether it was at least in the ties declared.
    tie_size : float or None
        Mean number of effects that a name stands for.
    false_alarm : bool
        Whether something was named where there was nothing.
    errors : Errors or None
        On runs held out; None where the diagnosis failed, or the tracker saw none of them.
    intervals : dict
        Whether the 95 % interval of each parameter holds the truth: "yes", "no", or "open" where it has an
        infinite end and so cannot fail on that side.
    noise, sigma, through_camera
        How it was seen: kind of noise, its standard deviation [board edges], by the tracker or not.
    seconds : float
        What the diagnosis took of one core.
    reason : str
        Why it failed, if it did.
    unread : tuple of str
        Runs in which the tracker lost the marble, so that nothing could be diagnosed.
    left_out : tuple of str
        Runs held out in which the tracker saw nothing after the rows where predictions start, so that no
        error counts them.
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
    noise: str = "white"
    sigma: float = math.nan
    through_camera: bool = False
    seconds: float = math.nan
    reason: str = ""
    unread: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def closed(self) -> float | None:
        """Share of the held-out gap that was closed; None where there is none, or none that can be."""
        if self.errors is None or not self.kinds or CHANCE in self.kinds:
            return None
        return self.errors.closed()

    def as_dict(self) -> dict[str, Any]:
        """Return the score as JSON takes it; what has no number is None."""
        told: dict[str, Any] = _finite({**asdict(self), "closed": self.closed})
        return told

    @classmethod
    def from_dict(cls, told: Mapping[str, Any]) -> RigScore:
        """Return the score that `as_dict` told of."""
        values = {name: value for name, value in told.items() if name != "closed"}
        for name in ("kinds", "named", "unread", "left_out"):
            values[name] = tuple(values[name])
        for name in ("sigma", "seconds"):
            values[name] = _number(values[name])
        if values["errors"] is not None:
            values["errors"] = Errors(**{name: _number(one) for name, one in values["errors"].items()})
        return cls(**values)


def score_rig(rig: str, answer: Path, opened: Path) -> RigScore:
    """Score the answer of one rig.

    Parameters
    ----------
    rig : str
        Its name.
    answer : Path
        What the diagnosis wrote.
    opened : Path
        Label and runs held out.

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
    }
    if (answer / FAILED).exists():
        unread, why = _unread(label)
        reason = why or str(read_json(answer / FAILED)["error"])
        return RigScore(rig, group, kinds, "failed", reason=reason, unread=unread, **seen)
    told = read_json(answer / "diagnosis.json")
    base, final = load_model(answer / "base.toml"), load_model(answer / "model.toml")
    tests, true = held_out(opened, label, base.start)
    kept = {one.name for one in tests}
    return RigScore(
        rig,
        group,
        kinds,
        told["verdict"],
        **naming(group, kinds, told),
        errors=errors_of(base, final, tests, true, seen["sigma"]),
        intervals=intervals(told, label["truth"]),
        seconds=float(read_json(answer / SECONDS)["seconds"]),
        left_out=tuple(name for name in label["tests"] if name not in kept),
        **seen,
    )


def label_of(opened: Path) -> dict[str, Any]:
    """Return the label of a rig whose seal is open."""
    return read_json(opened / "label.json")


def group_of(label: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """Return the kind of rig, and what was hidden in it.

    Raises
    ------
    IrtError
        If the label names nothing of the kind.
    """
    kind = label["kind"]
    if isinstance(kind, list | tuple):
        names = tuple(str(one) for one in kind)
        if len(names) not in (1, 2):
            raise IrtError(f"a label names {len(names)} effects; one or two were expected")
        return ("pair" if len(names) == 2 else "single"), names
    if kind in ("none", "outliers"):
        return str(kind), ()
    return (UNLISTED if str(kind).startswith(UNLISTED) else "single"), (str(kind),)


def naming(group: str, kinds: Sequence[str], told: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a score is about names: ``named``, ``ties``, ``exact``, ``found`` and so on."""
    ties = {one["name"]: sorted(one["confusable_with"]) for one in told["effects"]}
    verdict, named = told["verdict"], tuple(ties)
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


def matched(kinds: Sequence[str], ties: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Return for hidden effects the name that stands for each, itself or its tie; a name stands for one.

    As many as can be are matched, exact names first.
    """
    slots: list[str | None] = [*ties, *[None] * len(kinds)]

    def worth(order: Sequence[str | None]) -> float:
        return sum(
            1.1 if name == kind else 1.0 if name is not None and kind in ties[name] else 0.0
            for kind, name in zip(kinds, order, strict=True)
        )

    best = max(itertools.permutations(slots, len(kinds)), key=worth)
    return {
        kind: name
        for kind, name in zip(kinds, best, strict=True)
        if name is not None and (kind == name or kind in ties[name])
    }


def errors_of(
    base: Model, final: Model, tests: Sequence[Recording], true: Sequence[Recording], sigma: float
) -> Errors | None:
    """Return the errors of two models on runs, as the tracker saw them and as they were; None without a run.

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


def held_out(opened: Path, label: Mapping[str, Any], start: str) -> tuple[list[Recording], list[Recording]]:
    """Return the runs held out: as the tracker saw them, and the true paths.

    The rows from which a prediction starts are true in both. Noise there shifts a whole path, and would count
    against every model but the oracle. Runs in which nothing is seen after these rows are left out.
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
    """Return the recordings that the tracker could not read, and why in words; empty where there are none."""
    lost = {name: why for name, why in label.get("lost", {}).items() if name not in label["tests"]}
    if not lost:
        return (), ""
    name, why = next(iter(lost.items()))
    more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
    return tuple(lost), f"the tracker lost the marble in {name}{more}: {why}"


def mean_error(model: Model, runs: Sequence[Recording]) -> float:
    """Return the mean absolute error [board edges] of free runs, averaged over runs."""
    return float(np.mean([free_run_error(model, run) for run in runs]))


def intervals(told: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, str]:
    """Return whether each interval, of the base and of effects rightly named, holds the truth.

    Without stamps all of the motion can run slower under weaker pushes, and no recording says which it was:
    intervals along that direction are as wide as the rig's ranges, and are compared as they are.
    """
    held = {
        name: _holds(name, one, truth[name])
        for name, one in told["parameters"].items()
        if truth.get(name) is not None
    }
    hidden = {one["name"]: one for one in truth.get("effects", [])}
    for effect in told["effects"]:
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


def _number(told: float | None) -> float:
    """Return a number that JSON may have had none for."""
    return math.nan if told is None else told


def _finite(content: Any) -> Any:
    """Return content with None for what JSON has no number for."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    return None if isinstance(content, float) and not math.isfinite(content) else content
