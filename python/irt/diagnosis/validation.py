"""The proof: each recording predicted by a fit to the others, by the likelihood that chose the set."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis import config
from irt.diagnosis.case import Case
from irt.diagnosis.hypotheses import MAP, simulated
from irt.diagnosis.score import Scored, Scores
from irt.model import Model
from irt.recording import Recording
from irt.residual import RunEvaluation, evaluate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Held:
    """One recording as a model predicts it that was fitted to the others.

    Attributes
    ----------
    prediction : (n, 2) array
        Of a run from its start, or of windows where recordings start in motion [board edges].
    mae : float
        Its mean absolute error [board edges].
    model : Model
        The fit to the others.
    evaluation : RunEvaluation
        Its errors from start to end, and in windows of `config.HORIZON_S`.
    """

    prediction: Array
    mae: float
    model: Model
    evaluation: RunEvaluation


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A set of effects, judged by recordings that its fit has not seen.

    Attributes
    ----------
    values : (folds, n) array
        What the fits without each recording have come to; no rows where there is one recording alone.
    runs : tuple of Held
        All recordings in the order of the rig; where there is one alone, what the fit to it makes of it.
    scores : (folds,) array
        The log posterior of the set given the recordings without each [nats]; NaN where values are those of
        free runs.
    """

    values: Array
    runs: tuple[Held, ...]
    scores: Array

    @property
    def is_proof(self) -> bool:
        """Whether anything was held out."""
        return len(self.values) > 0

    @functools.cached_property
    def mae(self) -> float:
        """Mean over the recordings of their mean absolute errors [board edges]."""
        return float(np.mean([one.mae for one in self.runs]))

    @functools.cached_property
    def windowed(self) -> float:
        """The same in windows of `config.HORIZON_S`; NaN where no recording is as long."""
        errors = [one.evaluation.windowed for one in self.runs]
        return float(np.mean([np.nan if one is None else one.mae for one in errors]))


@dataclass(eq=False)
class Validation:
    """Sets of effects as recordings that were held out judge them; each is fitted once."""

    _known: dict[Scored, HeldOut] = field(default_factory=dict)

    def of(self, one: Scored) -> HeldOut:
        """Return how a set predicts each recording, fitted to the others."""
        if one not in self._known:
            self._known[one] = _held_out(one)
        return self._known[one]


def _held_out(one: Scored) -> HeldOut:
    case = one.case
    folds = np.unique(case.folds)
    if len(folds) < 2:
        runs = tuple(_predicted(case, one.values, one.effects, each) for each in case.rig.recordings)
        return HeldOut(np.zeros((0, len(one.names))), runs, np.zeros(0))
    found = {int(fold): _fitted_without(one, int(fold)) for fold in folds}
    runs = tuple(
        _predicted(case, found.get(index, one).values, one.effects, recording)
        for index, recording in enumerate(case.rig.recordings)
    )
    scores = [np.nan if one.is_free else each.score for each in found.values()]
    return HeldOut(np.array([list(each.values.values()) for each in found.values()]), runs, np.array(scores))


def _fitted_without(one: Scored, fold: int) -> Scored:
    """Return a set as it is without one recording, from where all of them led."""
    keep = one.case.run_folds != fold
    rest = one.case.only([other for other in np.unique(one.case.folds) if other != fold])
    scores = Scores(rest, one.terms)
    # Free runs leave a map as it is: it has to come from the other recordings, too.
    if MAP in one.effects or not one.is_free:
        (top,) = scores.problem(one.effects).ascend(
            one.top.values[None], one.noise[None], [one.top.states[keep]], iterations=config.REFIT
        )
        one = replace(one, top=top)
    return scores.freed(one) if one.is_free else one


def _predicted(case: Case, values: Mapping[str, float], effects: tuple[str, ...], run: Recording) -> Held:
    model = case.model(simulated(effects), values)
    # Without stamps as many rows for every model, however long each takes a row to be.
    time_scaling = (
        1.0 if case.time_scale is not None else values["time_scale"] / np.mean(case.rig.ranges["time_scale"])
    )
    found = evaluate(model, [run], float(config.HORIZON_S * time_scaling)).runs[0]
    if case.rig.start == "moving":
        longer = evaluate(model, [run]).runs[0]
        if longer.windowed is not None:
            return Held(longer.windowed_prediction, longer.windowed.mae, model, found)
    assert found.free_run is not None, found.recording
    return Held(found.free_prediction, found.free_run.mae, model, found)
