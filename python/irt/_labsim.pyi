"""The engine: arrays in, arrays out. `irt.rollouts` is the way in."""

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["ENGINES", "PARAMETERS", "SUBSTEP_S", "__version__", "paper_drive", "rollouts"]

__version__: Final[str]
ENGINES: Final[list[str]]
PARAMETERS: Final[list[str]]
SUBSTEP_S: Final[float]

def rollouts(
    parameters: npt.NDArray[np.float64],
    commands: npt.NDArray[np.float64],
    start: npt.NDArray[np.float64],
    start_velocity: npt.NDArray[np.float64],
    *,
    board: tuple[float, float, float, float],
    marble: tuple[float, float, float],
    engine: str,
    continuous: bool,
    substeps: npt.NDArray[np.uint32] | None,
    durations: npt.NDArray[np.float64] | None,
    threads: int | None,
) -> npt.NDArray[np.float64]: ...
def paper_drive(steps: int, amplitude: float, literal: bool) -> npt.NDArray[np.float64]: ...
