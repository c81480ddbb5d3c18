"""Robust linear regression with time-correlated errors and noise in the regressors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.cleaning import deviation

Array = NDArray[np.float64]

#: Tukey's constant for 95 % efficiency under normal noise.
_TUKEY = 4.685
#: Duration of blocks with correlated errors [s]: windows overlap, and tilt offsets and wall contacts last.
_BLOCK_S = 2.0


def robust_fit(design: Array, target: Array, share: Array, rounds: int = 12) -> tuple[Array, Array]:
    """Return coefficients and weights of Tukey's M-estimate, corrected for the known noise of the regressors.

    ``share`` is the variance of the noise in each entry of the design, (n, k) or (k,).
    """
    weights: Array = np.ones(len(target))
    coefficients: Array = np.zeros(design.shape[1])
    for _ in range(rounds):
        weighted = design * weights[:, None]
        normal = design.T @ weighted - np.diag(
            np.sum(weights[:, None] * share, axis=0) * np.ones(design.shape[1])
        )
        coefficients = np.asarray(np.linalg.lstsq(normal, weighted.T @ target, rcond=None)[0])
        left = np.abs(target - design @ coefficients)
        scale = deviation(left)
        if scale < 1e-12:
            break
        weights = np.asarray(np.clip(1.0 - (left / (_TUKEY * scale)) ** 2, 0.0, None) ** 2)
    return coefficients, weights


def sandwich(jacobian: Array, weights: Array, left: Array, blocks: Array, share: Array) -> Array:
    """Return the covariance of an M-estimate whose errors are correlated within blocks."""
    scores = jacobian * (weights * left)[:, None]
    _, which = np.unique(blocks, return_inverse=True)
    sums = np.zeros((which.max() + 1, jacobian.shape[1]))
    np.add.at(sums, which, scores)
    # The derivative of Tukey's score, which is the sensitivity of the estimate, is smaller than its weight.
    root = np.sqrt(weights)
    slopes = root * (5.0 * root - 4.0)
    noise = np.sum(slopes[:, None] * share, axis=0) * np.ones(jacobian.shape[1])
    normal = jacobian.T @ (slopes[:, None] * jacobian) - np.diag(noise)
    inverse = np.linalg.pinv(normal)
    # The usual small-sample factor for few blocks.
    groups = len(sums)
    factor = groups / max(groups - 1, 1)
    return np.asarray(factor * inverse @ (sums.T @ sums) @ inverse)


def time_blocks(times: Sequence[Array]) -> Array:
    """Return the block number of each row; blocks last two seconds and end with their run."""
    parts, done = [], 0
    for one in times:
        block = np.floor((one - one[0]) / _BLOCK_S).astype(int) if len(one) else np.zeros(0, dtype=int)
        parts.append(block + done)
        done += int(block.max()) + 1 if len(one) else 0
    return np.concatenate(parts).astype(np.float64)
