"""What a marble and its shadow do to the board's picture, and where a picture shows that.

About the marble's middle each pixel is the marble's own light and a share of the board's behind it,

    picture(p) = gain [ own(p - c) + passed(p - c) board(p) ]

with `passed` 0 where the marble covers the board, 1 far from it, and between these in its shadow. Both are
learned (`irt.tracking.template`), with how much pictures scatter about them. The middle c is found by least
squares over all pixels about it (Lucas and Kanade, 1981), with weights that let go of what does not fit: a
finger before the marble, the mirror image of a lamp that has moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Values = NDArray[np.float32]

#: Samples of an appearance to a pixel.
FINE = 2
#: It reaches so far from the middle, in radii.
REACH = 1.5
#: Residuals at which a pixel begins to lose its say, in scatters, round by round: from a start that may be
#: a radius off, where every pixel of the rim disagrees, to the last.
LETS_GO = (30.0, 10.0, 6.0, 5.0, 5.0)
#: From this of them on, a start that fits less well than this is given up.
HOPELESS_AT, HOPELESS = LETS_GO[2], 0.25
#: A move smaller than this ends the rounds, once the last limit is reached [pixels].
STILL = 0.02
#: The longest move of a round, and of all, in radii.
LONGEST, FARTHEST = 0.5, 1.5
#: Least and greatest light, over that of the appearance.
LIGHT = (0.75, 1.3)
#: Standard deviation of the light from picture to picture, as a share.
GAIN = 0.15
#: Pixels of a marble agree with their picture within about so many scatters.
AGREES = 2.5
#: A pixel shows the marble if that differs from the board by more than so many scatters.
DISTINCT = 1.0
#: Within so many radii pixels are the marble's, for its confidence.
WITHIN = 1.05
#: A disc whose pixels show this much of a marble on average may as well be none.
FAINT = 0.1


@dataclass(frozen=True)
class Match:
    """A marble as found.

    Attributes
    ----------
    x, y : float
        Its middle [pixels].
    confidence : float
        The share, from 0 to 1, of its difference from the board behind it that the picture shows.
    spread : float
        Standard error of the middle, along the worse direction [pixels].
    """

    x: float
    y: float
    confidence: float
    spread: float


@dataclass(frozen=True, eq=False)
class Appearance:
    """What pictures of a marble have in common.

    Attributes
    ----------
    layers : (n, n, 4) float32 array
        The marble's own light [levels], three colours, and the share of the board's that is seen; `FINE`
        samples to a pixel, its middle in the middle.
    precision : (n, n) float32 array
        One over the variance of a picture's colour about that [1/levels^2].
    radius : float
        The marble's, where the scale is 1 [pixels].
    apart : float
        How far the middle of its rim is from that of what it covers [pixels].
    error : float
        Standard error of its middle where rims do not show that on all sides, or where it may be a shadow
        [pixels].
    shift : (dx, dy)
        From where its views had its middle to where that is, on average, where the scale is 1 [pixels].
    """

    layers: Values
    precision: Values
    radius: float
    apart: float = 0.0
    error: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        cv2 = opencv()
        across = cv2.Sobel(self.layers, cv2.CV_32F, 1, 0, scale=FINE / 8.0)
        down = cv2.Sobel(self.layers, cv2.CV_32F, 0, 1, scale=FINE / 8.0)
        object.__setattr__(self, "_slopes", (across, down))

    @property
    def reach(self) -> float:
        """How far from the middle it is known [pixels]."""
        return (len(self.layers) // 2) / FINE

    def match(self, picture: Values, board: Values, place: tuple[float, float], scale: float) -> Match:
        """Find the middle from a rough place, within about a radius.

        Parameters
        ----------
        picture, board : (h, w, 3) float32 arrays
            A part of a picture, and the board there without a marble [levels].
        place : (x, y)
            Where to begin [pixels of that part].
        scale : float
            The marble's size there over that of the appearance.
        """
        (x, y), gain, radius = place, 1.0, self.radius * scale
        for lets_go in LETS_GO:
            laid = self._laid(picture, board, (x, y), scale)
            if laid is None:
                return Match(x, y, 0.0, np.inf)
            seen = laid
            if lets_go == HOPELESS_AT and seen.confidence(gain, (x, y), np.zeros(2), radius) < HOPELESS:
                return Match(x, y, 0.0, np.inf)
            step, normal = seen.step(gain, lets_go)
            size = float(np.hypot(step[0], step[1]))
            part = min(1.0, LONGEST * radius / (size + 1e-9))
            x, y = x + part * float(step[0]), y + part * float(step[1])
            gain = float(np.clip(gain + step[2], *LIGHT))
            if np.hypot(x - place[0], y - place[1]) > FARTHEST * radius:
                return Match(x, y, 0.0, np.inf)
            if lets_go == LETS_GO[-1] and size < STILL:
                break
        spread = float(np.sqrt(np.linalg.eigvalsh(np.linalg.inv(normal)[:2, :2])[1]))
        confidence = seen.confidence(gain, (x, y), step, radius)
        return Match(x, y, confidence, spread)

    def _laid(self, picture: Values, board: Values, place: tuple[float, float], scale: float) -> _Laid | None:
        """Return the appearance laid over the part of a picture about a place, None where there is none."""
        reach = self.reach * scale
        height, width = picture.shape[:2]
        left, top = max(int(place[0] - reach), 0), max(int(place[1] - reach), 0)
        right, bottom = min(int(place[0] + reach) + 2, width), min(int(place[1] + reach) + 2, height)
        if right - left < 3 or bottom - top < 3:
            return None
        middle = len(self.layers) // 2
        per_pixel = FINE / scale
        matrix = np.array(
            [
                [per_pixel, 0.0, middle + per_pixel * (left - place[0])],
                [0.0, per_pixel, middle + per_pixel * (top - place[1])],
            ]
        )
        size = right - left, bottom - top
        box = slice(top, bottom), slice(left, right)
        seen, behind = _planes(picture[box]), _planes(board[box])
        across, down = self._slopes  # type: ignore[attr-defined]
        layers = _planes(_warped(self.layers, matrix, size, (0.0, 0.0, 0.0, 1.0)))
        moved = np.empty((2, *seen.shape), np.float32)
        for way, slopes in enumerate((across, down)):
            planes = _planes(_warped(slopes, matrix, size, (0.0,) * 4))
            np.multiply(planes[3], behind, out=moved[way])
            moved[way] += planes[:3]
        moved *= np.float32(-1.0 / scale)
        precision = _warped(self.precision, matrix, size, (0.0,)).ravel()
        return _Laid(seen, behind, layers[:3] + layers[3] * behind, moved, precision, (left, top, size[0]))


@dataclass(frozen=True, eq=False)
class _Laid:
    """An appearance over the k pixels of a part of a picture.

    Attributes
    ----------
    picture, board, model : (3, k) arrays
        What is seen, what would be without a marble, and with it in the usual light [levels].
    moved : (2, 3, k) array
        By how much the model changes as the marble moves to the right, and down [levels/pixel].
    precision : (k,) array
        As of the appearance.
    frame : tuple of int
        The left column and the top row of the part, and how many columns it has.
    """

    picture: Values
    board: Values
    model: Values
    moved: Values
    precision: Values
    frame: tuple[int, int, int]

    def step(self, gain: float, lets_go: float) -> tuple[Array, Array]:
        """Return the change of x, y and gain (3,) that fits better, and the normal matrix (3, 3)."""
        left = self.picture - np.float32(gain) * self.model
        square = self._square(left)
        weights = self.precision / (1.0 + square * np.float32(1.0 / (3.0 * lets_go**2))) ** 2
        design = np.empty((3, *left.shape), np.float32)
        np.multiply(self.moved, np.float32(gain), out=design[:2])
        design[2] = self.model
        weighed = (design * weights).reshape(3, -1)
        normal = (weighed @ design.reshape(3, -1).T).astype(np.float64)
        right = (weighed @ left.ravel()).astype(np.float64)
        hold = 1.0 / GAIN**2
        normal[[0, 1, 2], [0, 1, 2]] += 1e-3, 1e-3, hold
        right[2] += hold * (1.0 - gain)
        return np.asarray(np.linalg.solve(normal, right)), normal

    def confidence(self, gain: float, place: tuple[float, float], step: Array, radius: float) -> float:
        """Return the share of its difference from the board that is there, after a last small step."""
        model = self.model + np.float32(step[0]) * self.moved[0] + np.float32(step[1]) * self.moved[1]
        square = self._square(self.picture - np.float32(gain) * model)
        shown = self._square(model - self.board) / np.float32(3.0)
        left, top, width = self.frame
        down, right = np.divmod(np.arange(len(square)), width)
        inside = (right + (left - place[0])) ** 2 + (down + (top - place[1])) ** 2 < (WITHIN * radius) ** 2
        weights = np.minimum(np.sqrt(np.maximum(shown - DISTINCT**2, 0.0)), 4.0) * inside
        agrees = np.exp(-square / np.float32(2.0 * 3.0 * AGREES**2))
        # A disc that hardly differs from its board may be anywhere.
        return float((weights * agrees).sum() / (weights.sum() + FAINT * inside.sum() + 1e-9))

    def _square(self, apart: Values) -> Values:
        """Return the squared length (k,) of differences of colour (3, k), in variances."""
        return np.asarray((apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2) * self.precision)


def _planes(colours: Values) -> Values:
    """Return colours (h, w, c) as planes (c, h w): operations on these are much faster."""
    return np.ascontiguousarray(colours.reshape(-1, colours.shape[2]).T)


def _warped(layers: Values, matrix: Array, size: tuple[int, int], beyond: tuple[float, ...]) -> Values:
    """Return layers (n, n, c) as a part of a picture has them (h, w, c)."""
    cv2 = opencv()
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = cv2.warpAffine(
        layers, matrix, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=beyond
    )
    return np.asarray(laid, dtype=np.float32)
