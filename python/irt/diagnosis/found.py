"""What a search found, put into numbers and words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnosis import words
from irt.diagnosis.case import Case, Fitted
from irt.diagnosis.clock import without_clock
from irt.diagnosis.evidence import Evidence, is_explained, is_lost
from irt.diagnosis.heldout import HeldOut
from irt.diagnosis.jitter import with_clock
from irt.diagnosis.power import power
from irt.diagnosis.resampled import with_scatter
from irt.diagnosis.result import UNLISTED, Candidate, Diagnosis, Finding, NamedEffect, RunProof, units
from irt.diagnosis.rivals import reason
from irt.diagnosis.search import Search
from irt.diagnosis.several import Several
from irt.engine import SUBSTEP_S
from irt.fitting.identifiability import unidentifiable, with_intervals
from irt.fitting.information import Information
from irt.model import Model, Parameter
from irt.residual import evaluate
from irt.rig import PARAMETERS

Array = NDArray[np.float64]

#: No camera sees better than this [board edges]; the engine's fit takes no smaller noise either.
FINEST = 1e-6


class Found:
    """What a search found, to be put into words and numbers.

    Parameters
    ----------
    search : Search
        All that was tried.
    possible : sequence of (Case, Fitted)
        The recordings, with what the chosen hypothesis holds, and that; then the same with other grips.
    tied : dict
        Those that do as well, for each of its effects.
    spread : Parameter or None
        Standard deviation of the delays [s], where they differ from command to command.
    several : Several, optional
        How the hypothesis was found, where the marble was taken to be pushed at random besides.
    """

    def __init__(
        self,
        search: Search,
        possible: Sequence[tuple[Case, Fitted]],
        tied: dict[str, list[Fitted]],
        spread: Parameter | None,
        several: Several | None = None,
    ) -> None:
        self._search, self._possible, self._tied, self._spread = search, possible, tied, spread
        self._several = several
        self._case, self._best = possible[0]
        told = [_information(*one, search.held_out(self._best)) for one in possible]
        self._unidentifiable = unidentifiable(told[0])
        self._parameters = _joined([with_intervals(one) for one in told])
        self._proofs = {
            (): _proof(search, search.case, search.base),
            self._best.effects: _proof(search, self._case, self._best),
        }

    def diagnosis(self, where: Sequence[Finding]) -> Diagnosis:
        """Put everything together."""
        case, base, best = self._case, self._search.base, self._best
        set_found = self._several if self._several is not None and best.effects else None
        explained = is_explained(case, best, base) or (set_found is not None and set_found.is_whole)
        between = self._search.is_explained_between(best)
        before, after = self._proofs[base.effects], self._proofs[best.effects]
        effects = tuple(self._named(name) for name in self._ordered())
        if self._spread is not None:
            effects = tuple(self._jitter(one) if one.name == "delay" else one for one in effects)
        noise = max(best.noise, FINEST) if explained else case.noise
        verdict = "missing" if effects else "sufficient"
        leaves = self._spread is None and not explained and not between and is_lost(case, best, base)
        lost = leaves and set_found is None
        if UNLISTED in best.effects or lost:
            verdict = "unlisted"
        base_heldout, final_heldout = self._heldout(before), self._heldout(after)
        base_told = _information(self._search.case, base, self._search.held_out(base))
        return Diagnosis(
            verdict=verdict,  # type: ignore[arg-type]
            summary=words.summary(
                effects,
                noise=noise,
                before=_mean(before),
                after=_mean(after),
                heldout=len(case.rig.recordings) > 1,
                explained=explained or between,
                leaves=leaves,
                row_s=None if case.time_scale is not None else case.row_s(best),
            ),
            where=tuple(where),
            effects=effects,
            inclusion={} if self._several is None else self._several.posterior.probabilities(),
            noise=noise,
            base_mae=_free_run(self._search.case, base),
            final_mae=_free_run(case, best),
            base_heldout_mae=base_heldout,
            final_heldout_mae=final_heldout,
            base=_model(self._search.case, base, with_intervals(base_told)),
            model=_model(case, best, self._parameters),
            rivals=tuple(case.model(one) for alike in self._tied.values() for one in alike),
            unidentifiable=self._unidentifiable,
            suggestion=words.suggestion(effects, case.rig.path),
            candidates=self._candidates(),
            runs=tuple(
                _run(case, index, before[index], after[index]) for index in range(len(case.rig.recordings))
            ),
            power=() if effects else tuple(power(case, base, self._search.evidence())),
            notes=tuple(
                words.notes(
                    case,
                    best,
                    self._spread,
                    explained=explained,
                    explained_between=between,
                )
            ),
            settings={
                "rig": str(case.rig.path),
                "recordings": len(case.rig.recordings),
                "recordings_sha256": case.rig.digest,
                "version": version("labsim-irt"),
            },
            seed=case.seed,
            seconds=0.0,
        )

    def _ordered(self) -> list[str]:
        """Return the effects, the most important first: without which the rest explains least."""
        scale = self._search.evidence().scale

        def loss_without(name: str) -> float:
            return -self._search.without(self._best, name).loss(scale)

        return sorted(self._best.effects, key=loss_without)

    def _jitter(self, mean: NamedEffect) -> NamedEffect:
        """Return delays that differ: their spread beside the mean, which alone is in the model."""
        assert self._spread is not None
        spread = self._spread
        if self._case.time_scale is None:
            spread = with_clock(spread, self._parameters["time_scale"])
        return replace(
            mean,
            name="delay_jitter",
            stage=effect("delay_jitter").stage,
            parameters={"sd_s": spread, "mean_s": mean.parameters["delay_s"]},
            units={"sd_s": "s", "mean_s": "s"},
        )

    def _named(self, name: str) -> NamedEffect:
        without = self._search.without(self._best, name)
        errors = _proof(self._search, self._search.case, without)
        alike = self._tied.get(name, [])
        other_names = [_instead(self._best, one) for one in alike]
        pairs = zip(alike, other_names, strict=True)
        return NamedEffect(
            name=name,
            stage=effect(name).stage,
            parameters={
                key.removeprefix(f"{name}."): one
                for key, one in self._parameters.items()
                if key.startswith(f"{name}.")
            },
            units=units(name),
            heldout_mae_without=self._heldout(errors),
            heldout_mae_with=self._heldout(self._proofs[self._best.effects]),
            confusable_with=tuple(other_names),
            reason=" ".join(reason(self._case, self._best, one, name, other) for one, other in pairs),
        )

    @staticmethod
    def _heldout(errors: dict[int, tuple[Array, float]]) -> float:
        """Return the mean of errors on recordings held out; no number where there is one recording alone."""
        return _mean(errors) if len(errors) > 1 else float("nan")

    def _heldout_gain(self, held: HeldOut | None, evidence: Evidence) -> float | None:
        if held is None or not held.judged:
            return None
        base = self._search.held_out(self._search.base)
        return float((base.losses(evidence.scale) - held.losses(evidence.scale)).sum()) / evidence.memory

    def _candidates(self) -> tuple[Candidate, ...]:
        search, evidence = self._search, self._search.evidence()
        named = set(self._best.effects)
        alike = {one.effects for tied in self._tied.values() for one in tied}
        told = [
            Candidate(
                effects=one.effects,
                values=one.of_effects(),
                gain=evidence.gain(one, search.base),
                penalty=evidence.penalty(one),
                noise=one.noise,
                heldout_gain=self._heldout_gain(search.known_held_out(one), evidence),
                outcome=_outcome(evidence, one, search.base, named=named, alike=alike),
            )
            for one in search.fits.values()
        ]
        return tuple(sorted(told, key=lambda one: one.penalty - one.gain))


def _outcome(
    evidence: Evidence, one: Fitted, base: Fitted, *, named: set[str], alike: set[tuple[str, ...]]
) -> str:
    if set(one.effects) == named:
        return "named" if named else "enough"
    if not one.effects:
        return "the base model"
    if one.effects in alike:
        return "does as well"
    if not evidence.is_better(one, base):
        return "no better than the base model"
    if named < set(one.effects):
        return "adds nothing that recordings held out, and the marble between impacts, confirm"
    return "explains less"


def _instead(best: Fitted, other: Fitted) -> str:
    """Return the effect that another hypothesis has in the place of one of the best."""
    return next(name for name in other.effects if name not in best.effects)


def _information(case: Case, one: Fitted, held_out: HeldOut) -> Information:
    problem = case.problem(one.effects)
    told = Information.of(problem, one.values, problem.inform(one.values, case.noise))
    return with_scatter(without_clock(case, one, told), held_out)


def _joined(told: Sequence[dict[str, Parameter]]) -> dict[str, Parameter]:
    """Return the parameters of the first, with intervals that hold those of all."""
    joined = {}
    for name, one in told[0].items():
        lows = [other[name].low for other in told]
        highs = [other[name].high for other in told]
        ends = [end for end in (*lows, *highs) if end is not None]
        if len(ends) < len(lows) + len(highs):
            joined[name] = one
        else:
            joined[name] = Parameter(one.value, min(*ends, one.value), max(*ends, one.value))
    return joined


def _model(case: Case, one: Fitted, parameters: dict[str, Parameter]) -> Model:
    """Return a hypothesis' model; its five parameters carry their intervals."""
    plain = case.model(one)
    return Model(
        board=plain.board,
        marble=plain.marble,
        start=plain.start,
        ranges=plain.ranges,
        parameters={name: parameters[name] for name in PARAMETERS},
        effects=plain.effects,
        time_step=plain.time_step,
    )


def _proof(search: Search, case: Case, one: Fitted) -> dict[int, tuple[Array, float]]:
    """Return for each recording what a fit to the others predicts, and its mean absolute error.

    Where there are no others, it is the fit to it that predicts.
    """
    fits = dict(zip(np.unique(case.folds), search.held_out(one).fits, strict=False))
    told = {}
    for index, recording in enumerate(case.rig.recordings):
        evaluation = evaluate(case.model(fits.get(index, one)), [recording]).runs[0]
        if case.rig.start == "moving" and evaluation.windowed is not None:
            told[index] = evaluation.windowed_prediction, evaluation.windowed.mae
        else:
            assert evaluation.free_run is not None, evaluation.recording
            told[index] = evaluation.free_prediction, evaluation.free_run.mae
    return told


def _free_run(case: Case, one: Fitted) -> float:
    """Return the mean absolute error on the recordings that a hypothesis was fitted to."""
    evaluation = evaluate(case.model(one), case.rig.recordings)
    if case.rig.start == "moving" and evaluation.windowed is not None:
        return evaluation.windowed.mae
    return evaluation.mae


def _mean(errors: dict[int, tuple[Array, float]]) -> float:
    return float(np.mean([mae for _, mae in errors.values()]))


def _run(case: Case, index: int, before: tuple[Array, float], after: tuple[Array, float]) -> RunProof:
    recording = case.rig.recordings[index]
    rows = np.arange(len(recording.knobs))
    step = case.time_scale or float(np.mean(case.rig.ranges["time_scale"]))
    times = recording.stamps if recording.stamps is not None else rows * step * SUBSTEP_S
    return RunProof(
        recording=recording.name,
        times=np.asarray(times),
        observed=recording.marble,
        base=before[0],
        final=after[0],
        base_mae=before[1],
        final_mae=after[1],
    )
