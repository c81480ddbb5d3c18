"""What a diagnosis says: one type that the command line, the report and other programs read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from irt import display
from irt.catalogue import effect
from irt.diagnosis.sessions import Difference
from irt.model import Model, Parameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

Verdict = Literal["sufficient", "missing", "unlisted"]
Kind = Literal["stage", "time", "region", "regime", "run"]

#: Name of what no effect of the catalogue explains, in `NamedEffect.name` and in ``model.toml``.
UNLISTED = "unlisted"


@dataclass(frozen=True)
class Finding:
    """A place where residuals stand out from noise.

    Attributes
    ----------
    kind : {"stage", "time", "region", "regime", "run"}
        Which question it answers.
    what : str
        The place, in words.
    strength : float
        Share of the mismatch beyond noise that it accounts for, from 0 to 1.
    p_value : float
        Of this strength or more, were there only noise, corrected for the number of places looked at.
    """

    kind: Kind
    what: str
    strength: float
    p_value: float


@dataclass(frozen=True)
class NamedEffect:
    """An effect that was left out.

    Attributes
    ----------
    name : str
        In the catalogue, or `UNLISTED`.
    stage : str
        Where on the way from command to picture it acts.
    parameters : dict
        Fitted values by name with 95 % intervals.
    units : dict
        Unit of each parameter.
    heldout_mae_without, heldout_mae_with : float
        Mean absolute error [board edges] on runs held out, of the final model without this effect and with
        it, all other parameters refitted.
    confusable_with : tuple of str
        Effects that explain the recordings as well in its place.
    reason : str
        Why they cannot be told apart, in a sentence; empty where there are none.
    probability : float
        That it is at work, or one of those that do as well, given these recordings and the catalogue.
    chosen_again : float
        Share of the recordings without which it is chosen, or one of those that do as well; NaN where
        nothing was held out.
    """

    name: str
    stage: str
    parameters: dict[str, Parameter]
    units: dict[str, str]
    heldout_mae_without: float
    heldout_mae_with: float
    confusable_with: tuple[str, ...] = ()
    reason: str = ""
    probability: float = 1.0
    chosen_again: float = math.nan


@dataclass(frozen=True)
class Candidate:
    """A hypothesis that was tried: effects added to the base model, everything refitted.

    Attributes
    ----------
    effects : tuple of str
        What was added; empty for the base model.
    values : dict
        Fitted values of the effects' parameters, by ``effect.parameter``.
    gain : float
        Log-likelihood over the base model's, in nats, each beside the random push that suits it best.
    penalty : float
        What its parameters and its choice from the catalogue cost, in nats.
    probability : float
        Of this set among all that were tried.
    outcome : str
        What became of it, in words.
    """

    effects: tuple[str, ...]
    values: dict[str, float]
    gain: float
    penalty: float
    probability: float
    outcome: str


@dataclass(frozen=True, eq=False)
class Plausible:
    """A model that may be the true one.

    Attributes
    ----------
    model : Model
        A set of effects, fitted.
    probability : float
        Of the set among those that are plausible.
    """

    model: Model
    probability: float


@dataclass(frozen=True, eq=False)
class RunProof:
    """One recording of n rows, predicted by models fitted to the other recordings alone.

    Attributes
    ----------
    recording : str
        Its name.
    times : (n,) array
        Seconds of each row.
    observed : (n, 2) array
        What the tracker saw [board edges], NaN where nothing.
    base, final : (n, 2) arrays
        Predictions before and after [board edges].
    base_mae, final_mae : float
        Their mean absolute errors [board edges].
    """

    recording: str
    times: Array
    observed: Array
    base: Array
    final: Array
    base_mae: float
    final_mae: float


@dataclass(frozen=True)
class NeededPush:
    """How a recording of n rows pushes the marble beyond what the simulator does, before and after.

    Each is the mean given all rows, with its standard deviation, NaN in rows where nothing is known.

    Attributes
    ----------
    recording : str
        Its name.
    times : (n,) array
        Seconds of each row.
    base, base_deviation : (n, 2) arrays
        Of the five parameters [m/s^2].
    final, final_deviation : (n, 2) arrays
        Of the answer [m/s^2].
    """

    recording: str
    times: Array
    base: Array
    base_deviation: Array
    final: Array
    final_deviation: Array


@dataclass(frozen=True)
class Share:
    """A part of the base model's squared error on recordings held out.

    Attributes
    ----------
    what : str
        An effect, "tracker" or "not repeatable".
    share : float
        From 0 to 1; those of one horizon add up to 1.
    horizon_s : float or None
        How far ahead was predicted [s]; None for runs from their start to their end.
    """

    what: str
    share: float
    horizon_s: float | None


@dataclass(frozen=True)
class Remains:
    """What nothing that was named explains.

    Attributes
    ----------
    share : float
        Of the base model's squared error on recordings held out, in runs from start to end.
    stage : str or None
        Where a random push, or chance at the rim, makes recordings likelier: "board" or "contact"; None where
        neither does.
    repeats : bool
        Whether the remainder depends on anything that comes back.
    floor_of_the_log : float
        Mean absolute error of the final model on recordings that it has itself made, tracked as those of the
        rig: what a perfect simulator would be off by [board edges].
    """

    share: float
    stage: str | None
    repeats: bool
    floor_of_the_log: float


@dataclass(frozen=True)
class Power:
    """From which size on these recordings would have shown an effect.

    Attributes
    ----------
    effect, parameter, unit : str
        Which effect, and which of its parameters was varied, the others at typical values.
    least : float or None
        Smallest size that would have been named with a probability of at least 0.8; None where not even
        the largest size would.
    largest : float
        End of the range looked at.
    """

    effect: str
    parameter: str
    unit: str
    least: float | None
    largest: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The outcome of `irt.diagnose`.

    Attributes
    ----------
    verdict : {"sufficient", "missing", "unlisted"}
        Whether the base model explains the recordings, effects of the catalogue are missing, or something
        repeatable is left that no effect explains.
    summary : str
        The answer in one or two sentences.
    where : tuple of Finding
        Where residuals of the base model stand out, the strongest first of each kind.
    effects : tuple of NamedEffect
        What was left out, the most important first.
    noise : float
        Standard deviation of the tracker [board edges].
    base_mae, final_mae, base_heldout_mae, final_heldout_mae : float
        Mean absolute errors [board edges] of the base model and the final one, on the runs that they were
        fitted to and on runs held out, each predicted by a fit to the others.
    base, model : Model
        The best fit of five parameters, and the final model; both with 95 % intervals.
    indistinguishable : tuple of Model
        Models with other effects that explain the recordings as well as the final one.
    plausible : tuple of Plausible
        Models with sets of effects that may be the true one, the final model first.
    unidentifiable : tuple of str
        Plain sentences: which combinations these recordings cannot pin down.
    suggestion : str
        What to record next, and why.
    candidates : tuple of Candidate
        All hypotheses tried, the best first.
    runs : tuple of RunProof
        The proof, run by run.
    power : tuple of Power
        What could have been seen, where nothing was.
    notes : tuple of str
        Plain sentences about anything else the user should know.
    settings : dict
        What the diagnosis was asked with.
    seed : int
        Of everything drawn.
    seconds : float
        Wall time.
    inclusion : dict
        Probability of each effect of the catalogue that it is at work.
    budget : tuple of Share
        Where the base model's error on runs held out goes, at several horizons.
    remains : Remains or None
        What nothing explains; None where nothing was held out.
    pushes : tuple of NeededPush
        Recording by recording the push that is missing; empty where nothing is.
    warnings : tuple of str
        What a check of the recordings warns of (`irt.check`).
    sessions : tuple of Difference
        Values that differ between the sessions of a pooled rig (`irt.pool`).
    nested_heldout_mae : float
        Mean absolute error on runs held out [board edges], each predicted by the set of effects that the
        others choose; NaN where nothing was held out.
    """

    verdict: Verdict
    summary: str
    where: tuple[Finding, ...]
    effects: tuple[NamedEffect, ...]
    noise: float
    base_mae: float
    final_mae: float
    base_heldout_mae: float
    final_heldout_mae: float
    base: Model
    model: Model
    indistinguishable: tuple[Model, ...]
    plausible: tuple[Plausible, ...]
    unidentifiable: tuple[str, ...]
    suggestion: str
    candidates: tuple[Candidate, ...]
    runs: tuple[RunProof, ...]
    power: tuple[Power, ...]
    notes: tuple[str, ...]
    settings: dict[str, Any]
    seed: int
    seconds: float
    inclusion: dict[str, float] = field(default_factory=dict)
    budget: tuple[Share, ...] = ()
    remains: Remains | None = None
    pushes: tuple[NeededPush, ...] = ()
    warnings: tuple[str, ...] = ()
    sessions: tuple[Difference, ...] = ()
    nested_heldout_mae: float = math.nan

    @property
    def is_held_out(self) -> bool:
        """Whether errors are those on recordings that were held out: with one recording there are none."""
        return math.isfinite(self.final_heldout_mae)

    def plot(self) -> Figure:
        """Draw the run that improves most, before and after; return a matplotlib figure."""
        from irt import pictures  # noqa: PLC0415

        run = max(self.runs, key=lambda one: one.base_mae - one.final_mae)
        panels = {
            f"{axis}  [edges]": [
                pictures.Line("recorded", run.observed[:, index], pictures.MEASURED, dots=True),
                pictures.Line("five parameters", run.base[:, index], pictures.BEFORE),
                pictures.Line("diagnosed", run.final[:, index], pictures.AFTER),
            ]
            for index, axis in enumerate("xy")
        }
        # With stamps the time scale is known, and has no interval; without, rows are all that is known.
        if self.model.parameters["time_scale"].low is None:
            return pictures.over_time(run.times, f"{run.recording}: time  [s]", panels)
        rows = np.arange(len(run.times), dtype=np.float64)
        return pictures.over_time(rows, f"{run.recording}: row", panels)

    def _repr_html_(self) -> str:
        rows = [
            (
                effect.name,
                f"{name} {display.interval(one.value, one.low, one.high)} {effect.units.get(name, '')}",
            )
            for effect in self.effects
            for name, one in effect.parameters.items()
        ]
        return display.page(
            f"Diagnosis: {self.verdict}",
            display.items(f"Warning: {one}" for one in self.warnings),
            display.paragraph(self.summary),
            display.table(("effect", "value (95 % interval)"), rows),
            display.items(self.unidentifiable),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return what ``diagnosis.json`` holds; what has no number is None."""
        content = {
            "verdict": self.verdict,
            "summary": self.summary,
            "where": [
                {"kind": one.kind, "what": one.what, "strength": one.strength, "p_value": one.p_value}
                for one in self.where
            ],
            "effects": [_effect(one) for one in self.effects],
            "inclusion": self.inclusion,
            "budget": [asdict(one) for one in self.budget],
            "sessions": [asdict(one) for one in self.sessions],
            "remains": None if self.remains is None else asdict(self.remains),
            "fit": {
                "noise": self.noise,
                "base_mae": self.base_mae,
                "final_mae": self.final_mae,
                "base_heldout_mae": self.base_heldout_mae,
                "final_heldout_mae": self.final_heldout_mae,
                "nested_heldout_mae": self.nested_heldout_mae,
            },
            "parameters": {name: _parameter(one) for name, one in self.model.parameters.items()},
            "unidentifiable": list(self.unidentifiable),
            "suggestion": self.suggestion,
            "candidates": [
                {
                    "effects": list(one.effects),
                    "gain": one.gain,
                    "penalty": one.penalty,
                    "probability": one.probability,
                    "outcome": one.outcome,
                }
                for one in self.candidates
            ],
            "power": [
                {"effect": one.effect, "parameter": one.parameter, "least": one.least, "unit": one.unit}
                for one in self.power
            ],
            "notes": list(self.notes),
            "settings": {**self.settings, "seed": self.seed, "seconds": self.seconds},
        }
        return {name: _finite(value) for name, value in content.items()}


def units(name: str) -> dict[str, str]:
    """Return the unit of each parameter of an effect of the catalogue."""
    return {parameter.name: parameter.unit for parameter in effect(name).parameters}


def _effect(one: NamedEffect) -> dict[str, Any]:
    return {
        "name": one.name,
        "stage": one.stage,
        "parameters": _parameters(one.parameters, one.units),
        "heldout_mae_without": one.heldout_mae_without,
        "heldout_mae_with": one.heldout_mae_with,
        "confusable_with": list(one.confusable_with),
        "reason": one.reason,
        "probability": one.probability,
        "chosen_again": one.chosen_again,
    }


def _parameters(parameters: Mapping[str, Parameter], unit: Mapping[str, str]) -> dict[str, Any]:
    return {name: {**_parameter(one), "unit": unit.get(name, "")} for name, one in parameters.items()}


def _parameter(one: Parameter) -> dict[str, float | None]:
    """Return value and interval; JSON has no infinity, so an open end is null."""
    told = {"value": one.value, "low": one.low, "high": one.high}
    return {key: None if value is None or math.isinf(value) else value for key, value in told.items()}


def _finite(content: Any) -> Any:
    """Return content with null for what JSON has no number for."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
