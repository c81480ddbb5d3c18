"""Where a marble may be: what has its colours, its size, and is not on the empty board."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from irt.tracking.blob_detector import COARSE_FROM, Box, seek
from irt.tracking.colour import ColourModel
from irt.tracking.contrast import Contrast
from irt.tracking.light import Light
from irt.tracking.opencv import opencv

Picture = NDArray[np.uint8]

#: Levels by which a pixel must differ from the empty board to be of the marble, in noises, and at least.
DIFFERS, LEAST_LEVELS = 3.0, 9.0


@dataclass(frozen=True, eq=False)
class Finder:
    """Finds rough places of a marble.

    Attributes
    ----------
    without : (h, w, 3) uint8 array
        The board without the marble, blue first.
    colours : ColourModel
        The marble's beside all others'.
    radius : float
        Of the marble at the middle of the box [pixels].
    noise : float
        Standard deviation of a colour [levels].
    box : Box
        Where the marble can be.
    anew : bool
        Whether only what differs from the board without the marble counts.
    light : Light, Contrast or None
        What makes pictures even, where shadows pass over the board, or enlarges what is faint.
    aside : (dx, dy)
        From what has these colours to the marble [pixels]: the shadow of a marble that looks like the board
        is easier to find than the marble.
    """

    without: Picture
    colours: ColourModel
    radius: float
    noise: float
    box: Box
    anew: bool = True
    light: Light | Contrast | None = None
    aside: tuple[float, float] = (0.0, 0.0)

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the box [pixels]."""
        return (self.box.left + self.box.right) / 2.0, (self.box.top + self.box.bottom) / 2.0

    def places(self, picture: Picture, box: Box, most: int) -> list[tuple[float, float]]:
        """Return where in a box of a picture the marble may be [pixels], the best first."""
        coarse = self._coarse
        box = replace(
            box,
            left=box.left - (box.left - self.box.left) % coarse,
            top=box.top - (box.top - self.box.top) % coarse,
        )
        if box.empty:
            return []
        small = self._smaller(self.seen(picture, box))
        likeness = self.colours.likeness(small)
        if self.anew:
            top, left = (box.top - self.box.top) // coarse, (box.left - self.box.left) // coarse
            empty = self._empty[top : top + small.shape[0], left : left + small.shape[1]]
            likeness = likeness * (greatest(small, empty) > max(DIFFERS * self.noise, LEAST_LEVELS))
        found = seek(likeness, self.radius / coarse, most)
        half = (coarse - 1) / 2
        dx, dy = self.aside
        return [(box.left + coarse * x + half + dx, box.top + coarse * y + half + dy) for _, x, y in found]

    def seen(self, picture: Picture, box: Box) -> Picture:
        """Return a box of a picture in the usual light."""
        return picture[box.slices] if self.light is None else self.light.evened(picture, box)

    @property
    def _coarse(self) -> int:
        return 2 if self.radius > COARSE_FROM else 1

    @cached_property
    def _empty(self) -> Picture:
        return self._smaller(self.without[self.box.slices])

    def _smaller(self, picture: Picture) -> Picture:
        if self._coarse == 1:
            return picture
        height, width = (max(length // 2, 1) for length in picture.shape[:2])
        cut = picture[: 2 * height, : 2 * width]
        small = opencv().resize(cut, (width, height), interpolation=opencv().INTER_AREA)
        return np.asarray(small, dtype=np.uint8)


def greatest(one: Picture, other: Picture) -> NDArray[np.uint8]:
    """Return the greatest difference (h, w) of three colours [levels]."""
    cv2 = opencv()
    blue, green, red = cv2.split(cv2.absdiff(one, other))
    return np.asarray(cv2.max(cv2.max(blue, green), red), dtype=np.uint8)
