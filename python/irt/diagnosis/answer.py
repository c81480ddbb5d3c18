"""Turn the selected set of effects into a `Diagnosis`."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import EffectInfo, effect
from irt.diagnosis import config, words
from irt.diagnosis.budget import REST, budget, twins_of
from irt.diagnosis.dataset import Dataset
from irt.diagnosis.detectability import detectability
from irt.diagnosis.held_out_tilt import TiltPredictions, of_sweeps, with_sensor
from irt.diagnosis.hypotheses import ALIKE, INERTIA, JITTER, group_of
from irt.diagnosis.latent_force import LatentForce, Source
from irt.diagnosis.locate import CLEAR, locate, stages, variables
from irt.diagnosis.needed import Needed
from irt.diagnosis.nested import Nested, nested
from irt.diagnosis.posterior import posterior
from irt.diagnosis.relevance import Relevance
from irt.diagnosis.result import (
    UNLISTED,
    Candidate,
    Diagnosis,
    Finding,
    NamedEffect,
    NeededPush,
    Plausible,
    Remains,
    RunProof,
    Share,
    Verdict,
)
from irt.diagnosis.score import LASTING, LASTING_S, SCALE_OF_NORMAL, WHITE, Scored, Scores
from irt.diagnosis.sessions import Difference, differences, sentences
from irt.diagnosis.sets import Posterior, probabilities
from irt.diagnosis.terms import AT_RIM
from irt.diagnosis.ties import Tie, reason, ties
from irt.diagnosis.time_symmetry import at_one_time_scale
from irt.diagnosis.validation import HeldOut
from irt.engine import SUBSTEP_S
from irt.fitting.problem import in_unit_of
from irt.model import Model, Parameter
from irt.recording import Recording
from irt.residual import evaluate
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: Largest p-value at which the remaining error counts as repeatable.
_SURELY = 0.01


class Answer:
    """The selected set of effects, and its evaluation.

    Parameters
    ----------
    best : Scored
        The set, reduced to the effects that matter.
    relevance : Relevance
        Held-out errors, and all scored sets.
    immaterial : frozenset of str
        Effects that are probable but do not matter.
    """

    def __init__(self, best: Scored, relevance: Relevance, immaterial: frozenset[str]) -> None:
        self._best, self._relevance, self._immaterial = best, relevance, immaterial
        self._posterior: Posterior = relevance.posterior
        self._dataset: Dataset = relevance.selection.scores.dataset
        self._names = relevance.named(best)
        self._base = relevance.selection.baseline if self._names else best
        self._proof = relevance.validation.of(best)
        self._base_proof = relevance.validation.of(self._base)
        self._parameters, self._unidentifiable = relevance.estimates(best)
        self._known_sources: dict[Scored, list[Source]] = {}

    def diagnosis(self, report: Callable[[str], None]) -> Diagnosis:
        """Assemble the diagnosis."""
        dataset, best = self._dataset, self._best
        report("locating the mismatch")
        where = self._where()
        report("ties")
        tied = [] if UNLISTED in best.effects else ties(self._relevance.exchanges, best)
        report("held-out errors")
        order = self._ordered(self._names)
        again = self._chosen_again(tied)
        effects = tuple(self._named(name, [one for one in tied if one.name == name], again) for name in order)
        base, answer = self._base_proof, self._proof
        is_held_out = answer.is_proof
        final = answer.runs[0].model
        white, lasting, lasting_s = best.noise[[WHITE, LASTING, LASTING_S]].tolist()
        sizes = (white / SCALE_OF_NORMAL, lasting / SCALE_OF_NORMAL, lasting_s)
        simulated = twins_of(dataset.rig, final, sizes, dataset.seed)
        twins = evaluate(final, simulated, dataset.horizon_s(final))
        without = {name: self._without(name) for name in self._ordered(best.effects) if order}
        shares = budget(base, answer, without, twins.runs) if is_held_out else ()
        measured = [*self._measured, *dataset.sweeps]
        return Diagnosis(
            verdict=self._verdict(order),
            summary=words.summary(
                effects,
                noise=self._noise,
                before=base.mae,
                after=answer.mae,
                heldout=is_held_out,
                rest=self._rest,
                unnamed=self._unnamed,
                row_s=self._row_s,
            ),
            where=where,
            effects=effects,
            noise=self._noise,
            base_mae=_free_run(self._base),
            final_mae=_free_run(best),
            base_heldout_mae=base.mae if is_held_out else float("nan"),
            final_heldout_mae=answer.mae if is_held_out else float("nan"),
            base=with_sensor(_model(self._base, self._relevance.parameters(self._base)[0]), measured),
            model=replace(
                with_sensor(_model(best, self._parameters), measured),
                posterior=posterior(self._likely(tied), self._proof, self._parameters),
            ),
            indistinguishable=tuple(one.scored.fitted.model for one in tied),
            plausible=self._plausible(tied),
            unidentifiable=self._unidentifiable,
            suggestion=words.suggestion(effects, dataset.rig.path, self._rest),
            candidates=self._candidates(tied),
            runs=self._runs(),
            power=() if effects else tuple(detectability(self._scores, self._base)),
            notes=(
                *words.notes(
                    dataset,
                    best.fitted,
                    next((one.parameters for one in effects if one.name == JITTER), None),
                    explained=self._is_whole,
                ),
                *words.beyond(effects, {name: self._info(name) for name in order if name != UNLISTED}),
                *words.smoothed(effects, dataset.row_s(best.fitted)),
                *self._notes_on_unnamed(),
                *sentences(self._recordings, self._differences),
                *self._notes_on_tilt(tied),
            ),
            settings={
                "rig": str(dataset.rig.path),
                "recordings": len(dataset.rig.recordings),
                "recordings_sha256": dataset.digest,
                "version": version("labsim-irt"),
            },
            seed=dataset.seed,
            seconds=0.0,
            # Where most of the motion is unexplained, probable effects only imitate its cause.
            inclusion={}
            if self._misses_motion
            else self._posterior.probabilities((self._immaterial | set(best.effects)) - set(self._names)),
            budget=shares,
            remains=self._remains(shares, _error_of(final, simulated, dataset)) if is_held_out else None,
            pushes=self._pushes() if where else (),
            sessions=tuple(self._differences),
            nested_heldout_mae=float("nan") if again is None else again.mae,
        )

    @functools.cached_property
    def _recordings(self) -> list[str]:
        """Names of the recordings that were held out, one after the other."""
        return [self._dataset.rig.recordings[int(fold)].name for fold in np.unique(self._dataset.folds)]

    @functools.cached_property
    def _measured(self) -> list[Recording]:
        """The recordings with the tilt that the filter sees."""
        with_tilt = {one.recording: one.run for one in self._dataset.runs}
        return [with_tilt.get(one.name, one) for one in self._dataset.rig.recordings]

    @functools.cached_property
    def _differences(self) -> list[Difference]:
        """What differs between the sessions of the rig, where several were pooled."""
        without = at_one_time_scale(self._best.names, self._proof.values, self._best.fitted)
        columns = dict(zip(self._best.names, without.T, strict=True))
        own = {name: columns[name] for name in self._best.fitted.names}
        return differences(self._recordings, self._best.values, own) if self._proof.is_proof else []

    @property
    def _scores(self) -> Scores:
        return self._relevance.selection.scores

    @property
    def _noise(self) -> float:
        """Standard deviation of the tracker's noise [board edges]."""
        return self._best.tracker

    @functools.cached_property
    def _push(self) -> float:
        """Gain in log-likelihood by a random push [nats]."""
        return Scores.of(self._best).push(self._best)

    @functools.cached_property
    def _rebounds(self) -> float:
        """Gain in log-likelihood by random rebounds and departures from the rim [nats]."""
        return Scores.of(self._best).rebounds(self._best)

    @property
    def _is_pushed(self) -> bool:
        """Whether the set needs a random push that matters to the error."""
        return self._push >= config.SURE and not self._best.is_exact

    @functools.cached_property
    def _is_quiet(self) -> bool:
        """Whether the set needs neither a random push nor random rebounds that matter."""
        return self._best.is_exact or max(self._push, self._rebounds) < config.SURE

    @property
    def _is_whole(self) -> bool:
        """Whether the set is complete: it is quiet, and its own noise allows the errors of its free runs."""
        return self._is_quiet and not self._exceeds_noise

    @functools.cached_property
    def _exceeds_noise(self) -> bool:
        """Whether free runs err more than the set's noise, part of which lasts, although it is quiet.

        Noise that lasts may follow from row to row what is missing, which a free run cannot.
        """
        best = self._best
        if (
            best.is_exact
            or not self._is_quiet
            or not best.errs_more_than(math.hypot(self._noise, best.drift))
        ):
            return False
        return Scores.of(best).loss_without(best, [LASTING]) >= config.SURE

    @property
    def _misses_motion(self) -> bool:
        """Whether nothing is named, and most of the marble's motion is unexplained."""
        return not self._names and self._proof.misses_motion

    @property
    def _is_of_the_rim(self) -> bool:
        """Whether a learned correction acts at the rim only."""
        return all(term.law in AT_RIM for term in self._best.terms)

    @property
    def _rest(self) -> words.Rest:
        """Origin of errors that are clearly more than noise."""
        if self._misses_motion:
            return "motion"
        if self._is_whole:
            return ""
        if self._exceeds_noise:
            return "noise"
        if not self._is_pushed:
            return "rim"
        return "push" if self._repeats else "chance"

    def _verdict(self, order: list[str]) -> Verdict:
        """Return the verdict; it is "unlisted" if the most important effect is the learned correction.

        Without effects, a push that does not repeat is not missing physics, because no simulator can predict
        it. But five parameters that leave most of the motion unexplained, or more than their noise allows,
        are not sufficient, no matter how their noise or push accounts for it.
        """
        if not order:
            repeats = self._is_pushed and self._repeats
            return "unlisted" if repeats or self._rest in {"motion", "noise"} else "sufficient"
        return "unlisted" if order[0] == UNLISTED else "missing"

    def _where(self) -> tuple[Finding, ...]:
        if not self._names and self._is_whole and not self._misses_motion:
            return ()
        base, sources = self._base.fitted, self._sources(self._base)
        named = () if UNLISTED in self._names or self._is_pushed else self._names
        return (
            *self._needed_before.findings(CLEAR),
            *variables(self._best.terms, sources),
            *locate(base, self._noise),
            *stages(base, sources, {effect(name).stage for name in named}),
        )

    @functools.cached_property
    def _needed_before(self) -> Needed:
        return Needed(self._base)

    @functools.cached_property
    def _needed(self) -> Needed:
        return Needed(self._best) if self._best is not self._base else self._needed_before

    def _pushes(self) -> tuple[NeededPush, ...]:
        before, after = self._needed_before.over_time, self._needed.over_time
        times = {one.name: self._times(one) for one in self._dataset.rig.recordings}
        return tuple(NeededPush(name, times[name], *before[name], *after[name]) for name in before)

    def _sources(self, one: Scored) -> list[Source]:
        """Return the variables that the residuals of a set may depend on."""
        if one not in self._known_sources:
            self._known_sources[one] = LatentForce(one.fitted).sources(self._dataset.seed)
        return self._known_sources[one]

    def _without(self, name: str) -> HeldOut:
        return self._relevance.validation.of(self._relevance.without(self._best, name))

    def _ordered(self, names: Sequence[str]) -> list[str]:
        """Return effects by importance: the largest held-out error without it first."""
        return sorted(names, key=lambda name: -self._without(name).mae)

    @property
    def _row_s(self) -> float | None:
        """Duration of a row in the simulation [s] if recordings have no stamps."""
        dataset = self._dataset
        return None if dataset.time_scale is not None else dataset.row_s(self._best.fitted)

    @functools.cached_property
    def _unnamed(self) -> dict[str, list[str]]:
        """Effects in the model that are not named, by what they are."""
        found: dict[str, list[str]] = {}
        for name in self._best.effects:
            if name not in self._names:
                found.setdefault(words.unnamed(effect(name)), []).append(name)
        return found

    def _notes_on_unnamed(self) -> Iterator[str]:
        """Yield notes on effects that are in the model and not named."""
        board = self._dataset.rig.board
        for name in self._unnamed.get(words.LAW_OF_IMPACTS, ()):
            more, rubs = (self._best.values[f"{name}.{key}"] for key in ("increase", "friction_increase"))
            yield words.impacts(
                (board.wall_restitution, board.wall_restitution + more),
                (board.wall_friction, board.wall_friction + rubs),
            )
        if words.TURNING in self._unnamed:
            yield words.turning(1.0 / self._best.values[f"{INERTIA}.rate_per_s"], self._row_s)
        if words.CORNERS in self._unnamed:
            yield words.corners(self._unnamed[words.CORNERS])

    def _notes_on_tilt(self, tied: Sequence[Tie]) -> Iterator[str]:
        """Yield how well held-out recordings' measured tilt is predicted, if there is any."""
        said = TiltPredictions(
            recordings=self._measured,
            answer=[one.model for one in self._proof.runs],
            base=[one.model for one in self._base_proof.runs],
            tied=[one.scored.fitted.model for one in tied],
            is_held_out=self._proof.is_proof,
            noise_rad=self._dataset.rig.tilt.noise_rad,
        ).sentence()
        if said is not None:
            yield said
        if self._dataset.sweeps:
            yield of_sweeps(self._best.fitted.model, self._dataset.sweeps)

    def _chosen_again(self, tied: Sequence[Tie]) -> Nested | None:
        """Repeat the selection without each recording: answer, subsets, ties and likely sets compete."""
        if not self._proof.is_proof:
            return None
        best = self._best
        less = [self._scores.base(), *(self._relevance.without(best, name) for name in best.effects)]
        likely = [one for one, _ in self._likely(tied)]
        return nested([best, *less, *(one.scored for one in tied), *likely], self._relevance.validation)

    def _info(self, name: str) -> EffectInfo:
        """Return what the catalogue says of an effect, in the unit of the rig's commands."""
        return in_unit_of(self._dataset.rig, effect(name))

    def _named(self, name: str, tied: list[Tie], again: Nested | None) -> NamedEffect:
        own, info = f"{name}.", self._info(name)
        found = {key.removeprefix(own): one for key, one in self._parameters.items() if key.startswith(own)}
        alike = [*group_of(name), *(one.instead for one in tied)]
        # A learned correction is not part of the catalogue's posterior.
        chance = 1.0 if name == UNLISTED else self._posterior.any_of(alike)
        return NamedEffect(
            name=name,
            stage="contact" if name == UNLISTED and self._is_of_the_rim else info.stage,
            parameters=found,
            units={"sd_s": "s", "mean_s": "s"} if name == JITTER else info.units,
            heldout_mae_without=self._without(name).mae if self._proof.is_proof else float("nan"),
            heldout_mae_with=self._proof.mae if self._proof.is_proof else float("nan"),
            confusable_with=tuple(one.instead for one in tied),
            reason=" ".join(reason(self._best, one) for one in tied),
            probability=chance,
            chosen_again=float("nan") if again is None else again.share_with(alike),
        )

    def _remains(self, shares: tuple[Share, ...], floor: float) -> Remains:
        rest = [one.share for one in shares if one.what == REST and one.horizon_s is None]
        stage = None
        if not self._is_whole or self._misses_motion:
            stage = "contact" if self._rebounds > self._push else "board"
        repeats = self._is_pushed and self._repeats
        return Remains(share=rest[0] if rest else 0.0, stage=stage, repeats=repeats, floor_of_the_log=floor)

    @functools.cached_property
    def _repeats(self) -> bool:
        """Whether a relevant part of the remaining push depends on a variable that repeats.

        Small dependences are ignored, because no engine reproduces the motion of a rig exactly.
        """
        share = self._needed.repeating(_SURELY)
        gain = self._proof.mae * (1.0 - math.sqrt(max(0.0, 1.0 - share)))
        return gain >= config.MATTERS * self._noise

    def _plausible(self, tied: list[Tie]) -> tuple[Plausible, ...]:
        return tuple(Plausible(one.fitted.model, chance) for one, chance in self._likely(tied))

    def _likely(self, tied: Sequence[Tie]) -> list[tuple[Scored, float]]:
        """Return the sets that are mentioned, the answer first, with their probabilities."""
        return self._posterior.likely(
            self._best, [one.scored for one in tied if {one.name, one.instead} == ALIKE]
        )

    def _candidates(self, tied: list[Tie]) -> tuple[Candidate, ...]:
        alike = {frozenset(one.scored.effects) for one in tied}
        base = self._scores.base()
        sets = {frozenset(one.effects): one for one in (*self._posterior.sets, self._best)}
        found = []
        chances = probabilities([one.score for one in sets.values()])
        for one, chance in zip(sets.values(), chances, strict=True):
            gain = one.top.log_likelihood - base.top.log_likelihood
            found.append(
                Candidate(
                    effects=one.effects,
                    values={name: value for name, value in one.values.items() if "." in name},
                    gain=gain,
                    penalty=gain - (one.score - base.score),
                    probability=float(chance),
                    outcome=_outcome(one, base, self._best, self._names, alike),
                )
            )
        return tuple(sorted(found, key=lambda one: one.penalty - one.gain))

    def _runs(self) -> tuple[RunProof, ...]:
        proofs = zip(self._dataset.rig.recordings, self._base_proof.runs, self._proof.runs, strict=True)
        return tuple(
            RunProof(
                recording=recording.name,
                times=self._times(recording),
                observed=recording.marble,
                base=before.prediction,
                final=after.prediction,
                base_mae=before.mae,
                final_mae=after.mae,
                base_model=before.model,
                final_model=after.model,
            )
            for recording, before, after in proofs
        )

    def _times(self, recording: Recording) -> Array:
        """Return the time of each row (n,) [s]; without stamps by the middle of the time scale's range."""
        if recording.stamps is not None:
            return np.asarray(recording.stamps)
        step = self._dataset.time_scale or float(np.mean(self._dataset.rig.ranges["time_scale"]))
        return np.asarray(np.arange(len(recording.knobs)) * step * SUBSTEP_S)


def _outcome(
    one: Scored, base: Scored, best: Scored, names: Collection[str], alike: set[frozenset[str]]
) -> str:
    """Return the outcome of a set in words."""
    own, answer = set(one.effects), set(best.effects)
    if own == answer:
        return "named" if names else "sufficient"
    if not own:
        return "the base model"
    if frozenset(own) in alike:
        return "equally good"
    if one.score < base.score + config.SURE:
        return "no better than the base model"
    if answer < own:
        return "not confirmed by held-out recordings"
    return "explains less"


def _model(one: Scored, parameters: dict[str, Parameter]) -> Model:
    """Return a set's model; its five parameters carry their intervals."""
    plain = one.fitted.model
    return Model(
        board=plain.board,
        marble=plain.marble,
        start=plain.start,
        ranges=plain.ranges,
        parameters={name: parameters[name] for name in PARAMETERS},
        effects=plain.effects,
        time_step=plain.time_step,
    )


def _free_run(one: Scored) -> float:
    """Return the mean absolute error on the recordings that a set was fitted to."""
    return _error_of(one.fitted.model, one.dataset.rig.recordings, one.dataset)


def _error_of(model: Model, recordings: Sequence[Recording], dataset: Dataset) -> float:
    """Return the mean absolute error of a model, in windows as of held-out recordings in motion."""
    evaluation = evaluate(model, recordings)
    if dataset.rig.start == "moving" and evaluation.windowed is not None:
        return evaluation.windowed.mae
    return evaluation.mae
