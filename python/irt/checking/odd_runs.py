"""Check of the axes of each run: one run may have been recorded with other plugs or another camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.checking.responses import (
    SHARE,
    Z,
    correction,
    delays_to_try,
    has_free_signs,
    likelier_by,
    marble_signals,
)
from irt.checking.result import Finding
from irt.checking.runs import row_step
from irt.conventions import CONVENTIONS, Convention, Signals, fit_acceleration
from irt.recording import MARBLE
from irt.rig import Rig

Array = NDArray[np.float64]

#: Minimum number of runs: of two runs that differ neither is the odd one.
_LEAST_RUNS = 3
#: Log likelihood ratio [nats] for a warning: odds of 1,000, corrected for the seven alternatives. Of the
#: right runs of 39 practice rigs and 2 real ones none reaches half of it; of 159 runs turned in one of seven
#: ways 57 % exceed it. Where an axis hardly moves, the correction can be another: one in eight is wrong.
_LIKELIER = float(np.log(1e3) + np.log(len(CONVENTIONS) - 1))


def odd_runs(
    rig: Rig, cleaned: Sequence[tuple[Array, Array | None]], rim: Sequence[NDArray[np.bool_]]
) -> list[Finding]:
    """Return a warning for each run whose axes differ from those of the others.

    A run is suspected if another convention explains it significantly better. It is named if all runs
    together are much likelier with this run turned to that convention, everything else fitted anew.

    Parameters
    ----------
    rig : Rig
        Recordings whose axes are right on the whole.
    cleaned, rim : sequences
        As for `irt.checking.responses.responses`.
    """
    if has_free_signs(rig):
        return []
    delays = delays_to_try(row_step(rig))
    signals = marble_signals(rig, cleaned, rim)
    seen = [number for number, run in enumerate(rig.recordings) if run.has_marble]
    together = fit_acceleration([signals[one] for one in seen], delays) if len(seen) >= _LEAST_RUNS else None
    if together is None:
        return []
    found = []
    for number in seen:
        run = rig.recordings[number]
        alone = fit_acceleration([signals[number]], delays)
        if alone is None or not alone.contradicts(z=Z, share=SHARE):
            continue
        turned = [_turned(signals[one], alone.best) if one == number else signals[one] for one in seen]
        other = fit_acceleration(turned, delays)
        if other is None:
            continue
        declared, turned_share = float(together.shares[0]), float(other.shares[0])
        if likelier_by(turned_share, declared, min(together.blocks, other.blocks)) >= _LIKELIER:
            found.append(
                Finding(
                    "warning",
                    "its axes differ from those of the other runs: the declared axes explain "
                    f"{100 * max(declared, 0.0):.0f} % of all motion with this run as it is, and "
                    f"{100 * turned_share:.0f} % with it corrected",
                    run.name,
                    f"to make it agree, {correction(alone.best, rig.recordings[0].columns, MARBLE)}",
                )
            )
    return found


def _turned(run: Signals, convention: Convention) -> Signals:
    """Return a run with the columns swapped and the signs changed that a convention names."""
    inputs = run.inputs[:, ::-1] if convention.swapped else run.inputs
    return replace(run, inputs=inputs, outputs=run.outputs * np.array(convention.signs))
