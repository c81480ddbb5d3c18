"""Input and output of the baseline methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.diagnosis.dataset import Dataset
from irt.engine import SUBSTEP_S
from irt.model import Model, load_model
from irt.recording import Recording, load_recording
from irt.residual import evaluate
from irt.rig import PARAMETERS, Rig, load_rig
from irt.segments import LEAD_ROWS

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Task:
    """Input of a method: a rig and the runs to predict.

    Attributes
    ----------
    rig : Rig
        The recordings to learn from.
    base : Model
        Five parameters fitted to them, by irt.
    tests : tuple of Recording
        Runs to predict: commands, and the first rows, where a prediction starts; NaN after these.
    """

    rig: Rig
    base: Model
    tests: tuple[Recording, ...]

    @classmethod
    def load(cls, folder: Path) -> Task:
        """Read a folder: recordings, ``models/base.toml`` where there is one, and ``tests/``.

        Raises
        ------
        IrtError
            If a file is invalid.
        """
        rig = load_rig(folder)
        path = folder / "models" / "base.toml"
        tests = tuple(load_recording(one) for one in sorted((folder / "tests").glob("*.csv")))
        return cls(rig, load_model(path) if path.exists() else refitted(rig), tests)

    def row_s(self, recording: Recording) -> float:
        """Return the duration of a row [s], from its stamps or the base model."""
        if recording.durations is not None:
            return float(np.median(recording.durations))
        return float(self.base.values[PARAMETERS.index("time_scale")]) * SUBSTEP_S

    @property
    def begun(self) -> list[Recording]:
        """Recordings with a marble in row 0 and afterwards, from which a simulation can start."""
        return [one for one in self.rig.recordings if one.seen[0] and one.seen.sum() > 1]

    def start(self, recording: Recording) -> Array:
        """Return the state in row 0 of a recording, (4,): position [edges] and velocity [edges/s]."""
        state = np.zeros(4)
        state[:2] = recording.marble[0]
        known = np.flatnonzero(recording.seen)[:LEAD_ROWS]
        if self.rig.start == "moving" and len(known) > 1:
            state[2:] = np.polyfit(known * self.row_s(recording), recording.marble[known], 1)[0]
        return state


@dataclass(frozen=True, eq=False)
class Entry:
    """Answer of a method for a rig.

    Attributes
    ----------
    detected : bool or None
        Whether the base model lacks physics; None if the method does not report it.
    named : tuple of str or None
        Names of the missing effects; None if the method names none.
    predictions : dict
        Positions in each test, (n, 2) [board edges]; empty without predictions.
    missing : str
        Reason for a missing answer; empty otherwise.
    """

    detected: bool | None = None
    named: tuple[str, ...] | None = None
    predictions: dict[str, Array] = field(default_factory=dict)
    missing: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the entry as JSON content; ``told`` is `detected`; paths that are not finite are None."""
        paths = {name: _finite(path) for name, path in self.predictions.items()}
        named = None if self.named is None else list(self.named)
        return {"told": self.detected, "named": named, "predictions": paths, "missing": self.missing}


Method = Callable[[Task], Entry]


def refitted(rig: Rig) -> Model:
    """Return five parameters fitted to a rig."""
    dataset = Dataset.of(rig, threads=1)
    return dataset.fit().model


def predicted(model: Model, tests: Sequence[Recording]) -> dict[str, Array]:
    """Return free runs of a model, (n, 2) [board edges] by name."""
    return {run.recording: run.free_prediction for run in evaluate(model, tests).runs}


def by_name(tests: Sequence[Recording], paths: Sequence[Array]) -> Mapping[str, Array]:
    """Return paths under the names of their tests."""
    return {test.name: path for test, path in zip(tests, paths, strict=True)}


def _finite(path: Array) -> list[list[float]] | None:
    return path.tolist() if np.isfinite(path).all() else None
