"""Diagnosis: where a simulator and recordings disagree, what physics was left out, and the proof."""

from irt.diagnosis.result import Diagnosis
from irt.diagnosis.run import diagnose

__all__ = ["Diagnosis", "diagnose"]
