"""A marble's appearance, learned from views of it, and where in that its middle is.

Views are laid over each other by the appearance learned so far, which is then learned anew. So they come to
lie exactly over each other, wherever the marble's light, its shadow and what it mirrors have their middle.
Where the marble has its own is shown roughly by what it covers (`irt.tracking.coverage`), and exactly by its
rim. On the side of its shadow the steepest change may lie outside of that. So a disc is laid through those
rays outside of which the board has its light, and through the rim of what is no shadow by its hue.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.tracking.appearance import FINE, REACH, Appearance, Values
from irt.tracking.coverage import Coverage, Laid
from irt.tracking.edge_fit import COS, RAYS, SIN, changes, look
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]

#: Rounds of laying views over each other, and of learning from them.
ROUNDS = 5
#: From levels to light, as in sRGB. A lens blurs light: the steepest change of levels is on the dark side.
POWER = 2.2
#: Views that fit less well than this show something before the marble.
FITS = 0.5
#: Scatters at which a view's pixel begins to lose its say.
LETS_GO = 3.0
#: The median of a third of chi-square with three degrees of freedom.
MIDDLE = 0.79
#: Greatest share of the board's light that is seen: what mirrors may add to it.
MOST_PASSED = 1.2
#: A cell whose board varies by less than this over the views does not tell what share of it is seen [levels].
VARIES = 6.0
#: A cell scatters as much as the marble's moving by so much would make it [pixels]: pixels are coarse.
SMEARED = 0.2
#: An appearance is blurred by this much [pixels]: where each pixel is all marble or none, views that lie on
#: the grid of the pixels would fit each other best.
SOFT = 0.35
#: Light outside a ray over that without a marble: in shadow below the first, in full light above the second.
DIM, LIT = 0.86, 0.96
#: Distances of the mean rays' samples, in radii.
PARTS = np.arange(0.4, 1.65, 0.04)
#: The rim is looked for from here on, in radii.
RIM_FROM = 0.7
#: Where a ray is inside and outside of the rim, and where the board beside it is, in radii.
INSIDE, OUTSIDE, BESIDE = (0.78, 0.92), (1.08, 1.22), (1.1, 1.35)
#: Where a ray has the hue of the marble, in radii.
NEAR_RIM = (0.7, 0.86)
#: A difference in hue that shows where the rim is [levels], what rays count by it beside those in full light,
#: and the part of it at which they leave the marble.
HUE, HUE_COUNTS, LEAVES = 40.0, 1.5, 0.4
#: Rays to either side of a shadow that are not trusted either.
NEAR_SHADOW = 2
#: How far a radius may be from what board and marble say (standard deviation, as a share).
KNOWN = 0.03
#: How far rays are off the rim (standard deviation, as a share of the radius).
RIM_ERROR = 0.03
#: Neighbouring rays err alike: so many of them count as one.
TOGETHER = 8.0
#: How well the middle of what is covered is known (standard deviation, in radii): its error in 19 path-traced
#: runs (`docs/experiments.md`).
COVERS = 0.065


@dataclass(frozen=True, eq=False)
class View:
    """A marble in a part of a picture, as found so far.

    Attributes
    ----------
    picture, board : (h, w, 3) float32 arrays
        That part, and the board there without a marble [levels].
    x, y : float
        The marble's middle [pixels of that part].
    scale : float
        Its size over that of the appearance.
    """

    picture: Values
    board: Values
    x: float
    y: float
    scale: float


def learn_appearance(views: Sequence[View], radius: float, expected: float, noise: float) -> Appearance:
    """Return what a marble looks like.

    Parameters
    ----------
    views : sequence of View
        Of one marble in different places.
    radius, expected : float
        As views show it, and as sizes of board and marble say, where the scale is 1 [pixels].
    noise : float
        Standard deviation of a colour [levels].
    """
    centres = np.array([[view.x, view.y] for view in views])
    trust = np.ones(len(views))
    for _ in range(ROUNDS):
        stack = _Stack.of(views, centres, radius)
        appearance = stack.appearance(trust, radius, noise)
        matches = [
            appearance.match(view.picture, view.board, (float(x), float(y)), view.scale)
            for view, (x, y) in zip(views, centres, strict=True)
        ]
        trust = np.array([float(one.confidence > FITS) for one in matches])
        moved = np.array([[one.x, one.y] for one in matches])
        if trust.sum() < 3:
            return appearance
        # Where all move alike the appearance would, too: its middle is told below.
        moved = moved - np.median((moved - centres)[trust > 0], axis=0)
        centres = np.where(trust[:, None] > 0, moved, centres)
    covers = stack.coverage(trust, noise).sized(radius, expected)
    usual, without = _light(stack.mean(trust)), _light(stack.mean_board(trust))
    dx, dy, found = _disc(usual, without, covers, noise)
    scales = np.array([view.scale for view in views])
    centres = centres + np.outer(scales, [dx, dy])
    appearance = _Stack.of(views, centres, found).appearance(trust, found, noise)
    return replace(appearance, apart=float(np.hypot(dx - covers.x, dy - covers.y)))


@dataclass(frozen=True, eq=False)
class _Stack:
    """Views laid over each other: pictures and boards (v, n, n, 3), `FINE` samples to a pixel."""

    pictures: Values
    boards: Values

    @classmethod
    def of(cls, views: Sequence[View], centres: Array, radius: float) -> _Stack:
        half = int(np.ceil(REACH * radius * FINE))
        cut = [
            [_cut(one, (float(x), float(y)), half, view.scale) for one in (view.picture, view.board)]
            for view, (x, y) in zip(views, centres, strict=True)
        ]
        return cls(np.array([one for one, _ in cut]), np.array([board for _, board in cut]))

    def mean(self, trust: Array) -> Values:
        """Return the usual picture (n, n, 3)."""
        return np.asarray(np.median(self.pictures[trust > 0], axis=0), dtype=np.float32)

    def mean_board(self, trust: Array) -> Values:
        """Return the usual board without a marble (n, n, 3)."""
        return np.asarray(np.median(self.boards[trust > 0], axis=0), dtype=np.float32)

    def coverage(self, trust: Array, noise: float) -> Coverage:
        """Return what the views do to the board."""
        return Coverage.of(self.pictures[trust > 0], self.boards[trust > 0], noise, FINE)

    def appearance(self, trust: Array, radius: float, noise: float) -> Appearance:
        """Return what the views have in common, by a robust regression of pictures on boards in each cell."""
        pictures, boards = self.pictures[trust > 0], self.boards[trust > 0]
        before = self._passed(pictures, boards, radius)
        own, passed, usual, spread = _regressed(pictures, boards, before, noise)
        cv2 = opencv()
        layers = cv2.GaussianBlur(np.dstack([own, passed]).astype(np.float32), (0, 0), SOFT * FINE)
        slopes = [
            cv2.Sobel(usual.astype(np.float32), cv2.CV_32F, *way, scale=FINE / 8.0)
            for way in ((1, 0), (0, 1))
        ]
        steep = sum((one**2).sum(axis=2) for one in slopes) / 3.0
        variance = np.maximum(spread, noise**2) + SMEARED**2 * steep
        return Appearance(layers, (1.0 / variance).astype(np.float32), radius)

    def _passed(self, pictures: Values, boards: Values, radius: float) -> Array:
        """Return the share of the board to expect (n, n): none in the disc, outside what light there is."""
        half = pictures.shape[1] // 2
        down, right = np.mgrid[-half : half + 1, -half : half + 1] / FINE
        outside = np.clip((np.hypot(down, right) / radius - 0.95) / 0.15, 0.0, 1.0)
        picture, board = np.median(pictures, axis=0), np.median(boards, axis=0)
        light = (picture * board).sum(axis=2) / ((board**2).sum(axis=2) + 1.0)
        return np.asarray(outside * np.clip(light, 0.0, 1.0))


def _regressed(
    pictures: Values, boards: Values, before: Array, noise: float
) -> tuple[Array, Array, Array, Array]:
    """Return what views have in common, cell by cell.

    That is the marble's own light (n, n, 3), the share of the board's that is seen (n, n), the usual picture
    (n, n, 3), and the variance about these (n, n).

    Parameters
    ----------
    pictures, boards : (v, n, n, 3) arrays
        Views laid over each other [levels].
    before : (n, n) array
        The share to expect, where the board hardly varies from view to view.
    noise : float
        Standard deviation of a colour [levels].
    """
    passed = before
    own = np.median(pictures - passed[..., None] * boards, axis=0)
    for _ in range(4):
        left = pictures - passed[..., None] * boards - own
        square = np.einsum("vijk,vijk->vij", left, left) / 3.0
        scatter = np.maximum(np.median(square, axis=0) / MIDDLE, noise**2)
        weights = 1.0 / (1.0 + square / (LETS_GO**2 * scatter)) ** 2
        total = weights.sum(axis=0)
        mean, mean_board = (
            np.einsum("vij,vijk->ijk", weights, one) / total[..., None] for one in (pictures, boards)
        )
        apart, other = pictures - mean, boards - mean_board
        varied = np.einsum("vij,vijk,vijk->ij", weights, other, other)
        both = np.einsum("vij,vijk,vijk->ij", weights, other, apart)
        hold = 3.0 * VARIES**2 * total
        passed = np.clip((both + hold * before) / (varied + hold), 0.0, MOST_PASSED)
        own = mean - passed[..., None] * mean_board
    return own, passed, mean, (weights * square).sum(axis=0) / total


def _cut(layers: Values, centre: tuple[float, float], half: int, scale: float) -> Values:
    """Return a square about a centre (2 half + 1, 2 half + 1, 3), `FINE` samples to a pixel."""
    size = 2 * half + 1
    matrix = np.array(
        [
            [scale / FINE, 0.0, centre[0] - half * scale / FINE],
            [0.0, scale / FINE, centre[1] - half * scale / FINE],
        ]
    )
    cv2 = opencv()
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(layers, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cut, dtype=np.float32)


def _light(levels: Values) -> Values:
    """Return the light that makes levels, full light as 255."""
    return np.asarray(255.0 * (np.clip(levels, 0.0, 255.0) / 255.0) ** POWER, dtype=np.float32)


def _disc(mean: Values, without: Values, covers: Laid, noise: float) -> tuple[float, float, float]:
    """Return the marble's own disc in the usual light: its middle from that of the picture, its radius.

    All in pixels. It begins where the board is covered, and in the picture's middle; the disc is taken
    that rims and what is covered miss less. Two things set the marble off from its shadow. A shadow has
    the hue of the board: where marble and board differ in it, the rim of the hue is the marble's. And
    beside rays in full light there is no shadow. Each has a radius of its own, since shading and what
    mirrors move all rims alike; that of the second is the marble's.
    """
    half = len(mean) // 2
    discs = []
    for start in ((covers.x, covers.y), (0.0, 0.0)):
        disc = np.array([*start, covers.radius])
        missed = np.inf
        for _ in range(6):
            place, found = (half + FINE * disc[0], half + FINE * disc[1]), float(disc[2])
            rays, board = (look(one, *place, FINE * found * PARTS) for one in (mean, without))
            dx, dy, part, missed = _laid(rays, board, noise, covers.radius / found)
            disc = disc + 0.7 * found * np.array([dx, dy, part - 1.0])
        away = np.hypot(disc[0] - covers.x, disc[1] - covers.y) / covers.radius
        discs.append((missed / TOGETHER + (away / COVERS) ** 2, *disc.tolist()))
    _, x, y, found = min(discs)
    return x, y, found


def _laid(mean: Values, without: Values, noise: float, expected: float) -> tuple[float, float, float, float]:
    """Return offset and radius of the marble's disc in mean rays (RAYS, n, 3), in radii, and its misfit."""
    lit = _lit(mean, without)
    clear = np.min([np.roll(lit, turn) for turn in range(-NEAR_SHADOW, NEAR_SHADOW + 1)], axis=0)
    hue_rims, hue = _hue_rims(mean, without)
    found = ~np.isnan(hue_rims)
    measured = np.concatenate(
        [np.where(found, hue_rims, 1.0), _rims(_changes(mean, _directions(mean), noise))]
    )
    trust = np.concatenate([HUE_COUNTS * (hue / (hue + HUE)) ** 2 * found, clear]) + 1e-3
    one, none = np.ones(RAYS), np.zeros(RAYS)
    design = np.stack([np.tile(COS, 2), np.tile(SIN, 2), np.append(one, none), np.append(none, one)])
    answer = np.array([0.0, 0.0, float(np.median(measured[:RAYS])), expected])
    hold = TOGETHER * (RIM_ERROR / KNOWN) ** 2
    for _ in range(15):
        apart = measured - answer @ design
        weights = trust / (1.0 + (apart / RIM_ERROR) ** 2) ** 2
        normal = (design * weights) @ design.T + 1e-6 * np.eye(4)
        right = (design * weights) @ apart
        normal[3, 3] += hold
        right[3] += hold * (expected - answer[3])
        answer = answer + np.linalg.solve(normal, right)
    square = ((measured - answer @ design) / RIM_ERROR) ** 2
    misfit = float((trust * square / (1.0 + square)).sum())
    return float(answer[0]), float(answer[1]), float(answer[3]), misfit


def _changes(mean: Values, directions: Values, noise: float) -> Values:
    """Return the squared changes of mean rays (RAYS, n - 2) along one direction of colour for each."""
    told = np.matmul(mean[:, :, :3], directions[:, :, None])
    # What mirrors the sky in its middle is nearer to the board there than at its rim.
    told[:, PARTS < RIM_FROM] = told[:, [int(np.searchsorted(PARTS, RIM_FROM))]]
    return changes(np.maximum.accumulate(told, axis=1), noise)


def _between(rays: Values, ends: tuple[float, float]) -> Array:
    """Return the mean colour (RAYS, 3) of a part of the rays."""
    part = (ends[0] <= PARTS) & (ends[1] >= PARTS)
    return np.asarray(rays[:, part, :3].mean(axis=1), dtype=np.float64)


def _directions(mean: Values) -> Values:
    """Return the change from inside to outside (RAYS, 3), of length 1."""
    change = _between(mean, OUTSIDE) - _between(mean, INSIDE)
    # Neighbours look alike: what is left of the noise must not turn a faint change.
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
    inside = hue[:, (NEAR_RIM[0] < PARTS) & (NEAR_RIM[1] > PARTS)].mean(axis=1)
    outside = hue[:, BESIDE[1] < PARTS].mean(axis=1)
    level = outside + LEAVES * (inside - outside)
    first = int(np.searchsorted(PARTS, NEAR_RIM[1])) - 2
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


def _rims(steps: Values) -> Array:
    """Return where each mean ray changes most (RAYS,), in radii."""
    places = PARTS[1:-1]
    near = steps * np.exp(-0.5 * ((places - 1.0) / 0.2) ** 2)
    peaks = places[np.argmax(near, axis=1)]
    for _ in range(3):
        window = np.exp(-0.5 * ((places - peaks[:, None]) / 0.12) ** 2) * steps
        peaks = (window @ places + 1e-9 * peaks) / (window.sum(axis=1) + 1e-9)
    return np.asarray(peaks, dtype=np.float64)
