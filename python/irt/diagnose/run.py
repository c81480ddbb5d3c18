"""From recordings to a diagnosis: fit, locate, name, compare, prove."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.catalogue import effect
from irt.diagnose import words
from irt.diagnose.case import Case, Fitted
from irt.diagnose.diagnosis import UNLISTED, Candidate, Diagnosis, Finding, NamedEffect, RunProof, units
from irt.diagnose.evidence import Evidence, is_explained
from irt.diagnose.grip import grips
from irt.diagnose.heldout import HeldOut, hold_out
from irt.diagnose.jitter import differing_delays
from irt.diagnose.locate import leftover_sources, locate, stages
from irt.diagnose.power import power
from irt.diagnose.rivals import reason, rivals
from irt.diagnose.search import Report, Search
from irt.diagnose.unlisted import confirmed
from irt.fitting.fit import Progress
from irt.fitting.identifiability import unidentifiable, with_intervals
from irt.fitting.information import Information
from irt.model import Effect, Model, Parameter
from irt.residual import evaluate
from irt.rig import PARAMETERS, Rig
from irt.rollouts import SUBSTEP_S

Array = NDArray[np.float64]

#: Steps that a diagnosis takes at most, for the progress bar alone.
_STEPS = 120


def diagnose(
    rig: Rig, *, seed: int = 0, threads: int | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Fit, locate the mismatch, name the missing physics, model it, and prove it on recordings held out.

    Parameters
    ----------
    rig : Rig
        The recordings; a rig of one recording can be diagnosed, but not proved.
    seed : int
        Of all draws. The same seed gives the same answer for any number of threads.
    threads : int, optional
        Threads of the engine; by default one for each core.
    progress : callable, optional
        Called with (done, total, text); the text says what is tried.

    Raises
    ------
    IrtError
        If some recordings are stamped and others not, or nothing was seen.
    """
    began = time.perf_counter()
    steps = 0

    def report(text: str) -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(min(steps, _STEPS - 1), _STEPS, text)

    case = Case.of(rig, seed=seed, threads=threads)
    search = Search(case, report)
    try:
        found = _found(search, report)
    except KeyboardInterrupt as stopped:
        raise Interrupted(search) from stopped
    if progress is not None:
        progress(_STEPS, _STEPS, "done")
    return replace(found, seconds=time.perf_counter() - began)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a diagnosis.

    Attributes
    ----------
    candidates : list of dict
        The hypotheses that were tried until then, as in ``diagnosis.json``: no answer yet.
    """

    def __init__(self, search: Search) -> None:
        super().__init__()
        evidence = search.evidence() if search.fits else None
        self.candidates = [
            {
                "effects": list(one.effects),
                "values": one.of_effects(),
                "gain": evidence.gain(one, search.base),
                "penalty": evidence.penalty(one),
                "noise": one.noise,
            }
            for one in search.fits.values()
            if evidence is not None
        ]


def _found(search: Search, report: Report) -> Diagnosis:
    """Search, locate, compare and prove."""
    case, best = search.case, search.run()
    learned, jitter = None, None
    if not is_explained(case, best, search.base):
        report("delays that differ from command to command")
        jitter = differing_delays(case, search.with_effect("delay"))
        if jitter is None:
            report("physics that the catalogue does not have")
            learned = confirmed(search, best)
    if jitter is not None:
        best = jitter.mean
    chosen = case
    if learned is not None:
        chosen, best, _ = learned
    report("how well the marble grips the board")
    possible = grips(chosen, best)
    if possible[0][0] is not chosen:
        search.remember(possible[0][1], hold_out(*possible[0]))
    report("where the mismatch is")
    where: tuple[Finding, ...] = tuple(locate(case, search.base)) if best.effects else ()
    if best.effects or not is_explained(case, best, search.base):
        where += tuple(stages(leftover_sources(case, search.base)))
    report("rivals")
    tied = rivals(search, best) if learned is None and jitter is None else {}
    report("the proof")
    return _Found(search, possible, tied, None if jitter is None else jitter.spread).diagnosis(where)


class _Found:
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
    """

    def __init__(
        self,
        search: Search,
        possible: Sequence[tuple[Case, Fitted]],
        tied: dict[str, list[Fitted]],
        spread: Parameter | None,
    ) -> None:
        self._search, self._possible, self._tied, self._spread = search, possible, tied, spread
        self._case, self._best = possible[0]
        self._parameters = _joined([with_intervals(_information(*one)) for one in possible])
        self._proofs = {
            (): _proof(search, search.case, search.base),
            self._best.effects: _proof(search, self._case, self._best),
        }

    def diagnosis(self, where: Sequence[Finding]) -> Diagnosis:
        """Put everything together."""
        case, base, best = self._case, self._search.base, self._best
        told = _information(case, best)
        before, after = self._proofs[base.effects], self._proofs[best.effects]
        effects = tuple(self._named(name) for name in self._ordered())
        if self._spread is not None:
            effects = (self._jitter(effects[0]),)
        noise = best.noise if is_explained(case, best, base) else case.noise
        verdict = "missing" if effects else "sufficient"
        if UNLISTED in best.effects:
            verdict = "unlisted"
        base_heldout, final_heldout = _mean(before), _mean(after)
        return Diagnosis(
            verdict=verdict,  # type: ignore[arg-type]
            summary=words.summary(effects, noise=noise, before=base_heldout, after=final_heldout),
            where=tuple(where),
            effects=effects,
            noise=noise,
            base_mae=_free_run(self._search.case, base),
            final_mae=_free_run(case, best),
            base_heldout_mae=base_heldout,
            final_heldout_mae=final_heldout,
            base=_model(self._search.case, base, with_intervals(_information(self._search.case, base))),
            model=_model(case, best, self._parameters),
            rivals=tuple(case.model(one) for alike in self._tied.values() for one in alike),
            unidentifiable=unidentifiable(told),
            suggestion=words.suggestion(effects, case.rig.path),
            candidates=self._candidates(),
            runs=tuple(
                _run(case, index, before[index], after[index]) for index in range(len(case.rig.recordings))
            ),
            power=() if effects else tuple(power(case, base, self._search.evidence())),
            notes=tuple(words.notes(case, best, self._spread)),
            settings={"rig": str(case.rig.path), "recordings": len(case.rig.recordings)},
            seed=case.seed,
            seconds=0.0,
        )

    def _ordered(self) -> list[str]:
        """Return the effects, the most important first: without which the rest explains least."""
        fits = self._search.fits
        scale = self._search.evidence().scale

        def loss_without(name: str) -> float:
            rest = fits.get(frozenset(self._best.effects) - {name})
            return -rest.loss(scale) if rest is not None else -np.inf

        return sorted(self._best.effects, key=loss_without)

    def _jitter(self, mean: NamedEffect) -> NamedEffect:
        """Return delays that differ: their spread beside the mean, which alone is in the model."""
        assert self._spread is not None
        return replace(
            mean,
            name="delay_jitter",
            stage=effect("delay_jitter").stage,
            parameters={"sd_s": self._spread, "mean_s": mean.parameters["delay_s"]},
            units={"sd_s": "s", "mean_s": "s"},
        )

    def _named(self, name: str) -> NamedEffect:
        without = self._search.fits.get(frozenset(self._best.effects) - {name})
        errors = {} if without is None else _proof(self._search, self._search.case, without)
        alike = self._tied.get(name, [])
        other_names = [_instead(self._best, one) for one in alike]
        return NamedEffect(
            name=name,
            stage=effect(name).stage,
            parameters={
                key.removeprefix(f"{name}."): one
                for key, one in self._parameters.items()
                if key.startswith(f"{name}.")
            },
            units=units(name),
            heldout_mae_without=_mean(errors) if errors else float("nan"),
            heldout_mae_with=_mean(self._proofs[self._best.effects]),
            confusable_with=tuple(other_names),
            reason=" ".join(
                reason(self._case, self._best, one, name, other)
                for one, other in zip(alike, other_names, strict=True)
            ),
        )

    def _heldout_gain(self, held: HeldOut) -> float:
        evidence = self._search.evidence()
        base = self._search.held_out(self._search.base)
        return float((base.losses(evidence.scale) - held.losses(evidence.scale)).sum()) / evidence.memory

    def _candidates(self) -> tuple[Candidate, ...]:
        search, evidence = self._search, self._search.evidence()
        named = set(self._best.effects)
        alike = {one.effects for tied in self._tied.values() for one in tied}
        told = []
        for one in search.fits.values():
            held = search.known_held_out(one)
            told.append(
                Candidate(
                    effects=one.effects,
                    values=one.of_effects(),
                    gain=evidence.gain(one, search.base),
                    penalty=evidence.penalty(one),
                    noise=one.noise,
                    heldout_gain=None if held is None else self._heldout_gain(held),
                    outcome=_outcome(evidence, one, search.base, named=named, alike=alike),
                )
            )
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
        return "adds nothing that recordings held out confirm"
    return "explains less"


def _instead(best: Fitted, other: Fitted) -> str:
    """Return the effect that another hypothesis has in the place of one of the best."""
    return next(name for name in other.effects if name not in best.effects)


def _information(case: Case, one: Fitted) -> Information:
    problem = case.problem([Effect(name, {}) for name in one.effects])
    return Information.of(problem, one.values, problem.inform(one.values, case.noise))


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
    """Return for each recording what a fit to the others predicts, and its mean absolute error."""
    several = len(np.unique(case.folds)) > 1
    fits = dict(zip(np.unique(case.folds), search.held_out(one).fits, strict=True)) if several else {}
    told = {}
    for index, recording in enumerate(case.rig.recordings):
        evaluation = evaluate(case.model(fits.get(index, one)), [recording]).runs[0]
        if case.rig.start == "moving" and evaluation.windowed is not None:
            told[index] = evaluation.windowed_prediction, evaluation.windowed.mae
        else:
            told[index] = evaluation.free_prediction, evaluation.free_run.mae
    return told


def _free_run(case: Case, one: Fitted) -> float:
    """Return the mean absolute error on the recordings that a hypothesis was fitted to."""
    evaluation = evaluate(case.model(one), case.rig.recordings)
    if case.rig.start == "moving" and evaluation.windowed is not None:
        return evaluation.windowed.mae
    return evaluation.free_run.mae


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
