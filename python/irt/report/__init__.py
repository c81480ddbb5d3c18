"""Plots and HTML reports of tunings, diagnoses and tracks."""
