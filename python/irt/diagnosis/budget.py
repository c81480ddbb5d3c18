"""The error budget of the five-parameter model: shares of the effects, of the tracker, and unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis import config
from irt.diagnosis.result import Share
from irt.diagnosis.validation import HeldOut
from irt.engine import SUBSTEP_S
from irt.model import Model
from irt.recording import Recording
from irt.residual import RunEvaluation, evaluate
from irt.rig import Rig

Array = NDArray[np.float64]

#: Prediction horizons of the budget [s]; None for a free run.
HORIZONS: tuple[float | None, ...] = (config.HORIZON_S, None)
#: Names of the shares that belong to no effect.
TRACKER, REST = "tracker", "not repeatable"


def budget(
    base: HeldOut, answer: HeldOut, without: Mapping[str, HeldOut], twins: Sequence[RunEvaluation]
) -> tuple[Share, ...]:
    """Return the shares of the base model's squared error on held-out recordings, at each horizon.

    The joint reduction by all effects is divided in proportion to the increase without each effect. The
    tracker's share is the error of the answer on its own simulated recordings (`twins_of`). The rest does not
    repeat, or was not found.

    Parameters
    ----------
    base, answer : HeldOut
        The five parameters alone, and with all effects.
    without : mapping
        The answer without each effect, the most important effect first.
    twins : sequence of RunEvaluation
        Errors of the answer on its own simulated recordings (`twins_of`).
    """
    of_runs = [[each.evaluation for each in one.runs] for one in (base, answer)]
    shares: list[Share] = []
    for horizon in HORIZONS:
        before, after = (_squared(one, horizon) for one in of_runs)
        if before is None or after is None or before <= 0.0:
            continue
        losses = {
            name: max(0.0, (_squared([each.evaluation for each in one.runs], horizon) or after) - after)
            for name, one in without.items()
        }
        tracker = min(_squared(twins, horizon) or 0.0, before)
        rest = min(max(after - tracker, 0.0), before - tracker)
        taken, total = before - tracker - rest, sum(losses.values())
        for name, loss in losses.items():
            part = loss / total if total > 0.0 else 1.0 / len(losses)
            shares.append(Share(name, taken * part / before, horizon))
        if not losses:
            rest += taken
        shares += [Share(TRACKER, tracker / before, horizon), Share(REST, rest / before, horizon)]
    return tuple(shares)


def twins_of(rig: Rig, model: Model, noise: tuple[float, float, float], seed: int) -> list[Recording]:
    """Return recordings simulated by a model, with the rig's commands, gaps and tracker noise.

    The model's own error on them is the error floor: that of a perfect simulator, from tracker noise and
    uncertain start states.

    Parameters
    ----------
    rig : Rig
        The rig.
    model : Model
        The model.
    noise : (float, float, float)
        Standard deviations of the tracker's white and correlated noise [board edges], and the correlation
        time of the latter [s]. An error that lasts hardly changes the velocity with which a window starts.
    seed : int
        Random seed.
    """
    random = np.random.default_rng(seed)
    found = evaluate(model, rig.recordings).runs
    return [
        replace(recording, marble=np.where(recording.seen[:, None], one.free_prediction + errors, np.nan))
        for recording, one in zip(rig.recordings, found, strict=True)
        for errors in [_tracked(recording, model, noise, random)]
    ]


def _tracked(
    recording: Recording, model: Model, noise: tuple[float, float, float], random: np.random.Generator
) -> Array:
    """Return simulated errors of the tracker in each row of a recording, (n, 2) [board edges]."""
    white, lasting, lasting_s = noise
    errors = white * random.standard_normal(recording.marble.shape)
    if lasting <= 0.0:
        return errors
    seconds = recording.durations
    if seconds is None:
        seconds = np.full(len(errors), model.parameters["time_scale"].value * SUBSTEP_S)
    kept = np.exp(-seconds / lasting_s)
    steps = lasting * random.standard_normal(errors.shape)
    steps[1:] *= np.sqrt(1.0 - kept[:-1, None] ** 2)
    for row in range(1, len(steps)):
        steps[row] += kept[row - 1] * steps[row - 1]
    return errors + steps


def _squared(runs: Sequence[RunEvaluation], horizon: float | None) -> float | None:
    """Return the mean squared error of recordings at a horizon, None if no window fits."""
    errors = [one.free_run if horizon is None else one.windowed for one in runs]
    seen = [one for one in errors if one is not None]
    rows = sum(one.rows for one in seen)
    return sum(one.rmse**2 * one.rows for one in seen) / rows if rows else None
