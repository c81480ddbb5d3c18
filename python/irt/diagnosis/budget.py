"""Where the error of the five parameters goes: to each effect, to the tracker, to what does not repeat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.result import Share
from irt.diagnosis.validation import Held, HeldOut
from irt.model import Model
from irt.recording import Recording
from irt.residual import evaluate
from irt.rig import Rig

Array = NDArray[np.float64]

#: Lengths of the windows in which errors are counted [s]; a free run has none.
HORIZONS: tuple[float | None, ...] = (0.5, 1.0, None)
#: A length where none matters [s].
_ANY_S = 1.0
#: What is not of an effect.
TRACKER, REST = "tracker", "not repeatable"


def budget(
    rig: Rig, base: HeldOut, answer: HeldOut, without: Mapping[str, HeldOut], twins: Sequence[Recording]
) -> tuple[Share, ...]:
    """Return the shares of the base model's squared error on recordings held out, at each horizon.

    What the effects take away together is divided in proportion to what is lost without each; the tracker's
    share is what the answer misses on its own twins, and the remainder does not repeat, or was not found.

    Parameters
    ----------
    rig : Rig
        The recordings.
    base, answer : HeldOut
        The five parameters alone, and with all effects.
    without : mapping
        For each effect the answer without it, the largest first.
    twins : sequence of Recording
        What the answer itself would have been seen to do (`twins_of`).
    """
    seen = tuple(replace(one, model=answer.runs[0].model) for one in answer.runs)
    shares: list[Share] = []
    for horizon in HORIZONS:
        before, after = (_squared(rig.recordings, one.runs, horizon) for one in (base, answer))
        if before is None or after is None or before <= 0.0:
            continue
        losses = {
            name: max(0.0, (_squared(rig.recordings, one.runs, horizon) or after) - after)
            for name, one in without.items()
        }
        tracker = min(_squared(twins, seen, horizon) or 0.0, before)
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

    What a perfect simulator is off by there is the floor of the log: the tracker's noise, and start states that
    nobody knows better.
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


def _squared(recordings: Sequence[Recording], held: Sequence[Held], horizon: float | None) -> float | None:
    """Return the mean squared error of recordings, each predicted by the fit to the others."""
    squares, rows = 0.0, 0
    for recording, one in zip(recordings, held, strict=True):
        found = evaluate(one.model, [recording], horizon or _ANY_S).runs[0]
        errors = found.free_run if horizon is None else found.windowed
        if errors is not None:
            squares, rows = squares + errors.rmse**2 * errors.rows, rows + errors.rows
    return squares / rows if rows else None
