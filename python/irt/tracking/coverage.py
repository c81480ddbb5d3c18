"""The disc that a marble covers, by what each pixel does to the board behind it.

Under a shadow a picture is the board times a light of one tint, and the board's texture stays in the
logarithm of levels. A marble replaces the board: its texture is gone, and so is its hue. Each cell of some
views laid over each other gets the logarithm of how much likelier it is covered than shaded or lit. The
marble is the disc of known radius that collects most of that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.edge_fit import Values
from irt.tracking.opencv import opencv
from irt.tracking.shadow import ALIKE, BLACK, TINTED

Array = NDArray[np.float64]

#: Greatest weight of one cue in one cell [nats]: cells that share a lamp's mirror image err together.
MOST = 4.0
#: Scatter of a shadow's tint about its usual one, as logarithm of levels.
TINT = 0.06
#: Changes of light from picture to picture, as logarithm of levels.
LIGHT = 0.02
#: Deviations of one cell's textures that count, as logarithm of levels: what passes over it counts no more.
TEXTURE = 0.3
#: Light below which a cell outside the disc shows the shadow's tint, as logarithm of levels.
DARKER = 0.1
#: A cell is lit where its light is that of the board within about so many standard errors.
LIT = 2.0
#: The tint is measured outside of so many radii, where it has at least so many cells.
OUTSIDE, FEWEST = 1.1, 12
#: The disc's middle is looked for so far from that of the views, in radii.
REACH = 1.2
#: Levels from here on are cut off: they show no hue.
FULL = 250.0
#: Rounds in which disc and tint follow each other.
ROUNDS = 6
#: How much likelier it is that the sizes of board and marble are right than that they are wrong [nats]: one
#: rig in twenty.
SIZED = 3.0
#: A rig is of another marble if that is larger or smaller by this share at least.
WRONG = 0.2
#: A lens blurs a rim over so much [pixels].
BLURRED = 1.0
#: About a marble that is smaller than the rig says at least this share of the board is in its usual light:
#: the shadows of two lamps, each as wide as the marble, leave half of it; half of that is for noise.
BARE = 0.25


@dataclass(frozen=True)
class Laid:
    """A disc laid over the cells that are covered.

    Attributes
    ----------
    x, y, radius : float
        Its middle from that of the views, and its radius [pixels].
    worth : float
        Logarithm of how much likelier its cells are covered, and those beside it are not, than the reverse.
    """

    x: float
    y: float
    radius: float
    worth: float


@dataclass(frozen=True, eq=False)
class Coverage:
    """What cells about a marble do to the board.

    Attributes
    ----------
    texture : (n, n) array
        How much likelier the board's texture is hidden than seen [nats].
    lit : (n, n) array
        From 0 to 1: whether the board is seen in its usual light.
    change : (n, n, 3) array
        Logarithm of levels over those of the board.
    white : (n, n) bool array
        Cells without a hue.
    fine : int
        Cells to a pixel.
    """

    texture: Array
    lit: Array
    change: Array
    white: NDArray[np.bool_]
    fine: int

    @classmethod
    def of(cls, pictures: Values, boards: Values, noise: float, fine: int) -> Coverage:
        """Return what v views do to the board.

        Parameters
        ----------
        pictures, boards : (v, n, n, 3) float32 arrays
            Views laid over each other, and the board there without a marble [levels].
        noise : float
            Standard deviation of a colour [levels].
        fine : int
            Cells to a pixel.
        """
        seen, behind = (np.log(np.maximum(one, 0.0) + BLACK) for one in (pictures, boards))
        count = len(pictures)
        usual = np.median(pictures, axis=0)
        least = ((noise / (np.maximum(usual, 0.0) + BLACK)) ** 2).mean(axis=2)
        # What lights a place of the board lights the marble there: without that the difference in light
        # between two places would be a texture, and a marble that shares it let one be seen.
        light = np.median(behind, axis=(1, 2), keepdims=True)
        covered, clear = _varied(seen - light), _varied(seen - behind)
        scatter = np.minimum(covered, clear) + 0.5 * least
        texture = np.clip(0.5 * count * (clear - covered) / scatter / ALIKE, -MOST, MOST)
        change = np.median(seen - behind, axis=0)
        error = np.sqrt(np.maximum(clear, least) / count + LIGHT**2)
        lit = np.exp(-0.5 * (np.abs(change).max(axis=2) / (LIT * error)) ** 2)
        # What mirrors a lamp, or gathers its light beside a glass marble, is too bright to have a hue.
        white = (usual.max(axis=2) > FULL) & (change.mean(axis=2) > LIGHT)
        return cls(texture, lit, change, white, fine)

    def laid(self, radius: float) -> Laid:
        """Return the disc of a radius [pixels] that covers what is covered."""
        x = y = worth = 0.0
        for _ in range(ROUNDS):
            likely = self._likely((x, y), radius)
            before = x, y
            x, y, worth = self._most(likely, radius)
            if np.hypot(x - before[0], y - before[1]) < 0.1 / self.fine:
                break
        return Laid(x, y, radius, worth / ALIKE)

    def sized(self, seen: float, known: float) -> Laid:
        """Return the disc of the known radius, unless it is another marble's and the one seen fits better.

        Parameters
        ----------
        seen, known : float
            As rims show it, and as sizes of board and marble say [pixels].
        """
        disc = self.laid(known)
        if abs(np.log(seen / known)) < WRONG:
            return disc
        other = self.laid(seen)
        if seen < known and self._lit_about(other, known) < BARE:
            # The horizon in a mirroring marble is a rim as well, and a smaller one.
            return disc
        return other if other.worth > disc.worth + SIZED else disc

    def _lit_about(self, disc: Laid, radius: float) -> float:
        """Return the share of the cells from a disc to another radius [pixels] about it that are lit."""
        right, down = self._grid()
        away = np.hypot(right - disc.x, down - disc.y)
        ring = (away > disc.radius + BLURRED) & (away < radius)
        return float(self.lit[ring].mean()) if ring.any() else 0.0

    def _grid(self) -> tuple[Array, Array]:
        """Return how far to the right and down cells are from the middle [pixels]."""
        half = len(self.lit) // 2
        down, right = np.mgrid[-half : half + 1, -half : half + 1] / self.fine
        return right, down

    def _likely(self, middle: tuple[float, float], radius: float) -> Array:
        """Return how much likelier cells are covered (n, n) [nats], by the tint outside of a disc."""
        right, down = self._grid()
        light = self.change.mean(axis=2)
        hue = self.change - light[..., None]
        beside = np.hypot(right - middle[0], down - middle[1]) > OUTSIDE * radius
        shaded = beside & (self.lit < 0.5) & (light < -DARKER)
        tint = np.zeros(3)
        if shaded.sum() >= FEWEST:
            tint = np.median(hue[shaded] / light[shaded][:, None], axis=0)
            tint -= tint.mean()
            tint /= max(1.0, float(np.ptp(tint)) / TINTED)
        expected = np.minimum(light, 0.0)[..., None] * tint
        strange = ((hue - expected) ** 2).sum(axis=2) / (2.0 * TINT**2)
        strange[self.white] = 0.0
        return np.asarray(self.texture + np.minimum(strange, MOST) - MOST * self.lit)

    def _most(self, likely: Array, radius: float) -> tuple[float, float, float]:
        """Return the middle [pixels] of the disc that collects most, and its worth [nats]."""
        right, down = self._grid()
        away = np.hypot(right, down)
        disc = np.clip(self.fine * (radius - away) + 0.5, 0.0, 1.0)
        collected = opencv().filter2D(likely, -1, disc, borderType=opencv().BORDER_CONSTANT)
        collected[away > REACH * radius] = -np.inf
        row, column = np.unravel_index(int(np.argmax(collected)), collected.shape)
        x = right[row, column] + _peak(collected[row, column - 1 : column + 2]) / self.fine
        y = down[row, column] + _peak(collected[row - 1 : row + 2, column]) / self.fine
        return float(x), float(y), float(collected[row, column] - np.maximum(likely, 0.0).sum())


def _varied(views: Values) -> Array:
    """Return the variance from view to view of a cell's colours and its neighbours' (n, n)."""
    apart = np.minimum((views - np.median(views, axis=0)) ** 2, TEXTURE**2).mean(axis=(0, 3))
    return np.asarray(opencv().GaussianBlur(apart, (0, 0), 1.0), dtype=np.float64)


def _peak(around: Array) -> float:
    """Return where a parabola through a largest value and its neighbours is highest, from -0.5 to 0.5."""
    if len(around) < 3 or not np.isfinite(around).all():
        return 0.0
    before, most, after = around
    bend = 2.0 * most - before - after
    return float(0.5 * (after - before) / bend) if bend > 0 else 0.0
