"""Diagnosis: locate the mismatch of a simulator, identify missing physics, validate it on held-out runs."""

from irt.diagnosis.result import Diagnosis
from irt.diagnosis.run import diagnose

__all__ = ["Diagnosis", "diagnose"]
