"""Whether a disc that moves is the marble or its shadow: only a shadow lets the board's texture be seen.

Views of the disc are laid over each other by their middles. In each cell, what does not change from view to
view is the disc's own; the rest is regressed on the board's texture there,

    picture(p) - mean = transmission  light  (board(p) - mean)

with transmission 1 in a shadow, whose light is the ratio of the two means, and 0 where something opaque
covers the board. Where the board has no texture, the regression says so by its standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.edge_fit import Values
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]

#: Cells to a radius.
CELLS = 6
#: How far from the disc's middle something opaque is looked for, in radii: a lamp that stands 20 degrees
#: above the board throws the shadow of a ball's middle 1/tan(20 degrees) = 2.7 radii aside.
ASIDE = 2.75
#: What is seen of the neighbourhood, in radii.
REACH = ASIDE + 1.0
#: Added to levels, which makes the curve of sRGB a power of the light [levels].
BLACK = 0.055 * 255.0
#: Part of the disc that is looked at, in radii: its rim is blurred.
INNER = 0.8
#: Halfway between opaque and clear.
HALF = 0.5
#: Logarithm of levels by which less light may change one colour more than another. Where a lamp of 2,700 K is
#: blocked and the sky's 6,500 K are left, red falls to a third of what blue does, and levels are light to the
#: power 1/2.4.
TINTED = np.log(3.0) / 2.4
#: Logarithm of levels by which light that is reflected by the marble may outdo what it blocks.
BRIGHTER = 0.05
#: Samples that err alike: cells are about half a pixel wide and interpolated, colours share their grain.
ALIKE = 12.0
#: Variance of a whole level about the light [levels^2].
ROUNDED = 1.0 / 12.0
#: Standard errors that a decision needs.
SURE = 3.0


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """A disc and what is around it in a picture.

    Attributes
    ----------
    picture, board : (h, w, 3) float32 arrays
        A part of a picture, and the board there without a marble [levels].
    x, y, radius : float
        The disc [pixels of that part].
    """

    picture: Values
    board: Values
    x: float
    y: float
    radius: float


@dataclass(frozen=True, eq=False)
class Transmission:
    """How much of the board's texture is seen through discs about the middle of neighbourhoods.

    Attributes
    ----------
    share, error : (n, n) arrays
        For a disc about each cell: 0 opaque, 1 clear, and its standard error.
    change : (3,) array
        Logarithm of levels in the disc in the middle over those of the board.
    """

    share: Array
    error: Array
    change: Array

    @property
    def middle(self) -> float:
        """The share that is seen through the disc in the middle."""
        return float(self.share[len(self.share) // 2, len(self.share) // 2])

    @property
    def is_no_shadow(self) -> bool:
        """Whether the disc in the middle has another hue than a shadow can have, or is brighter."""
        return bool(np.ptp(self.change) > TINTED or self.change.max() > BRIGHTER)

    @property
    def chance_of_shadow(self) -> float:
        """The chance that the disc in the middle is a shadow, from 0 to 1; a half where nothing says.

        What has another hue than the board, or is brighter, is no shadow, with or without texture.
        """
        from scipy.special import ndtr  # noqa: PLC0415

        if self.is_no_shadow:
            return 0.0
        error = self.error[len(self.error) // 2, len(self.error) // 2]
        return float(ndtr((self.middle - HALF) / error))

    def opaque(self) -> tuple[float, float] | None:
        """Return the offset (dx, dy) of what is surely opaque [radii], None where nothing is."""
        half = len(self.share) // 2
        down, right = np.mgrid[-half : half + 1, -half : half + 1] / CELLS
        # A disc that is opaque in half of its area is half clear: the whole of it lies where least is seen.
        surely = np.where(np.hypot(down, right) <= ASIDE, self.share + SURE * self.error, np.inf)
        row, column = np.unravel_index(int(np.argmin(surely)), surely.shape)
        if surely[row, column] > HALF:
            return None
        return float(right[row, column]), float(down[row, column])


def transmission(neighbourhoods: Sequence[Neighbourhood]) -> Transmission:
    """Return what is seen through discs in all of some neighbourhoods."""
    pictures = _logarithms([_cut(one.picture, one) for one in neighbourhoods])
    boards = _logarithms([_cut(one.board, one) for one in neighbourhoods])
    # What does not change from view to view is the disc's own.
    textures, grounds = pictures - pictures.mean(axis=0), boards - boards.mean(axis=0)
    inner = _disc()
    whole, both, ground = (
        np.sum([_covariance(one, other, inner) for one, other in zip(first, second, strict=True)], axis=0)
        for first, second in ((textures, textures), (textures, grounds), (grounds, grounds))
    )
    share = both / (ground + 1e-9)
    count = max(len(textures) - 1, 1) * 3.0 * inner.sum()
    rounded = ROUNDED * float(np.exp(-2.0 * boards).mean())
    left = np.maximum((whole - share * both) / count, rounded)
    half = pictures.shape[1] // 2
    middle = slice(half - CELLS, half + CELLS + 1)
    apart = np.median(pictures - boards, axis=0)[middle, middle]
    # Levels are whole: a texture that is only rounded off shows nothing.
    error = np.sqrt(ALIKE * left / np.maximum(ground - count * rounded, 1e-9 * rounded))
    # Most of the neighbourhood is clear. Where the board shows less than itself there, its texture is noise.
    clear = float(np.median(share))
    error = np.hypot(error, 1.48 * float(np.median(np.abs(share - clear))))
    if clear < SURE * float(np.median(error)):
        # Not even the open board shows a texture.
        share, error, clear = np.full_like(share, HALF), np.full_like(error, np.inf), 1.0
    return Transmission(share / clear, error / clear, np.median(apart[inner > 0], axis=0))


def cut_out(neighbourhoods: Sequence[Neighbourhood]) -> tuple[Values, Values]:
    """Return pictures and boards (v, n, n, 3), `CELLS` to a radius, discs in their middle."""
    return (
        np.array([_cut(one.picture, one) for one in neighbourhoods]),
        np.array([_cut(one.board, one) for one in neighbourhoods]),
    )


def _cut(layers: Values, one: Neighbourhood) -> Values:
    """Return a square about a disc (n, n, 3), `CELLS` to its radius."""
    half = int(np.ceil(REACH * CELLS))
    step = one.radius / CELLS
    matrix = np.array([[step, 0.0, one.x - half * step], [0.0, step, one.y - half * step]])
    cv2 = opencv()
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = 2 * half + 1
    # Finer than cells is what they would alias.
    smooth = cv2.GaussianBlur(layers, (0, 0), 0.5 * step) if step > 1.0 else layers
    cut = cv2.warpAffine(smooth, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cut, dtype=np.float32)


def _logarithms(views: Sequence[Values]) -> Values:
    """Return the logarithm of levels (v, n, n, 3), in which less light is a constant."""
    return np.asarray(np.log(np.maximum(np.array(views), 0.0) + BLACK), dtype=np.float32)


def _disc() -> Values:
    down, right = np.mgrid[-CELLS : CELLS + 1, -CELLS : CELLS + 1]
    return np.asarray(np.hypot(down, right) <= INNER * CELLS, dtype=np.float32)


def _covariance(one: Values, other: Values, inner: Values) -> Array:
    """Return a sum of products over the disc about each cell (n, n), of deviations from that disc's means."""
    products = _pooled(one * other, inner).sum(axis=2)
    means = (_pooled(one, inner) * _pooled(other, inner)).sum(axis=2) / inner.sum()
    return np.asarray(products - means)


def _pooled(cells: Values, inner: Values) -> Array:
    """Return the sum over the disc about each cell (n, n, 3)."""
    summed = opencv().filter2D(cells, -1, inner, borderType=opencv().BORDER_REPLICATE)
    return np.asarray(summed, dtype=np.float64)
