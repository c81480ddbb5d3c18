"""The engine: arrays in, arrays out. `irt.rollouts` is the way in."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "ENGINES",
    "GRAVITY",
    "PARAMETERS",
    "SUBSTEP_S",
    "Fleet",
    "__version__",
    "ascend",
    "effects",
    "filtered",
    "fit",
    "inform",
    "leave_out",
    "paper_drive",
    "refine",
    "rollouts",
    "seen",
    "smoothed",
    "tracker_noise",
    "turned",
]

__version__: Final[str]
ENGINES: Final[list[str]]
PARAMETERS: Final[list[str]]
SUBSTEP_S: Final[float]
GRAVITY: Final[float]

def effects() -> list[
    tuple[
        str,
        str,
        str,
        list[tuple[str, str, float, float, float, float, float, int, str, bool, tuple[float, float]]],
        str,
        str,
        str,
        list[str],
        tuple[bool, bool, bool, bool, bool, bool],
        str | None,
    ]
]: ...
def rollouts(
    parameters: npt.NDArray[np.float64],
    commands: npt.NDArray[np.float64],
    start: npt.NDArray[np.float64],
    start_velocity: npt.NDArray[np.float64],
    rolled: npt.NDArray[np.float64],
    turned: npt.NDArray[np.float64],
    *,
    rows: int,
    first: npt.NDArray[np.uintp],
    issued: npt.NDArray[np.uintp],
    knobs_before: npt.NDArray[np.float64],
    effects: Sequence[tuple[str, npt.NDArray[np.float64]]],
    seeds: npt.NDArray[np.uint64],
    board: tuple[float, float, float, float, float],
    marble: tuple[float, float, float],
    maze: tuple[npt.NDArray[np.float64], float, npt.NDArray[np.float64], float] | None,
    engine: str,
    continuous: bool,
    substeps: npt.NDArray[np.uint32] | None,
    durations: npt.NDArray[np.float64] | None,
    hold: str,
    tilt: bool,
    threads: int | None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64] | None, npt.NDArray[np.int64]]: ...
def turned(path: npt.NDArray[np.float64], radius: float) -> npt.NDArray[np.float64]: ...
def seen(
    places: npt.NDArray[np.float64],
    effects: Sequence[tuple[str, npt.NDArray[np.float64]]],
    board: tuple[float, float, float, float, float, float],
    marble: tuple[float, float, float],
) -> npt.NDArray[np.float64]: ...
def paper_drive(steps: int, amplitude: float, literal: bool) -> npt.NDArray[np.float64]: ...
def ascend(
    problem: Mapping[str, Any],
    values: Sequence[Sequence[float]],
    noise: npt.NDArray[np.float64],
    states: Sequence[npt.NDArray[np.float64]] | None = None,
    *,
    iterations: int,
) -> list[dict[str, Any]]: ...
def filtered(
    problem: Mapping[str, Any],
    values: Sequence[Sequence[float]],
    noise: npt.NDArray[np.float64],
    states: Sequence[npt.NDArray[np.float64]] | None = None,
) -> list[dict[str, Any]]: ...
def fit(
    problem: Mapping[str, Any],
    *,
    points: Sequence[Sequence[float]],
    starts: int,
    seed: int,
    rounds: int,
    progress: Callable[[int, int, int], object] | None,
) -> dict[str, Any]: ...
def inform(problem: Mapping[str, Any], values: Sequence[float], *, noise: float) -> dict[str, Any]: ...
def leave_out(
    problem: Mapping[str, Any],
    values: Sequence[float],
    noise: npt.NDArray[np.float64],
    states: npt.NDArray[np.float64],
    *,
    folds: Sequence[int | None],
    iterations: int,
) -> list[dict[str, Any]]: ...
def refine(
    problem: Mapping[str, Any], values: Sequence[Sequence[float]], *, iterations: int, held: bool
) -> list[dict[str, Any]]: ...
def smoothed(
    problem: Mapping[str, Any],
    values: Sequence[float],
    noise: npt.NDArray[np.float64],
    states: npt.NDArray[np.float64],
) -> dict[str, Any]: ...
def tracker_noise(observed: Sequence[npt.NDArray[np.float64]]) -> float: ...

@final
class Fleet:
    def __new__(
        cls,
        count: int,
        rows: int,
        row_s: float,
        board: tuple[float, ...],
        marble: tuple[float, ...],
        maze: tuple[npt.NDArray[np.float64], float, npt.NDArray[np.float64], float] | None,
        path: npt.NDArray[np.float64],
        noise: float,
        lost: float,
    ) -> Fleet: ...
    def add(
        self,
        board: tuple[float, ...],
        marble: tuple[float, ...],
        parameters: Sequence[float],
        effects: Sequence[tuple[str, Sequence[float]]],
    ) -> int: ...
    def begin(
        self,
        marbles: npt.NDArray[np.uintp],
        simulators: npt.NDArray[np.uintp],
        places: npt.NDArray[np.float64],
        passed: npt.NDArray[np.uintp],
        seeds: npt.NDArray[np.uint64],
    ) -> None: ...
    def play(
        self,
        commands: npt.NDArray[np.float64],
        active: npt.NDArray[np.bool_],
        states: npt.NDArray[np.float64],
        threads: int | None,
    ) -> None: ...
    def pictures(
        self,
        scene: npt.NDArray[np.uint8],
        per_m: float,
        radius_m: float,
        pictures: npt.NDArray[np.uint8],
        threads: int | None,
    ) -> None: ...
    def states(self, states: npt.NDArray[np.float64]) -> None: ...
