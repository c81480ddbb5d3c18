"""Many marbles that a controller moves: commands come one by one, each marble on a simulator of its own."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irt import _labsim, arguments
from irt.catalogue import parameter_values
from irt.engine import Simulator
from irt.errors import IrtError, located

Array = NDArray[np.float64]


class Fleet:
    """Marbles that go on row by row together, in the rolling engine.

    Each has the bits of a rollout by itself, for any number of threads and beside any others.

    Parameters
    ----------
    count : int
        How many.
    threads : int, optional
        Of the engine; by default one for each core.
    """

    def __init__(self, count: int, threads: int | None = None) -> None:
        self.count = arguments.whole("count", count, 1)
        self._fleet = _labsim.Fleet(self.count, arguments.threads(threads))

    def begin(
        self, place: int, model: Simulator, *, start: ArrayLike, rows: int, row_s: float, seed: int = 0
    ) -> None:
        """Put a marble at rest on a level board, in the place of another one.

        Parameters
        ----------
        place : int
            Which, from 0.
        model : Model
            Its simulator. An effect that lets pictures drift against commands is refused.
        start : (2,)
            Where it is seen [board edges].
        rows : int
            Rows that it can play.
        row_s : float
            How long a row lasts [s].
        seed : int
            Of effects that draw random numbers.

        Raises
        ------
        IrtError
            If a value is not as it must be.
        """
        x, y = arguments.array("start", start)
        effects = parameter_values([{"name": one.name, **one.parameters} for one in model.effects], 1)
        marble = model.marble
        with located(f"place {place}"):
            self._fleet.begin(
                arguments.whole("place", place),
                model.values.tolist(),
                (float(x), float(y)),
                effects=effects,
                board=astuple(model.board),
                marble=(marble.radius_m, marble.mass_kg, marble.damping_per_s),
                rows=arguments.whole("rows", rows, 1) + 1,
                row_s=row_s,
                seed=arguments.whole("seed", seed),
            )

    def play(self, commands: Any, is_asked: NDArray[np.bool_] | None = None) -> None:
        """Play a row of all marbles, or of those that are asked to.

        Parameters
        ----------
        commands : (count, 2)
            Of all marbles, in the rig's own unit [rad of a knob].
        is_asked : (count,) bool array, optional
            Which go on.

        Raises
        ------
        IrtError
            If a command is no number, or a marble was not put there, or has no row left.
        """
        given = arguments.array("commands", commands)
        if given.shape != (self.count, 2):
            raise IrtError(f"commands: expected shape ({self.count}, 2), got {given.shape}")
        if not np.isfinite(given).all():
            raise IrtError("commands: expected finite numbers, got nan or infinity")
        asked = np.ones(self.count, dtype=bool) if is_asked is None else is_asked
        self._fleet.play(np.ascontiguousarray(given), np.ascontiguousarray(asked))

    @property
    def rows(self) -> tuple[Array, Array]:
        """Where marbles are seen [board edges] and what tilt sensors read [rad], (count, 2) each.

        NaN where no marble was put.
        """
        return self._fleet.rows()
