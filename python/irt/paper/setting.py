"""Settings of a reproduction: drive, numbers of targets and rigs, seed, and folder of results."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.files import make_folder, write_atomic
from irt.fitting.fit import Progress
from irt.rig import Marble
from irt.tuning.drive import Drive

Array = NDArray[np.float64]

#: What PyBullet applies to every body by default [1/s].
BULLET_DAMPING = 0.04
#: Maximum number of rollouts in comparisons.
ROLLOUTS = 300
#: Number of trials in the paper.
PAPERS_TRIALS = 10


@dataclass(frozen=True)
class Setting:
    """Settings that determine the numbers.

    Attributes
    ----------
    out : Path
        Folder of the results. Existing ones are reused.
    targets : int
        Number of targets of Experiment 1.
    rigs : int
        Number of rigs of Experiment 2.
    diagnosed : int
        Number of these that are diagnosed as well.
    seed : int
        Seed of all random numbers.
    literal : bool
        Whether the drive is Eq. 3 as printed.
    damped : bool
        Whether the marble has PyBullet's default damping.
    threads : int, optional
        Threads of the engine; results do not depend on it.
    """

    out: Path
    targets: int = 100
    rigs: int = 20
    diagnosed: int = 4
    seed: int = 0
    literal: bool = False
    damped: bool = False
    threads: int | None = None

    @cached_property
    def drive(self) -> Drive:
        """The drive of the simulations."""
        drive = Drive.paper(literal=self.literal)
        return replace(drive, marble=Marble(damping_per_s=BULLET_DAMPING)) if self.damped else drive

    @cached_property
    def trained(self) -> Setting:
        """The setting of the networks' training: without damping, which hardly matters."""
        return replace(self, damped=False)

    def folder(self, name: str) -> Path:
        """Return the folder of results for this drive; created if missing."""
        variant = "".join(f"-{word}" for word in ("literal", "damped") if getattr(self, word))
        return make_folder(self.out / f"{name}{variant}")

    def kept(self, path: Path, made: Callable[[], dict[str, Array]], **about: object) -> dict[str, Array]:
        """Return arrays from an .npz file; computed if it is missing or of other settings."""
        mark = json.dumps(about, sort_keys=True)
        if path.exists():
            try:
                with np.load(path) as file:
                    if str(file["about"]) == mark:
                        return {name: file[name] for name in file.files if name != "about"}
            except (OSError, ValueError, KeyError) as error:
                raise IrtError(
                    f"{path}: broken ({error}); delete it and run the same command again"
                ) from error
        arrays = made()
        save_arrays(path, {**arrays, "about": np.array(mark)})
        return arrays


def save_arrays(path: Path, arrays: dict[str, Array]) -> None:
    """Write arrays as .npz atomically."""
    whole = io.BytesIO()
    np.savez_compressed(whole, **arrays)  # type: ignore[arg-type]
    write_atomic(path, whole.getvalue())


def digest(*arrays: Array) -> str:
    """Return a short hash of arrays."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in arrays)).hexdigest()[:16]


def within(progress: Progress | None, text: str) -> Progress | None:
    """Return a progress callback with a prefix."""
    if progress is None:
        return None
    return lambda done, total, more: progress(done, total, f"{text}: {more}")
