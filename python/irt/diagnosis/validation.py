"""Cross-validation: predict each recording by a fit to the others."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from irt.diagnosis import config
from irt.diagnosis.dataset import NEVER, Dataset
from irt.diagnosis.hypotheses import MAP, simulated
from irt.diagnosis.score import Scored, Scores, start_unknown
from irt.model import Model
from irt.recording import Recording
from irt.residual import RunEvaluation, evaluate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Held:
    """A held-out recording, predicted by a model fitted to the others.

    Attributes
    ----------
    prediction : (n, 2) array
        Prediction of the complete run, or in windows if recordings start in motion [board edges].
    firsts : tuple of int
        First rows of these windows; 0 for the complete run.
    mae : float
        Its mean absolute error [board edges].
    model : Model
        The model fitted to the other recordings.
    evaluation : RunEvaluation
        Errors over the complete run, and in windows of `config.HORIZON_S`.
    """

    prediction: Array
    firsts: tuple[int, ...]
    mae: float
    model: Model
    evaluation: RunEvaluation


@dataclass(frozen=True, eq=False)
class HeldOut:
    """The cross-validation of a set of effects.

    Attributes
    ----------
    values : (folds, n) array
        Parameters fitted without each recording; no rows for a single recording.
    runs : tuple of Held
        All recordings in the order of the rig; a single recording is predicted by the fit to itself.
    scores : (folds,) array
        Log posterior of the set without each recording [nats]; NaN if values are from free runs.
    fits : tuple of Scored
        The set fitted without each recording.
    whole : Scored
        The set fitted to all recordings.
    """

    values: Array
    runs: tuple[Held, ...]
    scores: Array
    fits: tuple[Scored, ...]
    whole: Scored

    @property
    def is_proof(self) -> bool:
        """Whether anything was held out."""
        return len(self.values) > 0

    @property
    def errors(self) -> Array:
        """Mean absolute errors of the recordings, (r,) [board edges]."""
        return np.array([one.mae for one in self.runs])

    @property
    def windowed_errors(self) -> Array:
        """The same in windows of `config.HORIZON_S`, (r,); NaN if a recording is too short."""
        errors = [one.evaluation.windowed for one in self.runs]
        return np.array([np.nan if one is None else one.mae for one in errors])

    @functools.cached_property
    def errors_of_windows(self) -> Array:
        """The same of each window of all recordings, NaN without an observation, (w,)."""
        found = []
        for one, recording in zip(self.runs, self.whole.dataset.rig.recordings, strict=True):
            off = np.abs(one.evaluation.windowed_prediction - recording.marble)
            for window in np.split(off, one.evaluation.window_rows)[1:]:
                known = window[np.isfinite(window)]
                found.append(float(known.mean()) if len(known) else np.nan)
        return np.array(found)

    @functools.cached_property
    def predictive(self) -> Array:
        """Log predictive density of each recording given the others [nats]; not of values from free runs.

        It is the evidence of all recordings over that of the others, so it integrates over the values: where
        these differ by their standard errors, impacts differ, and likelihoods fall by hundreds of nats.
        """
        return self.whole.log_evidence - np.array([each.log_evidence for each in self.fits])

    @functools.cached_property
    def fitted(self) -> Array:
        """Log-likelihood of each recording by the filter with values fitted to all [nats]."""
        if not self.fits:
            return np.zeros(0)
        one, top = self.whole, self.whole.top
        begun = start_unknown(one.dataset, top.noise[np.newaxis], [top.states])
        (found,) = Scores.of(one).problem(one.effects).filter(top.values[np.newaxis], *begun)
        folds, run_folds = np.unique(one.dataset.folds), one.dataset.run_folds
        return np.array([found.log_likelihood[run_folds == fold].sum() for fold in folds])

    @functools.cached_property
    def mae(self) -> float:
        """Mean over the recordings of their mean absolute errors [board edges]."""
        return float(np.mean(self.errors))

    @functools.cached_property
    def windowed(self) -> float:
        """The same in windows of `config.HORIZON_S`; NaN if a recording is too short."""
        return float(np.mean(self.windowed_errors))

    @functools.cached_property
    def explained(self) -> float:
        """The explained share of the marble's motion: of complete runs or of windows, whichever is larger.

        It is 1 less the ratio of the mean absolute error to that of a marble that stays where a prediction
        starts: a skill score (Murphy, "Skill scores based on the mean square error", 1988).
        """
        observed = [one.marble for one in self.whole.dataset.rig.recordings]
        complete = [(one.prediction, one.firsts) for one in self.runs]
        windows = [
            (one.evaluation.windowed_prediction, one.evaluation.window_rows.tolist()) for one in self.runs
        ]
        return max(skill(observed, complete), skill(observed, windows))

    @property
    def misses_motion(self) -> bool:
        """Whether most of the marble's motion is unexplained, and free runs miss by more than the noise."""
        return not self.whole.is_exact and self.explained < config.EXPLAINED


@dataclass(eq=False)
class Validation:
    """Cache of the cross-validations of sets of effects."""

    _known: dict[Scored, HeldOut] = field(default_factory=dict)
    _fitted: dict[Scored, float] = field(default_factory=dict)

    def fitted_mae(self, one: Scored) -> float:
        """Return the mean absolute error of a set on the recordings that it was fitted to [board edges]."""
        if one not in self._fitted:
            self._fitted[one] = float(np.mean([each.mae for each in _of_fit(one)]))
        return self._fitted[one]

    def of(self, one: Scored) -> HeldOut:
        """Return the cross-validation of a set."""
        if one not in self._known:
            self._known[one] = _held_out(one)
        return self._known[one]

    def is_better(self, one: Scored, than: Scored) -> bool:
        """Whether the held-out recordings agree that a set predicts better than another.

        A paired t-test of the logarithms of the errors over the recordings, in complete runs or in windows of
        `config.HORIZON_S`: a random push makes free runs differ by more than any two sets do.
        """
        here, other = self.of(one), self.of(than)
        return here.is_proof and (
            self.runs_agree(one, than) or agree(np.log(other.windowed_errors / here.windowed_errors))
        )

    def windows_agree(self, one: Scored, than: Scored) -> bool:
        """Whether the windows of all held-out recordings agree that a set predicts better than another.

        Each has a start state of its own, so that those of a recording are separate trials.
        """
        gains = self.of(than).errors_of_windows - self.of(one).errors_of_windows
        known = gains[np.isfinite(gains)]
        return len(known) > 1 and agree(known)

    def runs_agree(self, one: Scored, than: Scored) -> bool:
        """Whether complete held-out recordings agree that a set predicts better than another.

        Errors grow with the drive and with the length, so it is by their ratios that recordings agree.
        """
        return agree(np.log(self.of(than).errors / self.of(one).errors))

    def is_likelier(self, one: Scored, than: Scored) -> bool:
        """Whether held-out recordings are certainly likelier with a set than with another, and agree on it.

        The filter corrects the marble in every row. Errors of windows contain those of their start states,
        and those of free runs contain pushes that do not repeat: both can hide what the rows show.
        """
        gains = self.likelihood_gains(one, than)
        return bool(gains.sum() > config.SURE) and agree(gains)

    def each_is_likelier(self, one: Scored, than: Scored) -> bool:
        """Whether every held-out recording, by itself, is certainly likelier with a set than with another.

        Of few recordings a t-test asks that they gain about equally, which those of unequal drives do not.
        """
        return bool((self.likelihood_gains(one, than) > config.SURE).all())

    def likelihood_gains(self, one: Scored, than: Scored) -> Array:
        """Return the gain in log predictive density of each held-out recording over another set, (r,) [nats].

        A recording that is held out does not speak more clearly for a set than one that is fitted: what it
        gains beyond that, the other set lost because it was refitted to another of its maxima.
        """
        here, other = (self.of(each.filtered or each) for each in (one, than))
        return np.minimum(here.predictive - other.predictive, here.fitted - other.fitted)

    def difference(self, one: Scored, other: Scored) -> float:
        """Return the root mean square difference of two sets' predictions [board edges].

        In windows of `config.HORIZON_S`, from equal start states; NaN if no recording is long enough.
        """
        pairs = zip(self.of(one).runs, self.of(other).runs, strict=True)
        squares = np.concatenate(
            [np.square(a.evaluation.windowed_prediction - b.evaluation.windowed_prediction) for a, b in pairs]
        )
        known = squares[np.isfinite(squares)]
        return float(np.sqrt(known.mean())) if len(known) else math.nan


def agree(gains: Array) -> bool:
    """Whether the mean of gains is above zero, at a level of 5 %."""
    count = len(gains)
    error = float(np.std(gains, ddof=1)) / math.sqrt(count)
    return bool(np.mean(gains) > stdtrit(count - 1, 0.95) * error)


def skill(observed: Sequence[Array], predicted: Sequence[tuple[Array, Sequence[int]]]) -> float:
    """Return the skill of predictions (n, 2) over a marble at rest, each with the first rows of its windows.

    The marble rests where it was seen before the window, or in row 0. Minus infinity if nothing moves.
    """
    error, motion = 0.0, 0.0
    for seen, (prediction, firsts) in zip(observed, predicted, strict=True):
        for first, end in itertools.pairwise([*firsts, len(seen)]):
            start = _last_known(seen[: max(first, 1)])
            rows = np.isfinite(prediction[first:end] + seen[first:end]).all(axis=1)
            error += float(np.abs(prediction[first:end] - seen[first:end])[rows].sum())
            motion += float(np.abs(start - seen[first:end])[rows].sum())
    return 1.0 - error / motion if motion > 0.0 else -math.inf


def _last_known(seen: Array) -> Array:
    """Return the last known position of (n, 2), NaN without one."""
    known = np.flatnonzero(np.isfinite(seen).all(axis=1))
    return np.asarray(seen[known[-1]]) if len(known) else np.full(2, np.nan)


def _held_out(one: Scored) -> HeldOut:
    dataset = one.dataset
    folds = np.unique(dataset.folds)
    if len(folds) < 2:
        return HeldOut(np.zeros((0, len(one.names))), _of_fit(one), np.zeros(0), (), one)
    fits = tuple(_fitted_without(one, folds))
    found = {int(fold): each for fold, each in zip(folds, fits, strict=True)}
    runs = tuple(
        _predicted(dataset, found.get(index, one).values, one.effects, recording)
        for index, recording in enumerate(dataset.rig.recordings)
    )
    scores = [np.nan if one.is_free else each.score for each in fits]
    return HeldOut(np.array([list(each.values.values()) for each in fits]), runs, np.array(scores), fits, one)


def _of_fit(one: Scored) -> tuple[Held, ...]:
    """Predict each recording by the fit to all of them."""
    dataset = one.dataset
    return tuple(_predicted(dataset, one.values, one.effects, each) for each in dataset.rig.recordings)


def _fitted_without(one: Scored, folds: NDArray[np.int64]) -> list[Scored]:
    """Return a set refitted without each recording, starting at the fit to all."""
    tops = [one.top] * len(folds)
    # Free runs hold a slope map, so it must be fitted to the other recordings by the filter.
    if MAP in one.effects or not one.is_free:
        top, problem = (one.filtered or one).top, Scores.of(one).problem(one.effects)
        run_folds = [None if fold == NEVER else fold for fold in one.dataset.run_folds.tolist()]
        tops = problem.leave_out(top.values, top.noise, top.states, run_folds, iterations=config.REFIT)
    found = [replace(one, top=top) for top in tops]
    if not one.is_free:
        return found
    return [
        Scores(one.dataset.only([other for other in folds if other != fold]), one.terms).freed(each)
        for fold, each in zip(folds, found, strict=True)
    ]


def _predicted(
    dataset: Dataset, values: Mapping[str, float], effects: tuple[str, ...], run: Recording
) -> Held:
    model = dataset.model(simulated(effects), values)
    found = evaluate(model, [run], dataset.horizon_s(model)).runs[0]
    if dataset.rig.start == "moving":
        longer = evaluate(model, [run]).runs[0]
        if longer.windowed is not None:
            firsts = tuple(longer.window_rows.tolist())
            return Held(longer.windowed_prediction, firsts, longer.windowed.mae, model, found)
    assert found.free_run is not None, found.recording
    return Held(found.free_prediction, (0,), found.free_run.mae, model, found)
