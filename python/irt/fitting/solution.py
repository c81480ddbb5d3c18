"""What the engine finds: values, residuals, likelihoods, and what recordings tell about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.model import LEAN

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curvature:
    """What recordings tell about the free ones of n parameters, to first order around a solution.

    Directions are in units of the parameters' ranges, so that 1 is from one end to the other.

    Attributes
    ----------
    free : (f,) int array
        Which parameters were estimated.
    directions : (f, f) array
        Orthonormal combinations of those, one a row.
    singular : (f,) array
        How much the weighted residuals [board edges] change along each direction, the largest first.
    deviation : (f,) array
        Standard deviation along each direction, infinite where nothing is known.
    offset : (f,) array
        From the solution to the linearised best fit along each direction; NaN where nothing is known.
    degrees_of_freedom : float
        Residuals that count, less what was fitted.
    scale : float
        Robust standard deviation of the residuals [board edges].
    """

    free: NDArray[np.int64]
    directions: Array
    singular: Array
    deviation: Array
    offset: Array
    degrees_of_freedom: float
    scale: float

    @classmethod
    def of(cls, found: Mapping[str, Any], slots: NDArray[np.int64]) -> Curvature:
        """Return the engine's information, whose (n,) slots are the problem's parameters."""
        return cls(**{**found, "free": np.searchsorted(slots, np.array(found["free"], dtype=np.int64))})


@dataclass(frozen=True, eq=False)
class Shrunk:
    """Coefficients of one effect that are shrunk towards zero: leans of runs, or the slopes of a map.

    They are drawn from a normal distribution about zero. Its size, the standard deviation, is estimated along
    with them (empirical Bayes).

    Attributes
    ----------
    effect : str
        Whose they are.
    size : float
        The estimated size; 0 where the recordings give no evidence of one, and all coefficients are 0.
    interval : tuple of float
        The 95 % interval of the size, by the profile of the evidence.
    gain : float
        By how much the log evidence of the best size exceeds that of none.
    effective : float
        How many coefficients the recordings fix.
    values, deviations : arrays
        The coefficients and their posterior standard deviations: (r, 2) leans about x and y [rad] of the
        recordings in the order of the problem, or the (k,) coefficients of a map.
    """

    effect: str
    size: float
    interval: tuple[float, float]
    gain: float
    effective: float
    values: Array
    deviations: Array

    @classmethod
    def of(cls, found: Mapping[str, Any]) -> Shrunk:
        """Return what the engine found."""
        shape = (-1, 2) if found["effect"] == LEAN else (-1,)
        pairs = {name: found[name].reshape(shape) for name in ("values", "deviations")}
        return cls(**{**found, **pairs})


@dataclass(frozen=True, eq=False)
class Solution:
    """The outcome of the engine's fit.

    Attributes
    ----------
    values : (n,) array
        The five parameters, then the effects'.
    states : (s, 4) array
        Start state of each segment: place [board edges] and rate [board edges a row]; NaN where the tracker
        saw too little.
    residuals : list of (rows, 2) arrays
        Predicted minus observed for each segment [board edges]; NaN where nothing was seen.
    tracker_noise : float
        Standard deviation of the tracker [board edges], from the recordings alone; NaN without a marble.
    noise : float
        Robust standard deviation of the residuals [board edges], freed of what was fitted; NaN without a
        marble.
    axis_noise : (2,) array
        The same along x and along y; NaN along an axis that never changes.
    tilt_residuals : list of (rows, 2) arrays
        Predicted minus measured tilt for each segment [rad], NaN where it was not measured; empty where no
        recording has any.
    tilt_noise, tilt_scale : (2,) arrays
        Standard deviation of the tilt sensor about x and y [rad], given or from its changes, and robust
        standard deviation of the residuals; NaN where there is none, or about an axis that never changes.
    loss : float
        Negative log-likelihood of the residuals up to a constant, at a scale of `tracker_noise`, those of the
        tilt at a scale of `tilt_noise`.
    information : Curvature
        What the recordings tell about the values.
    shrunk : list of Shrunk
        What became of the leans of runs and the maps of slopes. Among `values` a lean is 0, that of a run of
        which nothing is known; its size is among them as well.
    estimates : list of ((t, n) array, (t,) array)
        Values on the way from each start point, and their mean absolute errors [board edges]; the best first.
    rollouts : int
        Windows simulated, all start points together.
    """

    values: Array
    states: Array
    residuals: list[Array]
    tracker_noise: float
    noise: float
    axis_noise: Array
    tilt_residuals: list[Array]
    tilt_noise: Array
    tilt_scale: Array
    loss: float
    information: Curvature
    shrunk: list[Shrunk]
    estimates: list[tuple[Array, Array]]
    rollouts: int


@dataclass(frozen=True, eq=False)
class Filtered:
    """One-step predictions of the marble.

    Attributes
    ----------
    predicted : list of (n, 2) arrays
        Positions as predicted from all rows before [board edges]; empty where the tracker saw too little.
    variance : list of (n, 2) arrays
        Variances about them [board edges squared]; NaN in first rows.
    log_likelihood : (segments, 2) array
        Of what was seen along each axis.
    """

    predicted: list[Array]
    variance: list[Array]
    log_likelihood: Array


@dataclass(frozen=True, eq=False)
class Smoothed:
    """What all rows of a segment say of the random push in every row, and of the tracker's error that lasts.

    Attributes
    ----------
    push, push_deviation : list of (n, 2) arrays
        Accelerations of the marble between the row before and each row, which the model does not have, and
        their standard deviations [m/s^2]; NaN in first rows; empty where the tracker saw too little.
    lasting, lasting_deviation : list of (n, 2) arrays
        Errors of the tracker that last, and their standard deviations [board edges].
    """

    push: list[Array]
    push_deviation: list[Array]
    lasting: list[Array]
    lasting_deviation: list[Array]


@dataclass(frozen=True, eq=False)
class Refined:
    """Where values have led.

    Attributes
    ----------
    values : (n,) array
        The five parameters, then the effects'.
    states : (s, 4) array
        As of a `Solution`.
    residuals, tilt_residuals : lists of (rows, 2) arrays
        As of a `Solution`.
    """

    values: Array
    states: Array
    residuals: list[Array]
    tilt_residuals: list[Array]


@dataclass(frozen=True, eq=False)
class Probable:
    """The most probable values that an ascent has reached, where the marble is also pushed at random.

    Attributes
    ----------
    values, deviations : (n,) arrays
        The five parameters, then the effects', and their standard deviations; 0 of what is held.
    covariance : (n, n) array
        Of the values.
    states : (s, 4) array
        Start states of the segments, as of a `Solution`.
    noise : (10,) array
        Sizes of what is random, as `Problem.filter` takes them.
    log_likelihood : float
        Of what was seen [nats].
    log_evidence : float
        Logarithm of the probability of what was seen, over all values (Laplace's approximation) [nats].
    """

    values: Array
    deviations: Array
    covariance: Array
    states: Array
    noise: Array
    log_likelihood: float
    log_evidence: float

    @classmethod
    def of(cls, found: Mapping[str, Any], slots: NDArray[np.int64]) -> Probable:
        """Return what the engine found, whose (n,) slots are the problem's parameters."""
        own = {name: found[name][slots] for name in ("values", "deviations")}
        return cls(**{**found, **own, "covariance": found["covariance"][np.ix_(slots, slots)]})
