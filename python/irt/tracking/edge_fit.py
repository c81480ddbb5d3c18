"""A disc laid through its rim: the steepest change along rays from a rough centre.

Each ray finds where along it the picture changes most near the rim; a circle of nearly known radius is laid
through these places, and rays that disagree (a line on the board, a finger before the marble) lose their
say. It needs to know nothing of the marble but its size: by it a marble's looks are learned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Values = NDArray[np.float32]

RAYS = 48
ANGLES: Array = 2.0 * np.pi * np.arange(RAYS) / RAYS
COS, SIN = np.cos(ANGLES), np.sin(ANGLES)
#: Between samples of a ray [pixels].
STEP = 0.5
#: Rays begin and end at these multiples of the radius.
FROM, TO = 0.35, 1.65
#: Width of the look-out for the rim about where it is expected, as a share of the radius, iteration by
#: iteration, before the rays are laid anew from the centre found, and after.
WIDE, NARROW = (0.28, 0.2, 0.16), (0.13, 0.12)
#: Least width of that [pixels]: what the lens blurs.
SHARPEST = 0.85
#: How far the radius may be from what is expected (standard deviation, as a share).
FREE = 0.3
#: A ray agrees within this much [pixels], or this share of the radius.
AGREES_PX, AGREES = 0.75, 0.09
#: What is left of the noise's variance between pixels, in the difference of two samples.
_SMOOTHED = 1.2
#: Least step that is a rim, in multiples of the noise, and in levels.
STEEP, LEAST_LEVELS = 2.5, 8.0


@dataclass(frozen=True)
class Rim:
    """A disc laid through what looks like its rim.

    Attributes
    ----------
    x, y, radius : float
        [pixels].
    support : float
        Share of the rays that agree, and have a marble's colours inside.
    filled : float
        Share of the disc that has a marble's colours.
    """

    x: float
    y: float
    radius: float
    support: float
    filled: float

    @property
    def confidence(self) -> float:
        """From 0 to 1: how much of a marble's rim, and of its colours, is there."""
        return self.support * min(1.0, self.filled / 0.7)


def fit_rim(
    layers: Values, noise: float, centre: tuple[float, float], radius: float, free: float = FREE
) -> Rim:
    """Lay a disc through a rim, from rough values within half a radius, all [pixels of the layers].

    Parameters
    ----------
    layers : (h, w, 4) float32 array
        Three colours [levels], and how much like the marble each pixel is, from 0 to 1.
    noise : float
        Standard deviation of a colour [levels].
    centre, radius : tuple, float
        Rough values.
    free : float
        How far the radius may be from its rough value (standard deviation, as a share).
    """
    x, y = centre
    found, dx, dy = radius, 0.0, 0.0
    for lookouts in (WIDE, NARROW):
        x, y = x + dx, y + dy
        size = max(found, 0.6 * radius)
        along = np.arange(FROM * size, TO * size + 1.0, STEP)
        rays = look(layers, x, y, along)
        steps = changes(rays[:, :, :3], noise)
        dx, dy, found, distances, heights = _lay(
            steps, along[1:-1], radius, found, lookouts=lookouts, noise=noise, free=free
        )
        if np.hypot(x + dx - centre[0], y + dy - centre[1]) > 0.9 * radius:
            return Rim(x, y, found, 0.0, 0.0)
    return _judge(rays[:, :, 3], along, (x + dx, y + dy, found), distances, heights > _least(noise))


def look(layers: Values, x: float, y: float, along: Array) -> Values:
    """Return what rays from a centre meet (RAYS, n, channels) at distances (n,) [pixels]."""
    across = (x + np.multiply.outer(COS, along)).astype(np.float32)
    down = (y + np.multiply.outer(SIN, along)).astype(np.float32)
    cv2 = opencv()
    sampled = cv2.remap(layers, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32).reshape(*across.shape, -1)


def changes(colours: Values, noise: float) -> Values:
    """Return the squared changes of colours along rays (RAYS, n, c), freed of what noise makes of them."""
    change = colours[:, 2:] - colours[:, :-2]
    square = np.einsum("ijk,ijk->ij", change, change)
    return np.asarray(np.maximum(square - np.float32(3.0 * _SMOOTHED * noise**2), 0.0))


def _least(noise: float) -> float:
    """Return the least step that is a rim [levels]."""
    return STEEP * noise + LEAST_LEVELS


def _lay(
    steps: Values,
    places: Array,
    radius: float,
    found: float,
    *,
    lookouts: tuple[float, ...],
    noise: float,
    free: float,
) -> tuple[float, float, float, Array, Array]:
    """Return the circle's offset and radius; each ray's distance from it, and its step [levels]."""
    dx = dy = 0.0
    design = np.stack([COS, SIN, np.ones(RAYS)])
    spots = places.astype(np.float32)
    for lookout in lookouts:
        expected = found + dx * COS + dy * SIN
        width = max(lookout * found, SHARPEST)
        distances, mass = _apart(steps, spots, expected, width)
        scale = 0.4 * width + 0.15
        weights = np.minimum(mass / _least(noise) ** 2, 4.0) / (1.0 + (distances / scale) ** 2) ** 2
        weighted = design * weights
        normal = weighted @ design.T
        right = weighted @ distances
        hold = 6.0 / (free * radius) ** 2
        normal[[0, 1, 2], [0, 1, 2]] += 1e-3, 1e-3, hold
        right[2] += hold * (radius - found)
        step = np.linalg.solve(normal, right)
        dx, dy, found = dx + step[0], dy + step[1], max(found + step[2], 0.4 * radius)
    distances = distances - step @ design
    return dx, dy, found, distances, np.sqrt(mass)


def _apart(steps: Values, spots: Values, expected: Array, width: float) -> tuple[Array, Array]:
    """Return how far outside of where it is expected each ray has its rim [pixels], and how much of one."""
    apart = (spots - expected[:, None].astype(np.float32)) * np.float32(1.0 / width)
    near = np.exp(-0.5 * apart * apart) * steps
    mass = near.sum(axis=1).astype(np.float64)
    return (near * apart).sum(axis=1) * width / (mass + 1e-6), mass


def _judge(
    alike: Values,
    along: Array,
    disc: tuple[float, float, float],
    distances: Array,
    clear: NDArray[np.bool_],
) -> Rim:
    """Return the disc with how much speaks for it."""
    x, y, radius = disc
    inside = (along > 0.45 * radius) & (along < 0.85 * radius)
    inner = alike[:, inside].mean(axis=1)
    agree = (np.abs(distances) < max(AGREES_PX, AGREES * radius)) & clear & (inner > 0.4)
    return Rim(x, y, radius, float(agree.mean()), float(inner.mean()))
