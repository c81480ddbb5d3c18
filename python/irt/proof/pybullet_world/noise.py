"""Noise of a tracker."""

from __future__ import annotations

import numpy as np

from .physics import EDGE_X_M, Array, between

#: Kinds of noise and their probabilities.
KINDS = {"white": 0.5, "heavy": 0.25, "coloured": 0.25}
LEAST_M, MOST_M = 0.2e-3, 2e-3
#: Share of samples in the tails of heavy noise, their relative width, and the autocorrelation of coloured
#: noise.
TAILS, WIDER, CARRIED = 0.1, 4.0, 0.6


def size(random: np.random.Generator, most: float = 1.0) -> float:
    """Draw a tracker's standard deviation [board edges], log-uniform up to that part of its scale."""
    return between(LEAST_M, MOST_M, float(random.uniform(0.0, most))) / EDGE_X_M


def kind(random: np.random.Generator) -> str:
    """Draw a kind of noise."""
    return str(random.choice(list(KINDS), p=list(KINDS.values())))


def noise(kind: str, rows: int, random: np.random.Generator) -> Array:
    """Draw noise (rows, 2) of unit standard deviation: white, heavy-tailed, or coloured from row to row."""
    drawn = random.normal(size=(rows, 2))
    if kind == "heavy":
        wide = random.random((rows, 2)) < TAILS
        drawn = drawn * np.where(wide, WIDER, 1.0) / np.sqrt(1.0 + TAILS * (WIDER**2 - 1.0))
    elif kind == "coloured":
        for row in range(1, rows):
            drawn[row] = CARRIED * drawn[row - 1] + np.sqrt(1.0 - CARRIED**2) * drawn[row]
    elif kind != "white":
        raise ValueError(f"noise is one of {', '.join(KINDS)}, not {kind!r}")
    return drawn


def outliers(seen: Array, share: float, random: np.random.Generator) -> Array:
    """Replace a share of the rows after the first by outliers."""
    taken = random.random(len(seen)) < share
    taken[0] = False
    elsewhere = random.uniform([-0.45, -0.38], [0.45, 0.38], seen.shape)
    return np.where(taken[:, None], elsewhere, seen)
