"""Baselines: standard methods on the same rigs as the diagnosis."""
