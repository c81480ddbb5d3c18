"""Results of the engine's solvers: values, residuals, likelihoods, curvature."""

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
    """Curvature of the loss in the free parameters, to first order around a solution.

    Directions are in units of the parameters' ranges: a step of 1 spans a range.

    Attributes
    ----------
    free : (f,) int array
        Indices of the estimated parameters.
    directions : (f, f) array
        Orthonormal combinations of those, one per row.
    singular : (f,) array
        Singular values: change of the weighted residuals [board edges] along each direction, largest first.
    deviation : (f,) array
        Standard deviation along each direction, infinite if nothing is known.
    offset : (f,) array
        Offset from the solution to the linearised best fit along each direction; NaN if nothing is known.
    degrees_of_freedom : float
        Number of residuals minus number of fitted values.
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
        """Return the curvature from the engine's result; `slots` (n,) are the problem's parameters."""
        return cls(**{**found, "free": np.searchsorted(slots, np.array(found["free"], dtype=np.int64))})


@dataclass(frozen=True, eq=False)
class Shrunk:
    """Coefficients of an effect that are shrunk towards zero: leans of runs, or the slopes of a map.

    They have a normal prior with mean zero. Its standard deviation, the size, is estimated along with them
    (empirical Bayes).

    Attributes
    ----------
    effect : str
        Name of the effect.
    size : float
        The estimated size; 0, with all coefficients 0, if the recordings give no evidence for it.
    interval : tuple of float
        The 95 % interval of the size, from the profile of the evidence.
    gain : float
        Log evidence of the best size minus that of size 0 [nats].
    effective : float
        Effective number of coefficients.
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
        """Return the coefficients from the engine's result."""
        shape = (-1, 2) if found["effect"] == LEAN else (-1,)
        pairs = {name: found[name].reshape(shape) for name in ("values", "deviations")}
        return cls(**{**found, **pairs})


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of the engine's fit.

    Attributes
    ----------
    values : (n,) array
        The five parameters, then those of the effects.
    states : (s, 4) array
        Start state of each segment: position [board edges] and rate [board edges per row]; NaN if there are
        too few observations.
    residuals : list of (rows, 2) arrays
        Predicted minus observed for each segment [board edges]; NaN in rows without a marble.
    tracker_noise : float
        Standard deviation of the tracker [board edges], from the recordings alone; NaN without a marble.
    noise : float
        Robust standard deviation of the residuals [board edges], corrected for the degrees of freedom; NaN
        without a marble.
    axis_noise : (2,) array
        The same along x and along y; NaN along an axis that never changes.
    tilt_residuals : list of (rows, 2) arrays
        Predicted minus measured tilt for each segment [rad], NaN in rows without a tilt; empty if no
        recording has a tilt.
    tilt_noise, tilt_scale : (2,) arrays
        Standard deviation of the tilt sensor about x and y [rad], given or estimated from its changes, and
        robust standard deviation of the residuals; NaN without a tilt, or about an axis that never changes.
    loss : float
        Negative log-likelihood of the residuals up to a constant, at a scale of `tracker_noise`, those of the
        tilt at a scale of `tilt_noise`.
    information : Curvature
        Curvature of the loss at the values.
    shrunk : list of Shrunk
        The leans of runs and the maps of slopes. In `values` the leans are 0, as for a new run; the sizes are
        included.
    estimates : list of ((t, n) array, (t,) array)
        Values of the iterations from each start point, and their mean absolute errors [board edges]; the best
        first.
    rollouts : int
        Number of simulated windows, over all start points.
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
    """One-step predictions of the marble, and of the measured tilt.

    Attributes
    ----------
    predicted : list of (n, 2) arrays
        Positions predicted from all rows before [board edges]; empty if there are too few observations.
    variance : list of (n, 2) arrays
        Their variances [board edges squared]; NaN in first rows.
    tilt : list of (n, 2) arrays
        The measured tilt predicted from all rows before [rad]; empty if no segment has any.
    tilt_variance : list of (n, 2) arrays
        Variances of the measurements about these predictions [rad squared].
    log_likelihood : (segments, 4) array
        Log-likelihood of the observations [nats]: of the marble along each axis, of the tilt about each axis.
    """

    predicted: list[Array]
    variance: list[Array]
    tilt: list[Array]
    tilt_variance: list[Array]
    log_likelihood: Array


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Smoothed estimates of the random push, and of the tracker's correlated noise, in each row.

    Attributes
    ----------
    push, push_deviation : list of (n, 2) arrays
        Accelerations missing in the model between the row before and each row, and their standard deviations
        [m/s^2]; NaN in first rows and where friction holds the marble; empty if there are too few
        observations.
    lasting, lasting_deviation : list of (n, 2) arrays
        Correlated noise of the tracker, and its standard deviations [board edges].
    """

    push: list[Array]
    push_deviation: list[Array]
    lasting: list[Array]
    lasting_deviation: list[Array]


@dataclass(frozen=True, eq=False)
class Refined:
    """The result of a local minimisation.

    Attributes
    ----------
    values : (n,) array
        The five parameters, then those of the effects.
    states : (s, 4) array
        As in `Solution`.
    residuals, tilt_residuals : lists of (rows, 2) arrays
        As in `Solution`.
    """

    values: Array
    states: Array
    residuals: list[Array]
    tilt_residuals: list[Array]


@dataclass(frozen=True, eq=False)
class Probable:
    """A local maximum of the posterior in which the marble is also pushed at random.

    Attributes
    ----------
    values, deviations : (n,) arrays
        The five parameters, then those of the effects, and their standard deviations; 0 if held.
    covariance : (n, n) array
        Covariance of the values.
    states : (s, 4) array
        Start states of the segments, as in `Solution`.
    noise : (14,) array
        Noise sizes, as taken by `Problem.filter`.
    log_likelihood : float
        Log-likelihood of the observations [nats].
    log_evidence : float
        Log marginal likelihood of the observations (Laplace's approximation) [nats].
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
        """Return the maximum from the engine's result; `slots` (n,) are the problem's parameters."""
        own = {name: found[name][slots] for name in ("values", "deviations")}
        return cls(**{**found, **own, "covariance": found["covariance"][np.ix_(slots, slots)]})
