"""Fit the five parameters and the effects to recordings, with intervals and identifiability."""
