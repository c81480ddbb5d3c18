"""How much like the marble a colour is, in a space that stands changes of light.

Less light scales all three channels alike: shares of red and blue stay, the sum falls. So colours are
counted by their shares, finely, and by the logarithm of their sum, coarsely; a table over all colours (five
bits a channel) then answers for every pixel at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Likeness = NDArray[np.uint8]

#: Cells of a share, and of the logarithm of the sum.
SHARES, SUMS = 48, 20
#: Smoothing of the counts [cells]: shares, sum.
SMOOTH = (1.2, 1.2, 1.6)
#: Added to each channel, so that shares of near black are no accident of the noise [levels].
DARK = 12.0
#: Density of colours that nobody has shown yet, in multiples of an even one.
UNSEEN = 0.5
#: What lighting may do to a colour of which only one shade was given.
SHADES = (0.5, 1.5)


@dataclass(frozen=True, eq=False)
class ColourModel:
    """A table from colours to likeness.

    Attributes
    ----------
    table : (32768,) uint8 array
        From 0, another colour, to 255, the marble's, by blue, green, red of five bits each.
    """

    table: NDArray[np.uint8]

    @classmethod
    def learned(cls, marble: Picture, others: Picture) -> ColourModel:
        """Learn from pixels (n, 3) of the marble, blue first, and from others (m, 3)."""
        cells = np.ravel_multi_index(tuple(_cells(_bins()).T), (SHARES, SHARES, SUMS))
        own, other = (_density(pixels).ravel()[cells] for pixels in (marble, others))
        even = UNSEEN / (SHARES * SHARES * SUMS)
        return cls(np.rint(255.0 * own / (own + other + even)).astype(np.uint8))

    def likeness(self, picture: Picture) -> Likeness:
        """Return how much like the marble each pixel (h, w) of a picture (h, w, 3) is, from 0 to 255."""
        five = (picture >> 3).astype(np.uint16)
        found = self.table[(five[..., 0] << 10) | (five[..., 1] << 5) | five[..., 2]]
        return np.asarray(found)


def shades_of(colour: tuple[float, float, float], noise: float = 8.0) -> Picture:
    """Return pixels (n, 3) that a marble of one colour [levels, blue first] has in more and less light."""
    random = np.random.default_rng(0)
    light = random.uniform(*SHADES, (2000, 1))
    pixels = light * np.array(colour) + noise * random.standard_normal((2000, 3))
    return np.asarray(np.clip(np.rint(pixels), 0, 255), dtype=np.uint8)


@lru_cache(maxsize=1)
def _bins() -> Array:
    """Return the middle colour (32768, 3) of each entry of the table."""
    steps = np.arange(32) * 8 + 4.0
    return np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)


def _cells(pixels: Array) -> NDArray[np.int64]:
    """Return the cell (n, 3) that each colour is counted in."""
    light = pixels + DARK
    total = light.sum(axis=1)
    # Shares of more than 0.7 need a red or blue laser: the cells are for what there is.
    shares = light[:, [0, 2]] / total[:, None] / 0.75 * SHARES
    sums = np.log2(total / (3 * DARK)) / np.log2(1 + 255 / DARK) * SUMS
    cells = np.column_stack([shares, sums]).astype(np.int64)
    return np.clip(cells, 0, [SHARES - 1, SHARES - 1, SUMS - 1])


def _density(pixels: Picture) -> Array:
    """Return the smoothed share of pixels in each cell."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415

    cells = _cells(pixels.astype(np.float64))
    index = np.ravel_multi_index(tuple(cells.T), (SHARES, SHARES, SUMS))
    counts = np.bincount(index, minlength=SHARES * SHARES * SUMS).astype(np.float64)
    smooth = gaussian_filter(counts.reshape(SHARES, SHARES, SUMS), SMOOTH, mode="nearest")
    return np.asarray(smooth / max(len(pixels), 1))
