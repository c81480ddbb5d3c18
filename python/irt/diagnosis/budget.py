"""Where the error of the five parameters goes: to each effect, to the tracker, to what does not repeat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis import config
from irt.diagnosis.result import Share
from irt.diagnosis.validation import HeldOut
from irt.model import Model
from irt.recording import Recording
from irt.residual import RunEvaluation, evaluate
from irt.rig import Rig

Array = NDArray[np.float64]

#: Lengths of the windows in which errors are counted [s]; a free run has none.
HORIZONS: tuple[float | None, ...] = (config.HORIZON_S, None)
#: What is not of an effect.
TRACKER, REST = "tracker", "not repeatable"


def budget(
    base: HeldOut, answer: HeldOut, without: Mapping[str, HeldOut], twins: Sequence[RunEvaluation]
) -> tuple[Share, ...]:
    """Return the shares of the base model's squared error on recordings held out, at each horizon.

    What the effects take away together is divided in proportion to what is lost without each; the tracker's
    share is what the answer misses on its own twins, and the remainder does not repeat, or was not found.

    Parameters
    ----------
    base, answer : HeldOut
        The five parameters alone, and with all effects.
    without : mapping
        For each effect the answer without it, the largest first.
    twins : sequence of RunEvaluation
        What the answer misses on its own twins (`twins_of`).
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


def twins_of(rig: Rig, model: Model, noise: float, seed: int) -> list[Recording]:
    """Return what a model itself would have been seen to do: the rig's commands, tracked as its marble was.

    What a perfect simulator is off by there is the floor of the log: the tracker's noise, and start states
    that nobody knows better.
    """
    random = np.random.default_rng(seed)
    found = evaluate(model, rig.recordings).runs
    return [
        replace(
            recording,
            marble=np.where(
                np.isfinite(recording.marble),
                one.free_prediction + noise * random.standard_normal(recording.marble.shape),
                np.nan,
            ),
        )
        for recording, one in zip(rig.recordings, found, strict=True)
    ]


def _squared(runs: Sequence[RunEvaluation], horizon: float | None) -> float | None:
    """Return the mean squared error of recordings at a horizon, None where no window fits."""
    errors = [one.free_run if horizon is None else one.windowed for one in runs]
    seen = [one for one in errors if one is not None]
    rows = sum(one.rows for one in seen)
    return sum(one.rmse**2 * one.rows for one in seen) / rows if rows else None
