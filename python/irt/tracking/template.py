"""A marble's appearance, learned from views of it, and where in that its middle is.

Views are laid over each other by the appearance learned so far, which is then learned anew. So they come to
lie exactly over each other, wherever the marble's light, its shadow and what it mirrors have their middle.
Where the marble has its own is shown roughly by what it covers (`irt.tracking.coverage`), and exactly by its
rims (`irt.tracking.rims`), or by its shading where it looks like the board (`irt.tracking.shading`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.tracking.appearance import FINE, REACH, Appearance, Values
from irt.tracking.coverage import Coverage, Laid
from irt.tracking.opencv import opencv
from irt.tracking.rims import HUE, Disc, discs_by_rims, light_of
from irt.tracking.shading import BY_SHAPE, COVERS, SHADED, Shaded, ball_by_shading, thrown

Array = NDArray[np.float64]

#: Rounds of laying views over each other, and of learning from them.
ROUNDS = 5
#: Views that fit less well than this show something before the marble.
FITS = 0.5
#: Scatters at which a view's pixel begins to lose its say.
LETS_GO = 3.0
#: The median of a third of chi-square with three degrees of freedom.
MIDDLE = 0.79
#: Greatest share of the board's light that is seen: what mirrors may add to it.
MOST_PASSED = 1.2
#: A cell whose board varies by less than this over the views does not show what share of it is seen [levels].
VARIES = 6.0
#: A cell scatters as much as the marble's moving by so much would make it [pixels]: pixels are coarse.
SMEARED = 0.2
#: An appearance is blurred by this much [pixels]: where each pixel is all marble or none, views that lie on
#: the grid of the pixels would fit each other best.
SOFT = 0.35
#: A marble whose hue is nearer to the board's than this looks like it [levels]: glass differs by 10.
ALIKE_HUE = 5.0
#: Standard error of a middle by rims if the marble mirrors the board: rims of hue count little then, those of
#: light only outside of shadows [radii]. For six marbles of steel in path-traced rooms it is 0.11.
MIRRORS = 0.1
#: Rims are led to another disc where they are led to a middle that is so far away [radii].
ANOTHER = 0.02


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


def learn_appearance(
    views: Sequence[View],
    radius: float,
    expected: float,
    noise: float,
    foot: tuple[float, float] = (0.0, 0.0),
    *,
    plain: tuple[Sequence[View], float] | None = None,
    bare: bool = False,
) -> Appearance:
    """Return what a marble looks like.

    Parameters
    ----------
    views : sequence of View
        Of one marble in different places.
    radius, expected : float
        As views show it, and as sizes of board and marble say, where the scale is 1 [pixels].
    noise : float
        Standard deviation of a colour [levels].
    foot : (dx, dy)
        Where a marble touches the board, beside its middle in a picture, on average [radii].
    plain : (sequence of View, float), optional
        The same views as the camera took them, and their noise, where the contrast of `views` was changed:
        light and its shadows are found in these.
    bare : bool
        Whether the board has no grain: then a shadow covers it as a marble does.
    """
    centres = starts = np.array([[view.x, view.y] for view in views])
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
        # Where all move alike the appearance would, too: its middle is found below.
        moved = moved - np.median((moved - centres)[trust > 0], axis=0)
        centres = np.where(trust[:, None] > 0, moved, centres)
    taken, level = plain or (views, noise)
    # Steel mirrors the board at its rim and appears smaller than it is.
    stack = _Stack.of(taken, centres, max(radius, expected))
    covers = stack.coverage(trust, level).sized(radius, expected)
    disc = _disc(stack, trust, covers, level, foot, bare=bare)
    dx, dy, found = disc.x, disc.y, disc.radius
    scales = np.array([view.scale for view in views])
    centres = centres + np.outer(scales, [dx, dy])
    appearance = _Stack.of(views, centres, found).appearance(trust, found, noise)
    shift = np.median(((centres - starts) / scales[:, None])[trust > 0], axis=0)
    return replace(appearance, apart=disc.apart, error=disc.error, shift=(float(shift[0]), float(shift[1])))


@dataclass(frozen=True)
class _Disc:
    """The marble's disc from the middle of the views [pixels].

    `apart` is how far two estimates of its middle are apart, `error` that of one that rims do not show on all
    sides.
    """

    x: float
    y: float
    radius: float
    apart: float
    error: float = 0.0


def _disc(
    stack: _Stack, trust: Array, covers: Laid, noise: float, foot: tuple[float, float], *, bare: bool
) -> _Disc:
    """Return the marble's disc."""
    usual, board = stack.mean(trust), stack.mean_board(trust)

    @functools.cache
    def shaded(about: Laid) -> Shaded:
        return ball_by_shading(light_of(usual), light_of(board), about, foot)

    rims = _by_rims(discs_by_rims(usual, board, covers, noise), covers, shaded)
    hidden = MIRRORS * covers.radius
    if rims.hue >= ALIKE_HUE:
        apart = float(np.hypot(rims.x - covers.x, rims.y - covers.y))
        if rims.hue >= HUE or shaded(covers).matt:
            return _Disc(rims.x, rims.y, rims.radius, apart)
        if bare:
            # A shadow on a bare board has rims, too, and covers as much.
            shape = _by_shape(stack, trust, covers.radius, foot)
            apart = max(apart, float(np.hypot(rims.x - shape.x, rims.y - shape.y)))
        return _Disc(rims.x, rims.y, rims.radius, apart, hidden)
    near = COVERS * covers.radius
    error = 0.0
    if bare:
        # The shadow covers as much as the ball: the shape of the two says more.
        covers = _by_shape(stack, trust, covers.radius, foot)
        rims = _by_rims(discs_by_rims(usual, board, covers, noise), covers, shaded)
        error = BY_SHAPE * covers.radius
    ball = shaded(covers)
    apart = float(np.hypot(ball.x - covers.x, ball.y - covers.y))
    if not ball.matt and not (bare and apart < near):
        apart = float(np.hypot(rims.x - covers.x, rims.y - covers.y))
        return _Disc(rims.x, rims.y, rims.radius, apart, max(error, hidden))
    if apart > near and not bare:
        shape = _by_shape(stack, trust, covers.radius, foot)
        apart, error = (
            min(apart, float(np.hypot(ball.x - shape.x, ball.y - shape.y))),
            BY_SHAPE * covers.radius,
        )
    return _Disc(ball.x, ball.y, covers.radius, apart, error)


def _by_rims(found: Sequence[tuple[float, Disc]], covers: Laid, shaded: Callable[[Laid], Shaded]) -> Disc:
    """Return the disc of `discs_by_rims`; if rims lead to two, a ball and its shadow decide, too."""
    (_, one), (_, other) = found
    if np.hypot(one.x - other.x, one.y - other.y) > ANOTHER * covers.radius:
        ball = shaded(covers)
        size = SHADED * covers.radius
        found = [
            (missed + ((rim.x - ball.x) ** 2 + (rim.y - ball.y) ** 2) / size**2, rim) for missed, rim in found
        ]
    return min(found, key=lambda one: one[0])[1]


def _by_shape(stack: _Stack, trust: Array, radius: float, foot: tuple[float, float]) -> Laid:
    """Return the disc that ball and shadow show together."""
    x, y = thrown(*stack.trusted(trust), FINE * radius, foot).ball
    return Laid(x * radius, y * radius, radius, 0.0)


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

    def trusted(self, trust: Array) -> tuple[Values, Values]:
        """Return the pictures and boards (v, n, n, 3) of the views that fit."""
        return self.pictures[trust > 0], self.boards[trust > 0]

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
