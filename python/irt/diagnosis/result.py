"""The result of a diagnosis, for the command line, the report and other programs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from irt import display
from irt.diagnosis.sessions import Difference
from irt.model import Model, Parameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

Verdict = Literal["sufficient", "missing", "unlisted"]
Kind = Literal["stage", "time", "region", "regime", "run"]

#: Name of a learned correction outside the catalogue, in `NamedEffect.name` and in ``model.toml``.
UNLISTED = "unlisted"


@dataclass(frozen=True)
class Finding:
    """A place where residuals exceed noise.

    Attributes
    ----------
    kind : {"stage", "time", "region", "regime", "run"}
        Kind of place.
    what : str
        The place, in words.
    strength : float
        Its share of the mismatch beyond noise, from 0 to 1.
    p_value : float
        Probability of this strength or more under noise alone, corrected for the number of places tested.
    """

    kind: Kind
    what: str
    strength: float
    p_value: float


@dataclass(frozen=True)
class NamedEffect:
    """An effect that is missing in the base model.

    Attributes
    ----------
    name : str
        Name in the catalogue, or `UNLISTED`.
    stage : str
        Stage of the simulator, from command to picture, in which it acts.
    parameters : dict
        Fitted values by name with 95 % intervals.
    units : dict
        Unit of each parameter.
    heldout_mae_without, heldout_mae_with : float
        Mean absolute error [board edges] on held-out runs of the final model without and with this effect,
        all other parameters refitted.
    confusable_with : tuple of str
        Its ties: effects that explain the recordings as well in its place.
    reason : str
        Why these cannot be distinguished, in a sentence; empty if there are none.
    probability : float
        Probability that it or one of its ties acts, given these recordings and the catalogue.
    chosen_again : float
        Share of the selections without one recording that contain it or one of its ties; NaN if nothing was
        held out.
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
    """A scored hypothesis: the base model with added effects, all parameters refitted.

    Attributes
    ----------
    effects : tuple of str
        The added effects; empty for the base model.
    values : dict
        Fitted values of the effects' parameters, by ``effect.parameter``.
    gain : float
        Log-likelihood relative to the base model [nats], each with the random push that fits it best.
    penalty : float
        Penalty for its parameters and for its choice from the catalogue [nats].
    probability : float
        Probability among all scored sets.
    outcome : str
        The outcome in words.
    """

    effects: tuple[str, ...]
    values: dict[str, float]
    gain: float
    penalty: float
    probability: float
    outcome: str


@dataclass(frozen=True, eq=False)
class Plausible:
    """A plausible model.

    Attributes
    ----------
    model : Model
        The fitted model of a set of effects.
    probability : float
        Probability of the set among the plausible sets.
    """

    model: Model
    probability: float


@dataclass(frozen=True, eq=False)
class RunProof:
    """Predictions of a recording of n rows by models fitted to the other recordings.

    Attributes
    ----------
    recording : str
        Its name.
    times : (n,) array
        Time of each row [s].
    observed : (n, 2) array
        Observed positions [board edges], NaN in rows without a marble.
    base, final : (n, 2) arrays
        Predictions before and after [board edges].
    base_mae, final_mae : float
        Their mean absolute errors [board edges].
    base_model, final_model : Model
        The models, fitted to the other recordings; to this one if it is the only one.
    """

    recording: str
    times: Array
    observed: Array
    base: Array
    final: Array
    base_mae: float
    final_mae: float
    base_model: Model
    final_model: Model


@dataclass(frozen=True)
class NeededPush:
    """The missing push in a recording of n rows: acceleration of the marble beyond that of the simulator.

    Each is the mean given all rows, with its standard deviation, NaN in rows where it is unknown.

    Attributes
    ----------
    recording : str
        Its name.
    times : (n,) array
        Time of each row [s].
    base, base_deviation : (n, 2) arrays
        For the five-parameter model [m/s^2].
    final, final_deviation : (n, 2) arrays
        For the final model [m/s^2].
    """

    recording: str
    times: Array
    base: Array
    base_deviation: Array
    final: Array
    final_deviation: Array


@dataclass(frozen=True)
class Share:
    """A share of the base model's squared error on held-out recordings.

    Attributes
    ----------
    what : str
        An effect, "tracker" or "not repeatable".
    share : float
        From 0 to 1; the shares of a horizon add up to 1.
    horizon_s : float or None
        Prediction horizon [s]; None for complete runs.
    """

    what: str
    share: float
    horizon_s: float | None


@dataclass(frozen=True)
class Remains:
    """The error that neither named effects nor the tracker explain.

    Attributes
    ----------
    share : float
        Its share of the base model's squared error on held-out recordings, over complete runs.
    stage : str or None
        "board" if a random push increases the likelihood, "contact" if random rebounds increase it more; None
        if neither does.
    repeats : bool
        Whether the error depends on a variable that repeats from run to run.
    floor_of_the_log : float
        Error of a perfect simulator: mean absolute error of the final model on recordings simulated by
        itself, with the gaps and the noise of the rig's tracker [board edges].
    """

    share: float
    stage: str | None
    repeats: bool
    floor_of_the_log: float


@dataclass(frozen=True)
class Power:
    """The detectability of an effect.

    Attributes
    ----------
    effect, parameter, unit : str
        The effect, and its parameter that was varied, with the others at typical values.
    least : float or None
        Smallest size that would have been named with a probability of at least 0.8; None if even the largest
        size would not.
    largest : float
        Largest size tested.
    """

    effect: str
    parameter: str
    unit: str
    least: float | None
    largest: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The result of `irt.diagnose`.

    Attributes
    ----------
    verdict : {"sufficient", "missing", "unlisted"}
        The base model explains the recordings, effects of the catalogue are missing, or repeatable residuals
        remain that no effect explains.
    summary : str
        The result in one or two sentences.
    where : tuple of Finding
        Places where residuals of the base model exceed noise, the strongest of each kind first.
    effects : tuple of NamedEffect
        The missing effects, the most important first.
    noise : float
        Standard deviation of the tracker [board edges].
    base_mae, final_mae, base_heldout_mae, final_heldout_mae : float
        Mean absolute errors [board edges] of the base model and of the final model, on the runs that they
        were fitted to, and on held-out runs, each predicted by a fit to the others.
    base, model : Model
        The best fit of the five parameters, and the final model; both with 95 % intervals.
    indistinguishable : tuple of Model
        Models with other effects that explain the recordings as well as the final one.
    plausible : tuple of Plausible
        Plausible models, the final model first.
    unidentifiable : tuple of str
        Sentences on parameter combinations that are not identifiable from these recordings.
    suggestion : str
        What to record next, and why.
    candidates : tuple of Candidate
        All scored hypotheses, the best first.
    runs : tuple of RunProof
        Predictions and errors on held-out runs.
    power : tuple of Power
        Detectability of the effects of the catalogue; empty if effects are named.
    notes : tuple of str
        Sentences on other findings.
    settings : dict
        Settings of the diagnosis.
    seed : int
        Random seed.
    seconds : float
        Wall time.
    inclusion : dict
        Probability that each effect of the catalogue acts.
    budget : tuple of Share
        Error budget: shares of the base model's squared error on held-out runs, at several horizons.
    remains : Remains or None
        The unexplained error; None if nothing was held out.
    pushes : tuple of NeededPush
        The missing push in each recording; empty if nothing is missing.
    warnings : tuple of str
        Warnings of a check of the recordings (`irt.check`).
    sessions : tuple of Difference
        Values that differ between the sessions of a pooled rig (`irt.pool`).
    nested_heldout_mae : float
        Mean absolute error on held-out runs [board edges], each predicted by the set of effects selected on
        the other runs; NaN if nothing was held out.
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
        """Whether there are held-out errors; a single recording has none."""
        return math.isfinite(self.final_heldout_mae)

    def plot(self) -> Figure:
        """Draw the most improved run before and after; return a matplotlib figure."""
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
        # The time scale of stamped recordings has no interval; without stamps, time is in rows.
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
        """Return the contents of ``diagnosis.json``; numbers that are not finite are None."""
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
    content = {"value": one.value, "low": one.low, "high": one.high}
    return {key: None if value is None or math.isinf(value) else value for key, value in content.items()}


def _finite(content: Any) -> Any:
    """Return content with None in place of numbers that JSON cannot represent."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
