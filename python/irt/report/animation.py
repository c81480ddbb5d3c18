"""Data of the report's animation of recorded and simulated marbles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.result import RunProof
from irt.maze import Maze
from irt.model import Model
from irt.report.diagnosis_plots import Side, thinned
from irt.report.plots import rim_of

Array = NDArray[np.float64]

#: Script that plays an animation, in ``templates``.
PLAYER = "player.js"
#: Most rows of all runs together, and least rows of a run: smooth motion in a file small enough to send.
_MOST_ROWS = 9000
_LEAST_ROWS = 150
#: Decimals of positions: 0.01 % of the board's edge.
_DIGITS = 4
#: CSS classes of the predictions.
_CLASS = {"base": "before", "final": "after"}
#: Units of the SVG in one board edge.
_SCALE = 1000


@dataclass(frozen=True, eq=False)
class Animation:
    """Content of ``player.html``.

    Attributes
    ----------
    runs : sequence of str
        Names of the recordings to choose from.
    shown : sequence of (str, str)
        Class in the style sheet and label of each prediction.
    rim, reach : (2,) arrays
        Half-widths along x and y of the rim's inside, and of the reach of the marble's centre [1/1000 edge].
    radius : float
        Of the marble [1/1000 edge].
    walls : (n, 4) array
        Inner walls from end to end, x0, y0, x1, y1, with y downwards as in an SVG [1/1000 edge].
    holes : (m, 2) array
        Centres of holes, with y downwards [1/1000 edge].
    wall_thickness, hole_radius : float
        Of each [1/1000 edge].
    data : dict
        For the script: rows, times and positions of each run, null where the marble was not seen.
    """

    runs: Sequence[str]
    shown: Sequence[tuple[str, str]]
    rim: Array
    reach: Array
    radius: float
    walls: Array
    holes: Array
    wall_thickness: float
    hole_radius: float
    data: dict[str, Any]

    @classmethod
    def of(cls, runs: Sequence[RunProof], model: Model, shown: Sequence[Side], *, stamped: bool) -> Animation:
        """Return the animation of these runs.

        Parameters
        ----------
        runs : sequence of RunProof
            Recorded and predicted positions; the first run is shown first.
        model : Model
            Dimensions of board and marble, and the observation scale.
        shown : sequence of Side
            The predictions to show.
        stamped : bool
            Whether the clock shows seconds; otherwise it shows rows.
        """
        rim = _SCALE * rim_of(model)
        per_m = float(2 * rim[0] / model.board.edge_x_m)
        radius = per_m * model.marble.radius_m
        walls, thickness, holes, hole_radius = (model.maze or Maze()).arrays()
        names = [_CLASS[side.which] if len(shown) > 1 else "after" for side in shown]
        most = max(_LEAST_ROWS, _MOST_ROWS // max(1, len(runs)))
        return cls(
            [run.recording for run in runs],
            list(zip(names, (side.label for side in shown), strict=True)),
            rim,
            rim - radius,
            radius,
            per_m * walls * [1.0, -1.0, 1.0, -1.0],
            per_m * holes * [1.0, -1.0],
            per_m * thickness,
            per_m * hole_radius,
            {
                "series": ["recorded", *names],
                "stamped": stamped,
                "runs": [_run(run, dict(zip(names, shown, strict=True)), most) for run in runs],
            },
        )


def _run(run: RunProof, sides: dict[str, Side], most: int) -> dict[str, Any]:
    """Return the data of a run for the script, thinned to `most` rows."""
    rows = thinned(len(run.times), most)
    first = next(iter(sides.values()))
    error = np.abs(first.residual(run)[rows]).mean(axis=1)
    return {
        "t": [round(float(time), 3) for time in run.times[rows]],
        "rows": rows.tolist(),
        "worst": int(np.argmax(np.nan_to_num(error))),
        "recorded": _places(run.observed[rows]),
        **{name: _places(side.marble(run)[rows]) for name, side in sides.items()},
    }


def _places(marble: Array) -> list[list[float] | None]:
    return [
        [round(x, _DIGITS), round(y, _DIGITS)] if np.isfinite(x) and np.isfinite(y) else None
        for x, y in marble.tolist()
    ]
