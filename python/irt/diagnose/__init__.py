"""Diagnosis: where a simulator and recordings disagree, what physics was left out, and the proof."""
