"""A diagnosis for each verdict, made up, of the sample rig: its paths are simulated, so they look real."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import irt
from irt.catalogue import effect
from irt.diagnosis.result import (
    UNLISTED,
    Candidate,
    Diagnosis,
    Finding,
    NamedEffect,
    NeededPush,
    Plausible,
    Power,
    Remains,
    RunProof,
    Share,
)
from irt.diagnosis.words import LEARNED
from irt.engine import rollouts
from irt.model import Effect, Model, Parameter
from irt.rig import load_rig

NOISE = 0.0012
TRUE = np.array([0.042, 0.058, 4e-4, 20.0, 1.03])
BASE = TRUE * [0.93, 1.04, 1.4, 1.0, 0.99]
FINAL = TRUE * [1.002, 0.999, 1.01, 1.0, 1.0]
LEFT_OUT = {
    "sufficient": (),
    "missing": (Effect("backlash", {"width_x_rad": 0.031, "width_y_rad": 0.024}),),
    "unlisted": (
        Effect("side_force", {name.name: name.high / 2 for name in effect("side_force").parameters}),
    ),
}
SUMMARIES = {
    "sufficient": "Five parameters explain these recordings down to the tracker noise. Nothing is missing "
    "that they could show.",
    "missing": "The knobs turn 0.031 and 0.024 rad before the board follows: backlash. With it the simulated "
    "marble stays within the tracker noise on runs that it never saw.",
    "unlisted": "Something repeatable pushes the marble where it moves fast, and no effect of the catalogue "
    "explains it. A correction learned from the recordings takes most of it away.",
}


def sample_rig():
    return load_rig(Path(irt.__file__).parent / "data" / "labyrinth-heldout")


def make_runs(rig, verdict):
    rng = np.random.default_rng(1)
    left_out = LEFT_OUT[verdict]
    base = FINAL if verdict == "sufficient" else BASE
    added = [{"name": one.name, **{k: 1.01 * v for k, v in one.parameters.items()}} for one in left_out]
    truth = [{"name": one.name, **one.parameters} for one in left_out]
    runs = []
    for recording in rig.recordings:
        given = {"rig": rig, "start": recording.marble[0]}
        (marble,) = rollouts(TRUE[None], recording.knobs, effects=truth, **given)
        observed = marble + rng.normal(0.0, NOISE, marble.shape)
        observed[30:34] = np.nan
        (before,) = rollouts(base[None], recording.knobs, **given)
        (after,) = rollouts(FINAL[None], recording.knobs, effects=added, **given)
        times = np.arange(len(marble)) * TRUE[3] / 240
        errors = [float(np.nanmean(np.abs(path - observed))) for path in (before, after)]
        models = Model.from_rig(rig, base), Model.from_rig(rig, FINAL)
        runs.append(RunProof(recording.name, times, observed, before, after, *errors, *models))
    return tuple(runs)


def make_candidates(verdict):
    """Return the base model, hypotheses of one effect and of two, in the order of their evidence."""
    rng = np.random.default_rng(2)
    scale = {"sufficient": 4.0, "missing": 900.0, "unlisted": 300.0}[verdict]
    names = [one.name for one in irt.effects()]
    hypotheses = [(), *((name,) for name in names), *(("backlash", name) for name in names[:5])]
    candidates = []
    for effects in hypotheses:
        gain = scale * rng.uniform(0.0, 0.3) if effects else 0.0
        outcome = "explains less" if verdict == "missing" else "no better than the base model"
        outcome, probability = outcome if effects else "the base model", 0.0
        if verdict == "missing" and effects in (("backlash",), ("delay",)):
            gain, outcome = scale, "named" if effects == ("backlash",) else "equally good"
            probability = 0.62 if effects == ("backlash",) else 0.38
        penalty = 6.2 * len(effects)
        candidates.append(Candidate(effects, {}, gain, penalty, probability, outcome))
    return tuple(sorted(candidates, key=lambda one: one.penalty - one.gain))


def make_effects(verdict, before, after):
    if verdict == "missing":
        (one,) = LEFT_OUT[verdict]
        fitted = {
            name: Parameter(value, 0.97 * value, 1.04 * value) for name, value in one.parameters.items()
        }
        reason = "The recordings turn the knobs at one speed only, where a gap and a lost time look alike."
        tie, chance, again = ("delay",), 0.973, 1.0
        return (
            NamedEffect(
                one.name,
                "actuation",
                fitted,
                effect(one.name).units,
                before,
                after,
                tie,
                reason,
                chance,
                again,
            ),
        )
    if verdict == "unlisted":
        fitted = {one.name: Parameter(one.neutral) for one in effect(UNLISTED).parameters}
        fitted |= {
            "drag_strength": Parameter(0.021, 0.018, 0.024),
            "drag_power": Parameter(1.5, 1.3, 1.7),
        }
        learned = NamedEffect(
            UNLISTED, "field", fitted, effect(UNLISTED).units, before, after, chosen_again=1.0
        )
        return (learned,)
    return ()


#: The effects, the tracker, and the rest; a second ahead and over whole runs.
BUDGETS = {
    "sufficient": {"tracker": (0.9, 0.8), "not repeatable": (0.1, 0.2)},
    "missing": {"backlash": (0.55, 0.9965), "tracker": (0.35, 0.001), "not repeatable": (0.1, 0.0025)},
    "unlisted": {UNLISTED: (0.3, 0.5), "tracker": (0.4, 0.1), "not repeatable": (0.3, 0.4)},
}


def make_budget(verdict):
    parts = BUDGETS[verdict].items()
    return tuple(
        Share(what, shares[index], horizon)
        for index, horizon in enumerate((1.0, None))
        for what, shares in parts
    )


def make_pushes(runs):
    found = []
    for run in runs:
        push = np.stack([0.05 * np.sin(run.times), 0.02 * np.cos(run.times)], axis=1)
        push[0] = np.nan
        spread = np.full_like(push, 0.01)
        found.append(NeededPush(run.recording, run.times, push, spread, 0.02 * push, spread))
    return tuple(found)


def make_remains(verdict, floor):
    stage = "board" if verdict == "unlisted" else None
    return Remains(BUDGETS[verdict]["not repeatable"][1], stage, repeats=False, floor_of_the_log=floor)


def make_diagnosis(rig, verdict):
    runs = make_runs(rig, verdict)
    before, after = (
        float(np.mean([getattr(run, which) for run in runs])) for which in ("base_mae", "final_mae")
    )
    models = [
        Model.from_rig(
            rig, values, intervals=np.stack([0.98 * values, 1.02 * values], axis=1), effects=effects
        )
        for values, effects in ((BASE, ()), (FINAL, LEFT_OUT["missing"] if verdict == "missing" else ()))
    ]
    learned = (f"{LEARNED}a = -(0.021) (v / 0.1 m/s)^1.5 along v.",) if verdict == "unlisted" else ()
    parameters = {**models[1].parameters, "time_scale": Parameter(20.0, 3.0, np.inf)}
    return Diagnosis(
        verdict=verdict,
        summary=SUMMARIES[verdict],
        where=()
        if verdict == "sufficient"
        else (
            Finding("stage", "between the command and the board's tilt", 0.81, 1e-9),
            Finding("time", "after each turn of a knob, for 0.3 s", 0.74, 3e-5),
            Finding("region", "nowhere in particular", 0.08, 0.31),
            Finding("regime", "where the knobs change direction", 0.77, 2e-4),
        ),
        effects=make_effects(verdict, before, after),
        noise=NOISE,
        base_mae=0.95 * before,
        final_mae=0.95 * after,
        base_heldout_mae=before,
        final_heldout_mae=after,
        nested_heldout_mae=1.1 * after,
        base=models[1] if verdict == "sufficient" else models[0],
        model=replace(models[1], parameters=parameters),
        indistinguishable=(replace(models[1], effects=(Effect("delay", {"delay_s": 0.113}),)),)
        if verdict == "missing"
        else (),
        plausible=(Plausible(models[1], 0.7), Plausible(models[0], 0.3)),
        unidentifiable=("gear_x, gear_y and rolling_friction times L with time_scale times the root of L.",),
        suggestion="Record steps of two sizes: backlash costs the same angle at both, a delay the same time.",
        candidates=make_candidates(verdict),
        runs=runs,
        power=()
        if verdict == "missing"
        else (
            Power("backlash", "width_x_rad", "rad", 0.004, 0.1),
            Power("delay", "delay_s", "s", 0.021, 0.6),
            Power("board_warp", "height_m", "m", None, 0.002),
        ),
        notes=("gear_x lies a little outside of the range that was searched.", *learned),
        settings={"command": "irt diagnose rig --out out", "threads": None},
        seed=7,
        seconds=83.2,
        inclusion={"lag": 0.034, "backlash": 0.62, "delay": 0.38, "bump": 0.004}
        if verdict == "missing"
        else {},
        budget=make_budget(verdict),
        remains=make_remains(verdict, NOISE),
        pushes=() if verdict == "sufficient" else make_pushes(runs),
    )
