"""A marble followed from picture to picture: a window first, then the whole board; lost where in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.tracking.colour import ColourModel
from irt.tracking.opencv import opencv
from irt.tracking.rim import Outline, Patch, Rim, fit_rim
from irt.tracking.seek import COARSE_FROM, Box, seek
from irt.tracking.underlay import Underlay

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Confidence that a marble has where it is expected, and where it is not.
NEAR, FAR = 0.5, 0.72
#: Of a marble that is seen well, over its usual one: then nothing else is looked for, and it tells where the
#: next picture should have it. A marble that is half hidden does not.
CLEAR = 0.82
#: Candidates whose rim is looked at: in a window, and in the whole picture.
FEW, MANY = 2, 5
#: Pictures in a row that must agree on a place where no marble was expected.
AGREEING = 2
#: Within so many radii of each other.
FIRST_STEP = 3.0
#: A marble is expected within this many radii of its predicted place, and this share of its last step: a
#: wall may turn it, and a tilt changes its step by less than a pixel from one picture to the next.
REACH_RADII, REACH_STEPS = 0.5, 1.5
#: Share of that for a marble that is half hidden.
HALF = 0.5
#: Radii by which that grows with each picture in which it was lost.
GROWS = 0.35
#: Lost for so many pictures, its place says nothing any more.
FORGOTTEN = 60
#: Levels by which a pixel must differ from the empty board to be of the marble, in noises, and at least.
DIFFERS, LEAST_LEVELS = 3.0, 9.0
#: What a patch shows around a disc, in radii.
MARGIN = 2.6


@dataclass(frozen=True, eq=False)
class Learned:
    """What a tracker knows of a board, its light and its marble.

    Attributes
    ----------
    without : (h, w, 3) uint8 array or None
        The board without the marble, blue first; None where nobody knows.
    colours : ColourModel
        The marble's beside all others'.
    outline : Outline
        What its rim looks like.
    radius : float
        Of the marble at the middle of the box [pixels].
    noise : float
        Standard deviation of a colour [levels].
    box : Box
        Where the marble can be.
    usual : float
        The marble's usual confidence.
    first : (x, y) or None
        Where the marble is in the first picture [pixels], where that is known.
    """

    without: Picture | None
    colours: ColourModel
    outline: Outline
    radius: float
    noise: float
    box: Box
    usual: float = 1.0
    first: tuple[float, float] | None = None

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the box [pixels]."""
        return (self.box.left + self.box.right) / 2.0, (self.box.top + self.box.bottom) / 2.0


@dataclass(frozen=True)
class Sighting:
    """Where a marble is in one picture.

    Attributes
    ----------
    x, y : float
        Its middle [pixels], NaN where it is lost.
    confidence : float
        From 0 to 1, of what is most like a marble there, even where that is not enough.
    in_window : bool
        Whether the search of a window was enough.
    """

    x: float
    y: float
    confidence: float
    in_window: bool

    @property
    def seen(self) -> bool:
        """Whether there is a position."""
        return self.x == self.x


class Tracker:
    """Follows one marble; pictures go in in order.

    Parameters
    ----------
    learned : Learned
        Board, light and marble.
    scale : callable, optional
        Radius of the marble at a pixel over that at the middle of the box.
    """

    def __init__(self, learned: Learned, scale: Any = None) -> None:
        self.learned = learned
        self._scale = scale or (lambda x, y: 1.0)
        self._coarse = 2 if learned.radius > COARSE_FROM else 1
        rows, columns = learned.box.slices
        without = learned.without
        self._under = None if without is None else Underlay(without)
        self._empty = None if without is None else self._smaller(without[rows, columns])
        self._clear = max(CLEAR * learned.usual, FAR)
        self._least = max(DIFFERS * learned.noise, LEAST_LEVELS)
        self._last: list[tuple[int, float, float]] = []
        self._waiting: list[tuple[int, float, float]] = []
        self._count = -1

    def expect(self, x: float, y: float) -> None:
        """Say where the marble is in the next picture [pixels]."""
        self._last = [(self._count + 1, x, y)]

    def see(self, picture: Picture) -> Sighting:
        """Find the marble in the next picture."""
        self._count += 1
        best = 0.0
        expected = self._expected()
        if expected is not None:
            x, y, reach = expected
            rims = [self.rim(picture, x, y)]
            if rims[0].confidence < self._clear:
                box = Box.about(x, y, reach + 2.0 * self.learned.radius + 2.0, self.learned.box)
                rims += self._rims(picture, box, FEW)
            rims = [
                one
                for one in rims
                if np.hypot(one.x - x, one.y - y) < reach * (1.0 if one.confidence >= self._clear else HALF)
            ]
            if rims:
                found = max(
                    rims, key=lambda one: one.confidence - 0.2 * np.hypot(one.x - x, one.y - y) / reach
                )
                best = found.confidence
                if found.confidence >= NEAR:
                    return self._accept(found, in_window=True)
        return self._anywhere(picture, expected, best)

    def _anywhere(
        self, picture: Picture, expected: tuple[float, float, float] | None, best: float
    ) -> Sighting:
        """Look at the whole board; a marble where none was expected has to be seen twice."""
        rims = self.everywhere(picture)
        best = max([best, *(one.confidence for one in rims)])
        clear = [one for one in rims if one.confidence >= FAR]
        if not clear or (len(clear) > 1 and clear[1].confidence > 0.9 * clear[0].confidence):
            self._waiting = []
            return Sighting(np.nan, np.nan, best, False)
        found = clear[0]
        near = [
            one
            for one in self._waiting
            if one[0] == self._count - 1
            and np.hypot(found.x - one[1], found.y - one[2]) < FIRST_STEP * self.learned.radius
        ]
        self._waiting = [*(self._waiting if near else []), (self._count, found.x, found.y)]
        if len(self._waiting) >= AGREEING or self._count == 0:
            self._last = self._waiting[-2:-1]
            return self._accept(found, in_window=False)
        return Sighting(np.nan, np.nan, best, False)

    def _accept(self, found: Rim, *, in_window: bool) -> Sighting:
        if found.confidence >= self._clear:
            before = [one for one in self._last[-1:] if one[0] < self._count]
            self._last = [*before, (self._count, found.x, found.y)]
        self._waiting = []
        return Sighting(found.x, found.y, found.confidence, in_window)

    def _expected(self) -> tuple[float, float, float] | None:
        """Return where the marble should be, and how far from there it may be [pixels]."""
        if not self._last or self._count - self._last[-1][0] > FORGOTTEN:
            return None
        count, x, y = self._last[-1]
        gone = max(self._count - count, 1)
        step = np.zeros(2)
        if len(self._last) == 2 and count > self._last[0][0]:
            step = np.array([x - self._last[0][1], y - self._last[0][2]]) / (count - self._last[0][0])
        # A marble that was lost for long may have turned.
        ahead = step * min(gone, 6)
        speed = float(np.hypot(*step))
        # One sighting alone tells nothing of the speed.
        least = REACH_RADII if len(self._last) == 2 else FIRST_STEP
        reach = self.learned.radius * (least + GROWS * (gone - 1)) + REACH_STEPS * speed * gone
        return x + ahead[0], y + ahead[1], reach

    def _rims(self, picture: Picture, box: Box, most: int) -> list[Rim]:
        """Return the discs that may be the marble in a box of the picture."""
        if box.empty:
            return []
        coarse = self._coarse
        box = replace(
            box,
            left=box.left - (box.left - self.learned.box.left) % coarse,
            top=box.top - (box.top - self.learned.box.top) % coarse,
        )
        rows, columns = box.slices
        small = self._smaller(picture[rows, columns])
        likeness = self.learned.colours.likeness(small)
        if self._empty is not None:
            top, left = (
                (box.top - self.learned.box.top) // coarse,
                (box.left - self.learned.box.left) // coarse,
            )
            empty = self._empty[top : top + small.shape[0], left : left + small.shape[1]]
            apart = opencv().absdiff(small, empty)
            likeness = likeness * (apart.max(axis=2) > self._least)
        found = seek(likeness, self.learned.radius / coarse, most)
        half = (coarse - 1) / 2
        return [
            self.rim(picture, box.left + coarse * x + half, box.top + coarse * y + half) for _, x, y in found
        ]

    def everywhere(self, picture: Picture) -> list[Rim]:
        """Return the discs of a picture that may be the marble, the most confident first."""
        return sorted(self._rims(picture, self.learned.box, MANY), key=lambda one: -one.confidence)

    def rim(self, picture: Picture, x: float, y: float) -> Rim:
        """Return the disc about a rough place of a picture."""
        radius = self.learned.radius * self._scale(x, y)
        height, width = picture.shape[:2]
        whole = Box(0, 0, width, height)
        patch, left, top = self.patch(picture, Box.about(x, y, MARGIN * radius, whole), (x, y, radius))
        rim = fit_rim(patch, (x - left, y - top), radius, self.learned.outline)
        return replace(rim, x=rim.x + left, y=rim.y + top)

    def patch(self, picture: Picture, box: Box, disc: tuple[float, float, float]) -> tuple[Patch, int, int]:
        """Return a part of a picture with a disc in it (x, y, radius), and where it begins."""
        rows, columns = box.slices
        part = picture[rows, columns]
        likeness = self.learned.colours.likeness(part)
        layers = np.empty((*part.shape[:2], 4), np.float32)
        layers[:, :, :3] = part
        layers[:, :, 3] = likeness * np.float32(1.0 / 255.0)
        without = None
        if self._under is not None:
            without = self._under.beneath(layers, box, disc, self.learned.noise)
        return Patch(layers, without, self.learned.noise), box.left, box.top

    def _smaller(self, picture: Picture) -> Picture:
        if self._coarse == 1:
            return picture
        height, width = (max(length // 2, 1) for length in picture.shape[:2])
        cut = picture[: 2 * height, : 2 * width]
        small = opencv().resize(cut, (width, height), interpolation=opencv().INTER_AREA)
        return np.asarray(small, dtype=np.uint8)
