"""The marble's own disc in its usual picture, by its rims.

Rays from a middle meet three rims. A shadow has the hue of the board: where marble and board differ in it, a
rim of hue is the marble's, on the side of its shadow, too. Beside rays in full light there is no shadow:
there a rim is where the light changes most, and where a step that the lens blurs explains the rays best. What
mirrors the board at its rim (steel) has its steepest change elsewhere; a step that is laid between a slope
inside and the bare board outside is not led there. Each kind of rim has a radius of its own, since shading
and what mirrors move all rims of a kind alike; that of the steepest light is the marble's.

A lens blurs light, so that rims of light are looked for in light. Hue runs out over the bright board where a
codec halves its resolution or levels are cut off; in light that little outweighs the marble's own. Rims of
hue are looked for in levels (measured: `docs/experiments.md`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.appearance import FINE, Values
from irt.tracking.coverage import Laid
from irt.tracking.edge_fit import COS, RAYS, SIN, changes, look
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]

#: From levels to light, as in sRGB.
POWER = 2.2
#: Light outside a ray over that without a marble: in shadow below the first, in full light above the second.
DIM, LIT = 0.86, 0.96
#: Distances of the mean rays' samples, in radii.
PARTS = np.arange(0.4, 1.65, 0.04)
#: The rim is looked for from here on, in radii.
RIM_FROM = 0.7
#: Where a ray is inside and outside of the rim, and where the board beside it is, in radii.
INSIDE, OUTSIDE, BESIDE = (0.78, 0.92), (1.08, 1.22), (1.1, 1.35)
#: Where a ray has the hue of the marble, in radii: nearer to the rim, blur would take of it where the disc is
#: laid wrongly, and the rim would go along with the disc.
WITHIN = (0.5, 0.76)
#: A difference in hue that shows where the rim is [levels], what rays count by it beside those in full light,
#: and the part of it at which they leave the marble.
HUE, HUE_COUNTS, LEAVES = 40.0, 1.5, 0.5
#: Rays to either side of a shadow that are not trusted either.
NEAR_SHADOW = 2
#: How far the radius of the steepest light, and that of blurred steps, may be from what board and marble say
#: (standard deviation, as a share): the second depends on how much is blurred.
KNOWN, KNOWN_STEP = 0.03, 0.08
#: How far rays are off the rim (standard deviation, as a share of the radius).
RIM_ERROR = 0.03
#: Neighbouring rays err alike: so many of them count as one.
TOGETHER = 8.0
#: How well the middle of what is covered is known (standard deviation, in radii): its error along each axis
#: is half of that in 41 runs, and twice as much on a board without a grain (`docs/experiments.md`).
COVERS = 0.1
#: What lens, pixels, and laying them over each other blur (standard deviation) [pixels].
BLUR = 0.9
#: Blurred steps are laid through rays from here to there, and looked for so far from the rim, in such steps
#: [radii]; a rim at either end is none.
STEP_FROM, STEP_TO, STEP_REACH, STEP = 0.86, 1.45, 0.2, 0.0125
#: Rounds in which the disc follows its rims, and the share of a move that each makes.
ROUNDS, MOVE = 6, 0.7


@dataclass(frozen=True)
class Disc:
    """A marble's disc in its usual picture.

    Attributes
    ----------
    x, y, radius : float
        Its middle from that of the picture, and its radius [pixels].
    hue : float
        How far the marble's hue is from the board's [levels].
    """

    x: float
    y: float
    radius: float
    hue: float


@dataclass(frozen=True, eq=False)
class _Pictures:
    """The usual picture and the board there without a marble (n, n, 3), in light and in levels."""

    light: Values
    board_light: Values
    levels: Values
    board_levels: Values


def light_of(levels: Values) -> Values:
    """Return the light that makes levels, full light as 255."""
    return np.asarray(255.0 * (np.clip(levels, 0.0, 255.0) / 255.0) ** POWER, dtype=np.float32)


def discs_by_rims(usual: Values, board: Values, covers: Laid, noise: float) -> list[tuple[float, Disc]]:
    """Return the discs that rims are led to, each after its misfit, minus twice a logarithm of a likelihood.

    Parameters
    ----------
    usual, board : (n, n, 3) float32 arrays
        The usual picture, and the usual board without a marble, `FINE` samples to a pixel [levels].
    covers : Laid
        What the marble covers. The rims are followed from there, and from the picture's middle.
    noise : float
        Standard deviation of a colour [levels].
    """
    pictures = _Pictures(light_of(usual), light_of(board), usual, board)
    found = []
    for start in ((covers.x, covers.y), (0.0, 0.0)):
        disc = Disc(*start, covers.radius, 0.0)
        for _ in range(ROUNDS):
            missed, disc = _followed(pictures, disc, covers.radius, noise)
        away = np.hypot(disc.x - covers.x, disc.y - covers.y) / covers.radius
        found.append((missed / TOGETHER + (away / COVERS) ** 2, disc))
    return found


def _followed(pictures: _Pictures, disc: Disc, known: float, noise: float) -> tuple[float, Disc]:
    """Return the misfit of the rims about a disc, and the disc moved towards them."""
    half = len(pictures.light) // 2
    place, part = (half + FINE * disc.x, half + FINE * disc.y), disc.radius
    light, board, levels, board_levels = (
        look(one, *place, FINE * part * PARTS)
        for one in (pictures.light, pictures.board_light, pictures.levels, pictures.board_levels)
    )
    lit = _lit(light, board)
    clear = np.min([np.roll(lit, turn) for turn in range(-NEAR_SHADOW, NEAR_SHADOW + 1)], axis=0)
    hue_rims, hue = _hue_rims(levels, board_levels)
    seen = ~np.isnan(hue_rims)
    step_rims, inner = _step_rims(pictures, disc)
    expected = known / part
    measured = np.concatenate(
        [
            np.where(seen, hue_rims, 1.0),
            _steepest(_changes(light, _directions(light), noise)),
            step_rims,
        ]
    )
    trust = np.concatenate([HUE_COUNTS * (hue / (hue + HUE)) ** 2 * seen, clear, clear * inner]) + 1e-3
    dx, dy, size, misfit = _circle(measured, trust, expected)
    moved = Disc(disc.x + MOVE * part * dx, disc.y + MOVE * part * dy, part * (1 + MOVE * (size - 1)), hue)
    return misfit, moved


def _circle(measured: Array, trust: Array, expected: float) -> tuple[float, float, float, float]:
    """Return offset and radius of a disc through rims [radii], and their misfit.

    Parameters
    ----------
    measured, trust : (3 RAYS,) arrays
        Rims of hue, steepest light and blurred steps [radii], and what each counts.
    expected : float
        The radius that board and marble say [radii].
    """
    kinds = np.repeat(np.eye(3), RAYS, axis=1)
    design = np.vstack([np.tile(COS, 3), np.tile(SIN, 3), kinds])
    answer = np.array([0.0, 0.0, float(np.median(measured[:RAYS])), expected, expected])
    hold = TOGETHER * RIM_ERROR**2 / np.array([np.inf, KNOWN, KNOWN_STEP]) ** 2
    for _ in range(15):
        apart = measured - answer @ design
        weights = trust / (1.0 + (apart / RIM_ERROR) ** 2) ** 2
        normal = (design * weights) @ design.T + np.diag([1e-6, 1e-6, *(hold + 1e-6)])
        right = (design * weights) @ apart
        right[2:] += hold * (expected - answer[2:])
        answer = answer + np.linalg.solve(normal, right)
    square = ((measured - answer @ design) / RIM_ERROR) ** 2
    misfit = float((trust * square / (1.0 + square)).sum())
    return float(answer[0]), float(answer[1]), float(answer[3]), misfit


def _step_rims(pictures: _Pictures, disc: Disc) -> tuple[Array, NDArray[np.bool_]]:
    """Return where a blurred step explains each ray best (RAYS,) [radii], and whether one does.

    Inside is a slope of its own in each colour, outside the board in a light of its own.
    """
    half = len(pictures.light) // 2
    parts = np.arange(STEP_FROM, STEP_TO, 0.5 / (FINE * disc.radius))
    place = half + FINE * disc.x, half + FINE * disc.y
    rays, board = (
        np.asarray(look(one, *place, FINE * disc.radius * parts), dtype=np.float64)
        for one in (pictures.light, pictures.board_light)
    )
    rims = np.arange(1.0 - STEP_REACH, 1.0 + STEP_REACH + 0.5 * STEP, STEP)
    left = np.array([_left_by_step(rays, board, disc.radius * (parts - rim)) for rim in rims])
    best = np.argmin(left, axis=0)
    inner = (best > 0) & (best < len(rims) - 1)
    rows, middle = np.arange(RAYS), np.clip(best, 1, len(rims) - 2)
    before, least, after = (left[middle + one, rows] for one in (-1, 0, 1))
    bend = before + after - 2.0 * least
    shift = np.where(bend > 0.0, 0.5 * (before - after) / np.where(bend > 0.0, bend, 1.0), 0.0)
    return rims[middle] + STEP * np.clip(shift, -0.5, 0.5), inner


def _left_by_step(rays: Array, board: Array, away: Array) -> Array:
    """Return what a step leaves of rays (RAYS, n, 3), by samples' distances (n,) from it: squares (RAYS,)."""
    from scipy.special import ndtr  # noqa: PLC0415

    outside = ndtr(away / BLUR)
    slope = away * (1.0 - outside) - BLUR * np.exp(-0.5 * (away / BLUR) ** 2) / np.sqrt(2.0 * np.pi)
    flat = np.ones_like(board)
    design = np.stack(
        [(1.0 - outside)[None, :, None] * flat, slope[None, :, None] * flat, outside[None, :, None] * board],
        axis=-1,
    )
    normal = np.einsum("rnci,rncj->rcij", design, design)
    right = np.einsum("rnci,rnc->rci", design, rays)
    three = np.arange(3)
    normal[..., three, three] += 1e-6 * np.trace(normal, axis1=2, axis2=3)[..., None]
    answer = np.linalg.solve(normal, right[..., None])[..., 0]
    return np.asarray((rays**2).sum(axis=(1, 2)) - (answer * right).sum(axis=(1, 2)))


def _changes(mean: Values, directions: Values, noise: float) -> Values:
    """Return the squared changes of mean rays (RAYS, n - 2) along one direction of colour for each."""
    along = np.matmul(mean[:, :, :3], directions[:, :, None])
    # What mirrors the sky in its middle is nearer to the board there than at its rim.
    along[:, PARTS < RIM_FROM] = along[:, [int(np.searchsorted(PARTS, RIM_FROM))]]
    return changes(np.maximum.accumulate(along, axis=1), noise)


def _between(rays: Values, ends: tuple[float, float]) -> Array:
    """Return the mean colour (RAYS, 3) of a part of the rays."""
    part = (ends[0] <= PARTS) & (ends[1] >= PARTS)
    return np.asarray(rays[:, part, :3].mean(axis=1), dtype=np.float64)


def _directions(mean: Values) -> Values:
    """Return the change from inside to outside (RAYS, 3), of length 1."""
    change = _between(mean, OUTSIDE) - _between(mean, INSIDE)
    # Neighbours look alike: the noise that remains must not turn a faint change.
    change = np.mean([np.roll(change, turn, axis=0) for turn in (-1, 0, 1)], axis=0)
    return _normed(change)


def _hue_rims(mean: Values, without: Values) -> tuple[Array, float]:
    """Return where each mean ray leaves the marble's hue (RAYS,), NaN where none does, and how clear that is.

    Less light moves a colour towards black, along the board's own colour: across that, a shadow has no rim.
    """
    board = without.astype(np.float64)
    board = board / (np.linalg.norm(board, axis=2, keepdims=True) + 1e-9)
    across = mean - (mean * board).sum(axis=2, keepdims=True) * board
    inner = across[:, (PARTS > 0.5) & (PARTS < 0.85)].mean(axis=(0, 1))
    clear = float(np.linalg.norm(inner))
    hue = opencv().GaussianBlur(across @ (inner / (clear + 1e-9)), (3, 1), 0)
    inside = hue[:, (WITHIN[0] < PARTS) & (WITHIN[1] > PARTS)].mean(axis=1)
    outside = hue[:, BESIDE[1] < PARTS].mean(axis=1)
    level = outside + LEAVES * (inside - outside)
    first = int(np.searchsorted(PARTS, WITHIN[1])) - 2
    below = hue[:, first:-1] < level[:, None]
    after = first + np.argmax(below, axis=1)
    rows = np.arange(RAYS)
    before, there = hue[rows, after - 1], hue[rows, after]
    place = PARTS[after] - (PARTS[1] - PARTS[0]) * (level - there) / (before - there + 1e-9)
    return np.where(below.any(axis=1) & (after > first), place, np.nan), clear


def _normed(vectors: Array) -> Values:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=1, keepdims=True) + 1e-9), dtype=np.float32)


def _lit(mean: Values, without: Values) -> Array:
    """Return from 0 to 1 whether the board outside a ray has its light (RAYS,)."""
    light = _between(mean, BESIDE).sum(axis=1) / (_between(without, BESIDE).sum(axis=1) + 1.0)
    light /= np.quantile(light, 0.8)
    return np.asarray(np.clip((light - DIM) / (LIT - DIM), 0.0, 1.0))


def _steepest(steps: Values) -> Array:
    """Return where each mean ray changes most (RAYS,), in radii."""
    places = PARTS[1:-1]
    near = steps * np.exp(-0.5 * ((places - 1.0) / 0.2) ** 2)
    peaks = places[np.argmax(near, axis=1)]
    for _ in range(3):
        window = np.exp(-0.5 * ((places - peaks[:, None]) / 0.12) ** 2) * steps
        peaks = (window @ places + 1e-9 * peaks) / (window.sum(axis=1) + 1e-9)
    return np.asarray(peaks, dtype=np.float64)
