"""Engines and fits for `benches/compare.py`, one file each."""
