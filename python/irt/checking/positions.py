"""Detection of positions with a wrong unit or origin: metres, pixels, a corner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.checking.metres import nats_for_metres
from irt.checking.result import Finding
from irt.recording import MARBLE
from irt.rig import Rig

Array = NDArray[np.float64]

#: Distance beyond the rim, in addition to noise, that errors of the tracker do not explain [board edges].
_BEYOND = 0.02
#: Largest outward shift of the rim by a lens [board edges], as observed on a practice rig.
_LENS = 0.12
#: Share of the board that runs should cross. A marble that crosses less even in metres does not show the
#: unit.
_MUCH = 0.5
#: Log likelihood ratio [nats] for a decision: positions are in metres if that is a thousand times likelier
#: than board edges, and in board edges if it is a thousand times less likely. Of 269 simulated rigs in board
#: edges whose marble stays as close to the centre as a rim in metres, with one effect of the catalogue each,
#: none has 0.4 nats for metres.
_CERTAIN = float(np.log(1000.0))


def position_findings(
    rig: Rig, marbles: Sequence[Array], noise: float, threads: int | None = None
) -> list[Finding]:
    """Return a finding if the unit or the origin of the positions looks wrong.

    Parameters
    ----------
    rig : Rig
        The recordings.
    marbles : sequence of (n, 2) arrays
        Positions of each, NaN in invalid rows.
    noise : float
        Noise of a position [board edges].
    threads : int, optional
        Threads of the engine; by default one for each core.
    """
    together = np.concatenate([one[np.isfinite(one).all(axis=1)] for one in marbles])
    if len(together) == 0:
        return []
    extent = _Extent.of(rig, together, noise)
    found = extent.beyond() or _metres(rig, extent, noise, threads)
    return [] if found is None else [found]


@dataclass(frozen=True, eq=False)
class _Extent:
    """Extent of the positions, and of the board.

    Attributes
    ----------
    together : (n, 2) array
        All positions.
    low, high : (2,) arrays
        Their ends, without a few outliers.
    edges, reach : (2,) arrays
        The board, and the distance of the rim from its centre [board edges].
    noise : float
        Noise of a position, in its unit.
    narrowest, widest : float
        Smallest and largest observation scale.
    """

    together: Array
    low: Array
    high: Array
    edges: Array
    reach: Array
    noise: float
    narrowest: float
    widest: float

    @classmethod
    def of(cls, rig: Rig, together: Array, noise: float) -> _Extent:
        """Return the extent of (n, 2) positions of a rig."""
        edges = np.array([1.0, rig.board.edge_y_m / rig.board.edge_x_m])
        low, high = np.quantile(together, [0.002, 0.998], axis=0)
        return cls(
            together=together,
            low=low,
            high=high,
            edges=edges,
            reach=edges / 2.0 - rig.marble.radius_m / rig.board.edge_x_m,
            noise=noise,
            narrowest=rig.ranges["observation_scale"][0],
            widest=rig.ranges["observation_scale"][1],
        )

    def beyond(self) -> Finding | None:
        """Return the finding on positions beyond the rim."""
        slack = _BEYOND + 3.0 * self.noise
        furthest = self.reach * self.widest + slack
        in_corner = bool((self.low > -slack).all())
        # A lens may shift the rim outwards; a corner as origin also shows in the signs.
        limit = furthest if in_corner else furthest + _LENS
        wrong = (self.high > limit) | (self.low < -limit)
        if not wrong.any():
            return None
        place = float(np.where(self.high > -self.low, self.high, self.low)[wrong][0])
        # If half of all positions are off the board, or all lie on one side of its centre and some beyond the
        # rim, neither errors of a tracker nor a lens explain it.
        outside = (np.abs(self.together) > limit).any(axis=1)
        certain = in_corner or bool(np.mean(outside) > 0.5)
        if in_corner:
            advice = (
                f"the origin looks like a corner: subtract 0.5 from marble_x, {self.edges[1] / 2.0:.3g} "
                "from marble_y"
            )
        elif wrong[1] and not wrong[0] and (self.high[1] - self.low[1]) < 2.0 * furthest[0]:
            advice = "are marble_x and marble_y swapped, or edge_x_m and edge_y_m?"
        else:
            advice = "check the unit of the positions, edge_x_m and edge_y_m"
        return Finding(
            "error" if certain else "warning",
            f"the marble is seen at {place:.3g} edges, beyond the rim at {self.reach[wrong][0]:.3g}",
            ", ".join(name for name, is_wrong in zip(MARBLE, wrong, strict=True) if is_wrong),
            advice,
        )

    def within_metres(self, edge_m: float, centre: Array, lens: float = 0.0) -> bool:
        """Return whether all positions are on the board if they are in metres, its centre at `centre` [m].

        `lens` is the outward shift of the rim by a lens [board edges].
        """
        limit = (self.reach * self.widest + _BEYOND + lens) * edge_m + 3.0 * self.noise
        return bool((self.high - centre <= limit).all() and (centre - self.low <= limit).all())

    def reaches_rim(self, edge_m: float, centre: Array) -> bool:
        """Return whether positions reach the rim on any side, if they are in metres; `centre` as above."""
        rim = self.reach * self.narrowest * edge_m - 3.0 * self.noise
        return bool((np.maximum(self.high - centre, centre - self.low) >= rim).any())

    def crosses(self, edge_m: float) -> bool:
        """Return whether the marble crosses much of the board along x or y, if positions are in metres."""
        return bool(((self.high - self.low) >= 2.0 * _MUCH * self.reach * edge_m).any())


def _metres(rig: Rig, extent: _Extent, noise: float, threads: int | None) -> Finding | None:
    """Return the finding on positions in metres, from the board's centre or from a corner."""
    edge_m = rig.board.edge_x_m
    half = extent.edges * edge_m / 2.0
    # If the marble is always farther than its radius from the origin, the origin may be a corner.
    in_corner = bool((extent.low >= rig.marble.radius_m - 3.0 * noise).all())
    likely = None
    for centre, usual in ((np.zeros(2), not in_corner), (half, in_corner)):
        meets_walls = extent.within_metres(edge_m, centre, _LENS) and extent.reaches_rim(edge_m, centre)
        may_be = usual and extent.within_metres(edge_m, centre) and extent.crosses(edge_m)
        nats = nats_for_metres(rig, centre, noise, threads) if meets_walls or may_be else 0.0
        if meets_walls and nats >= _CERTAIN:
            return _in_metres(extent, centre, edge_m, certain=True)
        if may_be and nats > -_CERTAIN:
            likely = _in_metres(extent, centre, edge_m, certain=False)
    return likely


def _in_metres(extent: _Extent, centre: Array, edge_m: float, *, certain: bool) -> Finding:
    """Return the finding on positions in metres with the board's centre at `centre` [m]."""
    low, high = extent.low, extent.high
    why = "meets walls that stand there in metres" if certain else "would do so in metres on this board"
    subtract = f"subtract {centre[0]:.4g} from marble_x and {centre[1]:.4g} from marble_y, then "
    return Finding(
        "error" if certain else "warning",
        f"the marble stays between {low[0]:.3g} and {high[0]:.3g} along x, {low[1]:.3g} and {high[1]:.3g} "
        f"along y, and {why}",
        ", ".join(MARBLE),
        f"{subtract if centre.any() else ''}divide the positions by the long edge, {edge_m:g} m"
        f"{'' if certain else ', if they are metres'}",
    )
