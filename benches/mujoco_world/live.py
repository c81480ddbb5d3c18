"""Marbles of MuJoCo whose commands come one by one, for controllers that are tried on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.maze import Maze
from irt.rig import Board

from .commands import STEP_S, STEPS_PER_UPDATE, Linkage, arrived
from .pictures import see
from .plate import HALF_TURN, Plates, rotations_of, smooth

Array = NDArray[np.float64]


class Live:
    """Runs of one rig side by side, each under the commands of its own controller.

    The plate begins to turn half of `plate.TURN_S` before its set point changes. A controller therefore has a
    row to think: what it answers to the picture of row i is issued in row i + 1. Under the same commands the
    pictures are those of `simulate`.

    Parameters
    ----------
    values : (5,)
        Parameters, as of `simulate`.
    effects : sequence of dict
        As of `simulate`, without ``clock_drift``.
    start : (n, 2)
        Where the marbles rest in row 0 [m].
    seeds : (n,)
        Of the runs.
    maze : Maze, optional
        Inner walls, which are geometries, and holes: a marble whose centre is over one has fallen.
    """

    def __init__(
        self,
        values: Array,
        effects: Sequence[dict[str, Any]],
        start: Array,
        seeds: NDArray[np.int64],
        maze: Maze | None = None,
    ) -> None:
        self._hidden = {
            str(one["name"]): {key: float(one[key]) for key in one if key != "name"} for one in effects
        }
        self._seeds, self._edges_per_m = seeds, values[4] / Board().edge_x_m
        self._steps = round(values[3]) * STEPS_PER_UPDATE
        if self._steps < HALF_TURN + 2:
            raise ValueError(
                f"a row of {self.row_s:g} s is shorter than what a plate turns ahead of commands"
            )
        self._late = self._hidden.get("latency", {}).get("latency_s", 0.0) / STEP_S
        self._holes = np.array(maze.holes if maze else ()).reshape(-1, 2)
        self._hole_radius_m = maze.hole_radius_m if maze else 0.0
        self._plates = Plates(len(seeds), values[2], self._hidden, maze)
        self._linkage = Linkage(values, self._hidden)
        self._knobs = np.zeros((len(seeds), 1, 2))
        #: The present step, and how many before it pictures and plates still depend on.
        self._now, self._past = 0, max(int(np.ceil(self._late)) + 1, HALF_TURN)
        tilts = self._tilted(0, HALF_TURN + 1)
        self._tilts = np.concatenate([tilts[:, :1].repeat(self._past, axis=1), tilts], axis=1)
        self._plates.place(start)
        self._places = start[:, None].repeat(self._past + 1, axis=1)
        self._fallen = np.zeros(len(seeds), dtype=bool)

    @property
    def row_s(self) -> float:
        """Length of a row [s]."""
        return float(self._steps * STEP_S)

    @property
    def places(self) -> Array:
        """Where the marbles are (n, 2) [m], however they are seen."""
        return np.asarray(self._places[:, -1])

    @property
    def fallen(self) -> NDArray[np.bool_]:
        """Which marbles have fallen through a hole (n,)."""
        return self._fallen

    def see(self) -> Array:
        """Return what the camera sees of each marble (n, 2) [board edges]; NaN of those that have fallen."""
        moment = self._past - min(self._late, float(self._now))
        before = int(moment)
        part = moment - before
        shown = self._places[:, before]
        if part > 0.0:
            shown = (1.0 - part) * shown + part * self._places[:, before + 1]
        # As in `simulate`, the plate as it was just before the picture.
        tilt = self._tilts[:, int(np.ceil(moment)) - 1]
        return np.where(self._fallen[:, None], np.nan, see(shown, tilt, self._edges_per_m, self._hidden))

    def play(self, commands: Array) -> None:
        """Go on by a row; the commands (n, 2) [rad] are issued as it ends."""
        end = self._now + self._steps
        self._knobs = np.concatenate([self._knobs, commands[:, None]], axis=1)
        self._tilts = np.concatenate(
            [self._tilts, self._tilted(self._now + HALF_TURN + 1, end + HALF_TURN + 1)], axis=1
        )
        turned = smooth(self._tilts[:, self._past - HALF_TURN :])
        rates = np.diff(turned, axis=1) / STEP_S
        rotations = rotations_of(turned)
        places = np.empty((len(commands), self._steps + 1, 2))
        for step in range(self._steps):
            places[:, step] = self._plates.step(turned[:, step], rates[:, step], rotations[:, step])
        places[:, -1] = self._plates.where(rotations[:, -1])
        if len(self._holes):
            away = np.linalg.norm(places[:, :, None] - self._holes, axis=-1)
            self._fallen |= (away < self._hole_radius_m).any(axis=(1, 2))
        self._places = np.concatenate([self._places, places[:, 1:]], axis=1)[:, -self._past - 1 :]
        self._tilts = self._tilts[:, self._steps :]
        self._now = end

    def _tilted(self, first: int, end: int) -> Array:
        """Return where the hinges should be in steps [first, end) (n, steps, 2) [rad]."""
        issued = self.row_s * np.arange(float(self._knobs.shape[1]))
        moments = STEP_S * (np.arange(float(first), float(end)) - 0.5)
        return self._linkage.turn(arrived(self._knobs, issued, moments, self._hidden, self._seeds))
