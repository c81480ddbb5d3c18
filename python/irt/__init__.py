"""Tune a marble-labyrinth simulator to recordings, and find the physics it leaves out.

Names are resolved on first use, so importing the package is fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from irt.errors import IrtError

if TYPE_CHECKING:
    from irt.catalogue import EffectInfo, EffectParameter, effects
    from irt.checking import Check, check
    from irt.diagnosis import Diagnosis, diagnose
    from irt.dimensions import Board, Commands, Marble, TiltSensor
    from irt.engine import paper_drive, rollouts
    from irt.export.jsonfile import to_json
    from irt.export.mjcf import Exported, to_mjcf
    from irt.fitting.fit import Estimate, FitResult, Iteration
    from irt.maze import Maze
    from irt.model import Effect, Model, Parameter, load_model, save_model
    from irt.recording import Recording, load_recording, save_recording
    from irt.report.diagnosis_report import write_diagnosis_report
    from irt.report.tracked import Tracked, track
    from irt.report.tuning_report import write_tuning_report
    from irt.residual import Errors, Evaluation, evaluate
    from irt.rig import Rig, load_rig
    from irt.sessions import pool
    from irt.suggestion import Suggestion, suggest
    from irt.tuning import tune

__all__ = [
    "Board",
    "Check",
    "Commands",
    "Diagnosis",
    "Effect",
    "EffectInfo",
    "EffectParameter",
    "Errors",
    "Estimate",
    "Evaluation",
    "Exported",
    "FitResult",
    "IrtError",
    "Iteration",
    "Marble",
    "Maze",
    "Model",
    "Parameter",
    "Recording",
    "Rig",
    "Suggestion",
    "TiltSensor",
    "Tracked",
    "check",
    "diagnose",
    "effects",
    "evaluate",
    "load_model",
    "load_recording",
    "load_rig",
    "paper_drive",
    "pool",
    "rollouts",
    "save_model",
    "save_recording",
    "suggest",
    "to_json",
    "to_mjcf",
    "track",
    "tune",
    "write_diagnosis_report",
    "write_tuning_report",
]

_HOMES = {
    "irt.catalogue": ("EffectInfo", "EffectParameter", "effects"),
    "irt.checking": ("Check", "check"),
    "irt.diagnosis": ("Diagnosis", "diagnose"),
    "irt.dimensions": ("Board", "Commands", "Marble", "TiltSensor"),
    "irt.engine": ("paper_drive", "rollouts"),
    "irt.export.jsonfile": ("to_json",),
    "irt.export.mjcf": ("Exported", "to_mjcf"),
    "irt.fitting.fit": ("Estimate", "FitResult", "Iteration"),
    "irt.maze": ("Maze",),
    "irt.model": ("Effect", "Model", "Parameter", "load_model", "save_model"),
    "irt.recording": ("Recording", "load_recording", "save_recording"),
    "irt.report.diagnosis_report": ("write_diagnosis_report",),
    "irt.report.tracked": ("Tracked", "track"),
    "irt.report.tuning_report": ("write_tuning_report",),
    "irt.residual": ("Errors", "Evaluation", "evaluate"),
    "irt.rig": ("Rig", "load_rig"),
    "irt.sessions": ("pool",),
    "irt.suggestion": ("Suggestion", "suggest"),
    "irt.tuning": ("tune",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415

        return version("labsim-irt")
    if name not in _HOME:
        raise AttributeError(f"module 'irt' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
