"""A marble followed from picture to picture: a window first, then the whole board; lost where in doubt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.appearance import Appearance, Match
from irt.tracking.background import Underlay
from irt.tracking.blob_detector import Box
from irt.tracking.finder import Finder
from irt.tracking.geometry import Geometry, moved

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Confidence that a marble has within a radius of where it is expected, and elsewhere. What is dark and large
#: enough, such as a finger over the board, has a half of a steel marble's.
NEAR, FAR = 0.5, 0.7
#: Confidence that is enough from picture to picture without a break: beside a wall, or where the light is
#: another, a marble has less than usual for long. A finger that takes its place has less.
HELD = 0.6
#: Within so many radii of its last place, where it is held so.
STEP = 1.0
#: A marble was clear so few pictures ago if it is expected anywhere.
FRESH = 4
#: Of a marble that is seen well, over its usual one: then nothing else is looked for, and it shows where the
#: next picture should have it. A marble that is half hidden does not.
CLEAR = 0.82
#: Standard error that a place may have, in radii.
SHARP = 0.15
#: Candidates that are looked at: in a window, and in the whole picture.
FEW, MANY = 2, 4
#: A candidate that is as confident as this share of the best one leaves it in doubt.
RIVAL = 0.9
#: A candidate within so many radii of one that was looked at is that one.
CLOSE = 0.4
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
#: What is looked at about a disc, in radii.
MARGIN = 2.6


@dataclass(frozen=True, eq=False)
class Learned:
    """What a tracker knows of a board, its light and its marble.

    Attributes
    ----------
    finder : Finder
        What finds rough places of the marble: it knows the board without it, its colours and its radius.
    appearance : Appearance
        What the marble looks like.
    usual : float
        The marble's usual confidence.
    first : (x, y) or None
        Where the marble is in the first picture [pixels], where that is known.
    shadow : float
        The chance that what is taken for the marble is a shadow; a half where the board has no texture.
    """

    finder: Finder
    appearance: Appearance
    usual: float = 1.0
    first: tuple[float, float] | None = None
    shadow: float = 0.5

    @property
    def radius(self) -> float:
        """The marble's at the middle of the box [pixels]."""
        return self.finder.radius


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
    confirms : Sighting or None
        Where the marble was in the picture before, if only this one makes that sure.
    """

    x: float
    y: float
    confidence: float
    in_window: bool
    confirms: Sighting | None = None

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
    scale : callable
        Radius of the marble at a pixel over that at the middle of the box.
    """

    def __init__(self, learned: Learned, scale: Callable[[float, float], float]) -> None:
        self.learned = learned
        self._scale = scale
        self._under = Underlay(learned.finder.without)
        self._clear = max(CLEAR * learned.usual, FAR)
        self._last: list[tuple[int, float, float]] = []
        self._waiting: list[tuple[int, Match]] = []
        self._before: tuple[int, float, float] | None = None
        self._count = -1
        self._board: tuple[Geometry, Geometry] | None = None

    def expect(self, x: float, y: float) -> None:
        """Say where the marble is in the next picture [pixels]."""
        self._last = [(self._count + 1, x, y)]

    def see(self, picture: Picture, board: tuple[Geometry, Geometry] | None = None) -> Sighting:
        """Find the marble in the next picture.

        Parameters
        ----------
        picture : (h, w, 3) uint8 array
            Blue first.
        board : (Plane or Pose, Plane or Pose), optional
            The board where it was learned, and in this picture, where that is measured. Else what is seen
            about the marble shows it, from where it was in the picture before.
        """
        self._count += 1
        self._board = board
        expected = self._expected()
        tried: list[Match] = []
        if expected is not None:
            found = self._near(picture, expected, tried)
            if found is not None:
                away = np.hypot(found.x - expected[0], found.y - expected[1])
                sharp = away < self.learned.radius and self._count - self._last[-1][0] <= FRESH
                if found.confidence >= (NEAR if sharp else HELD if self._goes_on(found) else FAR):
                    return self._accept(found, in_window=True)
        return self._anywhere(picture, tried)

    def _near(
        self, picture: Picture, expected: tuple[float, float, float], tried: list[Match]
    ) -> Match | None:
        """Return what is most like the marble where that is expected, else None; add what was tried."""
        x, y, reach = expected
        tried.append(self.match(picture, x, y))
        if tried[0].confidence < self._clear:
            dx, dy = self.learned.finder.aside
            box = Box.about(x - dx, y - dy, reach + 2.0 * self.learned.radius + 2.0, self.learned.finder.box)
            self._try(picture, box, FEW, tried)

        def apart(one: Match) -> float:
            return float(np.hypot(one.x - x, one.y - y)) / reach

        within = [
            one
            for one in tried
            if self._sharp(one) and apart(one) < (1.0 if one.confidence >= self._clear else HALF)
        ]
        return max(within, key=lambda one: one.confidence - 0.2 * apart(one), default=None)

    def _anywhere(self, picture: Picture, tried: list[Match]) -> Sighting:
        """Look at the whole board; a marble where none was expected has to be seen twice."""
        matches = self.everywhere(picture, tried)
        best = max((one.confidence for one in matches), default=0.0)
        clear = [one for one in matches if one.confidence >= FAR and self._sharp(one)]
        if not clear or (len(clear) > 1 and clear[1].confidence > RIVAL * clear[0].confidence):
            self._waiting = []
            return Sighting(np.nan, np.nan, best, False)
        found = clear[0]
        near = [
            (count, one)
            for count, one in self._waiting
            if count == self._count - 1
            and np.hypot(found.x - one.x, found.y - one.y) < FIRST_STEP * self.learned.radius
        ]
        self._waiting = [*near, (self._count, found)]
        if len(self._waiting) < AGREEING and self._count > 0:
            return Sighting(np.nan, np.nan, best, False)
        self._last = [(count, one.x, one.y) for count, one in near]
        confirms = Sighting(near[0][1].x, near[0][1].y, near[0][1].confidence, False) if near else None
        return self._accept(found, in_window=False, confirms=confirms)

    def _goes_on(self, one: Match) -> bool:
        """Return whether a match is where the marble was in the picture before."""
        if self._before is None or self._before[0] != self._count - 1:
            return False
        _, x, y = self._before
        return float(np.hypot(one.x - x, one.y - y)) < STEP * self.learned.radius

    def _sharp(self, one: Match) -> bool:
        return one.spread < SHARP * self.learned.radius

    def _accept(self, found: Match, *, in_window: bool, confirms: Sighting | None = None) -> Sighting:
        if found.confidence >= self._clear:
            before = [one for one in self._last[-1:] if one[0] < self._count]
            self._last = [*before, (self._count, found.x, found.y)]
        self._waiting = []
        self._before = self._count, found.x, found.y
        return Sighting(found.x, found.y, found.confidence, in_window, confirms)

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
        # One sighting alone says nothing of the speed.
        least = REACH_RADII if len(self._last) == 2 else FIRST_STEP
        reach = self.learned.radius * (least + GROWS * (gone - 1)) + REACH_STEPS * speed * gone
        return x + ahead[0], y + ahead[1], reach

    def _try(self, picture: Picture, box: Box, most: int, tried: list[Match]) -> None:
        """Add what is like the marble in a box of the picture, but for what was tried."""
        near = CLOSE * self.learned.radius
        for x, y in self.learned.finder.places(picture, box, most):
            # A match that is not clear may have begun too far from the marble, and ended beside it.
            clear = [one for one in tried if one.confidence >= self._clear]
            if all(np.hypot(x - one.x, y - one.y) > near for one in clear):
                tried.append(self.match(picture, x, y))

    def everywhere(self, picture: Picture, tried: list[Match] | None = None) -> list[Match]:
        """Return what is like the marble in a picture, the most confident first.

        Parameters
        ----------
        picture : (h, w, 3) uint8 array
            Blue first.
        tried : list of Match, optional
            What was matched in it already.
        """
        found = list(tried or [])
        self._try(picture, self.learned.finder.box, MANY, found)
        matches = sorted(found, key=lambda one: -one.confidence)
        # Two candidates may have led to one disc.
        return [
            one
            for index, one in enumerate(matches)
            if all(
                np.hypot(one.x - other.x, one.y - other.y) > self.learned.radius for other in matches[:index]
            )
        ]

    def match(self, picture: Picture, x: float, y: float) -> Match:
        """Return the marble about a rough place of a picture."""
        scale = self._scale(x, y)
        radius = self.learned.radius * scale
        height, width = picture.shape[:2]
        box = Box.about(x, y, MARGIN * radius, Box(0, 0, width, height))
        if box.empty:
            return Match(x, y, 0.0, np.inf)
        part = self.learned.finder.seen(picture, box).astype(np.float32)
        if self._board is not None:
            self._under.shift = np.array([x, y]) - moved((x, y), *reversed(self._board))
        board = self._under.beneath(part, box, (x, y, radius), self.learned.finder.noise)
        found = self.learned.appearance.match(part, board, (x - box.left, y - box.top), scale)
        return Match(found.x + box.left, found.y + box.top, found.confidence, found.spread)
