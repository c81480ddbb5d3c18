"""Where a disc's rim is, to a fraction of a pixel: the steepest change along rays from a rough centre.

The middle of a marble's colours is drawn aside by shading, highlights and its shadow; its rim is not. Each
ray tells where along it the picture changes most near the rim; a circle of nearly known radius is laid
through these places, and rays that disagree (a line on the board, a finger before the marble) lose their
say. The square of the change is averaged, so that the slow shading within the disc counts little beside the
step at its rim.

Where the marble's colours inside of each ray and the board's colours without it are known, the change is
that of how much of a pixel the marble covers: from its colour to whatever is painted there, whichever way
that goes. What is like less light on the board counts less, and where a shadow at the rim moves the steepest
place is learned (`irt.tracking.outline`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

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
#: How far the radius may be from what is expected (standard deviation, as a share): as learned, or unknown.
KNOWN, UNKNOWN = 0.02, 0.3
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
    spread : float
        Root mean square distance of the rays that agree [pixels].
    """

    x: float
    y: float
    radius: float
    support: float
    filled: float
    spread: float

    @property
    def confidence(self) -> float:
        """From 0 to 1: how much of a marble's rim, and of its colours, is there."""
        return self.support * min(1.0, self.filled / 0.7)


@dataclass(frozen=True, eq=False)
class Outline:
    """What the steps at a rim are like, ray by ray.

    Attributes
    ----------
    radii : (RAYS,) array
        Where the steepest change is, over the marble's radius.
    weights : (RAYS,) array
        What each ray counts.
    inside : (RAYS, 3) array or None
        The marble's colour within its rim [levels]; by default any change of colour counts.
    shade : float
        Share by which the light on the board is uncertain, so that a marble's colour tells it from a shadow.
    free : float
        How far a radius may be from what is expected (standard deviation, as a share).
    """

    radii: Array = field(default_factory=lambda: np.ones(RAYS))
    weights: Array = field(default_factory=lambda: np.ones(RAYS))
    inside: Values | None = None
    shade: float = 0.0
    free: float = UNKNOWN


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of a picture.

    Attributes
    ----------
    layers : (h, w, 4) float32 array
        Three colours [levels], and how much like the marble each pixel is, from 0 to 1.
    without : (h, w, 3) float32 array or None
        The colours that the board has there without a marble, where that is known.
    noise : float
        Standard deviation of a colour [levels].
    """

    layers: Values
    without: Values | None
    noise: float


def fit_rim(patch: Patch, centre: tuple[float, float], radius: float, outline: Outline) -> Rim:
    """Lay a disc through a rim, from rough values within half a radius, all [pixels of the patch]."""
    x, y = centre
    found, dx, dy = radius, 0.0, 0.0
    for lookouts in (WIDE, NARROW):
        x, y = x + dx, y + dy
        alike, steps, along = _steps(patch, (x, y), max(found, 0.6 * radius), outline)
        dx, dy, found, distances, heights = _lay(
            steps, along[1:-1], radius, found, lookouts=lookouts, patch=patch, outline=outline
        )
        if np.hypot(x + dx - centre[0], y + dy - centre[1]) > 0.9 * radius:
            return Rim(x, y, found, 0.0, 0.0, 0.0)
    place = x, y, dx, dy
    return _judge(alike, along, place, found, distances=distances, heights=heights, noise=patch.noise)


def ray_distances(patch: Patch, centre: tuple[float, float], radius: float, outline: Outline) -> Array:
    """Return how far outside its expected place each ray of a known disc has its rim, (RAYS,) [pixels]."""
    _, steps, along = _steps(patch, centre, radius, outline)
    width = max(NARROW[-1] * radius, SHARPEST)
    return _apart(steps, along[1:-1].astype(np.float32), radius * outline.radii, width)[0]


def _steps(
    patch: Patch, centre: tuple[float, float], radius: float, outline: Outline
) -> tuple[Values, Values, Array]:
    """Return what rays meet: likeness (RAYS, n), squared steps (RAYS, n - 2), at distances (n,) [pixels]."""
    along = np.arange(FROM * radius, TO * radius + 1.0, STEP)
    sampled = look(patch.layers, *centre, along)
    colours = sampled[:, :, :3]
    if outline.inside is None or patch.without is None:
        steps = changes(colours, patch.noise)
    else:
        without = look(patch.without, *centre, along)
        steps = uncoverings(colours, without, outline.inside, patch.noise, outline.shade)
    return sampled[:, :, 3], steps, along


def look(layers: Values, x: float, y: float, along: Array) -> Values:
    """Return what rays from a centre meet (RAYS, n, channels) at distances (n,) [pixels]."""
    across = (x + np.multiply.outer(COS, along)).astype(np.float32)
    down = (y + np.multiply.outer(SIN, along)).astype(np.float32)
    cv2 = opencv()
    sampled = cv2.remap(layers, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32)


def changes(colours: Values, noise: float) -> Values:
    """Return the squared changes of colours along rays (RAYS, n, 3), freed of what noise makes of them."""
    change = colours[:, 2:] - colours[:, :-2]
    square = np.einsum("ijk,ijk->ij", change, change)
    return np.asarray(np.maximum(square - np.float32(3.0 * _SMOOTHED * noise**2), 0.0))


def uncoverings(colours: Values, without: Values, inside: Values, noise: float, shade: float) -> Values:
    """Return the squared changes along rays (RAYS, n - 2) from a marble to what it covers [levels].

    Parameters
    ----------
    colours, without : (RAYS, n, 3) arrays
        What rays meet, and would without the marble.
    inside : (RAYS, 3) array
        The marble's colour within its rim.
    noise, shade : float
        Standard deviation of a colour, and of the light on the board as a share of it.
    """
    apart = inside[:, None, :] - without
    # As if the light on the board were uncertain by a share: by the inverse of a covariance that is the
    # noise's and one along the board's own colour.
    part = np.float32((shade / noise) ** 2)
    bright = np.einsum("ijk,ijk->ij", without, without)
    along = np.einsum("ijk,ijk->ij", without, apart) * (part / (1.0 + part * bright))
    across = apart - without * along[:, :, None]
    size = np.maximum(np.einsum("ijk,ijk->ij", apart, across), 0.0)
    cover = np.einsum("ijk,ijk->ij", colours - without, across) / (size + np.float32(9.0 * noise**2))
    fall = np.maximum(cover[:, :-2] - cover[:, 2:], 0.0)
    return np.asarray(np.maximum(fall**2 * size[:, 1:-1] - np.float32(_SMOOTHED * noise**2), 0.0))


def _lay(
    steps: Values,
    places: Array,
    radius: float,
    found: float,
    *,
    lookouts: tuple[float, ...],
    patch: Patch,
    outline: Outline,
) -> tuple[float, float, float, Array, Array]:
    """Return the circle's offset and radius; each ray's distance from it, and its step [levels]."""
    dx = dy = 0.0
    strongest = (STEEP * patch.noise + LEAST_LEVELS) ** 2
    design = np.stack([COS, SIN, outline.radii])
    spots = places.astype(np.float32)
    for lookout in lookouts:
        expected = found * outline.radii + dx * COS + dy * SIN
        width = max(lookout * found, SHARPEST)
        distances, mass = _apart(steps, spots, expected, width)
        scale = 0.4 * width + 0.15
        weights = outline.weights * np.minimum(mass / strongest, 4.0) / (1.0 + (distances / scale) ** 2) ** 2
        weighted = design * weights
        normal = weighted @ design.T
        right = weighted @ distances
        hold = 6.0 / (outline.free * radius) ** 2
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
    place: tuple[float, float, float, float],
    radius: float,
    *,
    distances: Array,
    heights: Array,
    noise: float,
) -> Rim:
    """Return the disc with how much speaks for it."""
    x, y, dx, dy = place
    inside = (along > 0.45 * radius) & (along < 0.85 * radius)
    inner = alike[:, inside].mean(axis=1)
    agree = (np.abs(distances) < max(AGREES_PX, AGREES * radius)) & (heights > STEEP * noise + LEAST_LEVELS)
    agree &= inner > 0.4
    spread = float(np.sqrt((distances[agree] ** 2).mean())) if agree.any() else float("nan")
    filled = float(inner.mean())
    return Rim(x + dx, y + dy, radius, float(agree.mean()), filled, spread)
