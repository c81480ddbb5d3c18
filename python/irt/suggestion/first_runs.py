"""First runs for a rig without recordings: every kind of motion, up to a given amplitude."""

from __future__ import annotations

import math

import numpy as np

from irt.errors import IrtError
from irt.suggestion.excitations import GENES, Excitation, Limits, draw

#: Family of each run, and its two genes of shape; further runs repeat the list with other phases and levels.
#: Sines excite gears and friction, steps delays and lags, holds with reversals backlash, chirps effects that
#: depend on frequency, coasting the board and the air, and creep dead bands and static friction. The genes
#: give periods and holds of 1/12 to 1/2 of the run: slow enough for the marble to cross the board, fast
#: enough to bring it back.
RUNS = (
    ("multisine", 0.25, 0.5),
    ("steps", 0.6, 0.75),
    ("holds", 0.6, 0.4),
    ("chirp", 0.15, 0.6),
    ("coasting", 0.55, 0.3),
    ("creep", 0.3, 1.0),
)
#: Genes for both knobs (0), full amplitude (1) and the only start.
_BOTH, _FULL, _CENTRE = 0.0, 1.0, 0.0


def first_runs(
    rows: int, step_s: float, *, runs: int = 6, amplitude: float = 0.1, unit: str = "rad", seed: int = 0
) -> list[Excitation]:
    """Return runs for a rig without recordings.

    Parameters
    ----------
    rows : int
        Length of a run, at least 24: shorter runs have no room for a slow and a fast part.
    step_s : float
        Duration of a row [s].
    runs : int
        Number of runs.
    amplitude : float
        Largest command of each axis.
    unit : str
        Unit of the commands in descriptions: "rad" for knob angles, or the rig's own.
    seed : int
        Random seed; the same seed gives the same runs.

    Returns
    -------
    list of Excitation
        Each run starts at rest in the centre with level knobs.

    Raises
    ------
    IrtError
        If a number is out of its range.
    """
    if rows < 24:
        raise IrtError(f"a run needs at least 24 rows, found {rows}: record longer, or at a higher rate")
    if runs < 1:
        raise IrtError(f"runs: expected at least 1, found {runs}")
    for name, value in (("step_s", step_s), ("amplitude", amplitude)):
        if not 0.0 < value < math.inf:
            raise IrtError(f"{name}: expected a number above 0, found {value}")
    limits = Limits(
        amplitude=np.full(2, amplitude),
        # Steps are allowed: they are best for delays, and the rig's own controller limits its rate.
        rate=np.full(2, 2.0 * amplitude),
        rows=rows,
        step_s=step_s,
        starts=np.zeros((1, 2)),
        unit=unit,
    )
    found = []
    for number in range(runs):
        family, first, second = RUNS[number % len(RUNS)]
        genes = np.random.default_rng([seed, number]).random(GENES)
        genes[:5] = _BOTH, _FULL, _CENTRE, first, second
        found.append(draw(family, genes, limits))
    return found
