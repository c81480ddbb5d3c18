"""This project's engines through `irt.rollouts`."""

from __future__ import annotations

from irt.engine import Engine, rollouts
from peers.workload import PAPER_ROLLOUTS, Array


class Labsim:
    """One of this project's engines."""

    def __init__(self, engine: Engine, threads: int) -> None:
        self.name: str = engine
        self.threads = threads
        self.rollouts = PAPER_ROLLOUTS if engine == "rolling" else 128 * threads
        self._engine = engine

    def simulate(self, parameters: Array, commands: Array) -> Array:
        """Return positions (n, rows, 2) [board edges] of parameters (n, 5) under commands (rows, 2)."""
        return rollouts(parameters, commands, engine=self._engine, threads=self.threads)
