"""Fitting the five parameters to recordings, and saying how well they are known."""
