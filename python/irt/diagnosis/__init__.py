"""Diagnosis: where a simulator and recordings disagree, what physics was left out, and the proof."""

from irt.diagnose.diagnosis import Diagnosis
from irt.diagnose.run import Interrupted, diagnose

__all__ = ["Diagnosis", "Interrupted", "diagnose"]
