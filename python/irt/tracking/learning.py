"""What the marble looks like, learned from a sample of pictures in which it moves.

The median of the sample is the board without it. What differs from that, is as large as the marble, round,
and no ghost (a disc in the median that the picture lacks) is a candidate; the colour that most candidates
share, in most places, is the marble's. With its colours known it is found in pictures where it rests, too,
and taken out of the median there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.appearance import Match
from irt.tracking.background import ROUNDS, Underlay
from irt.tracking.blob_detector import Box
from irt.tracking.candidates import candidates, within
from irt.tracking.colour import ColourModel, shades_of
from irt.tracking.contrast import Contrast
from irt.tracking.edge_fit import Rim, fit_rim
from irt.tracking.emptied import changed, emptied, reaches_beyond
from irt.tracking.finder import Finder
from irt.tracking.geometry import Geometry
from irt.tracking.light import Light, is_steady
from irt.tracking.noise import noise_of
from irt.tracking.separation import (
    FEWEST,
    Clue,
    NoMarbleError,
    ball_or_shadow,
    beside,
    is_bare,
    largest_group,
    marble_beside,
    middle_of,
    neighbourhoods,
    two_of,
    without_shadow,
)
from irt.tracking.shading import ELSEWHERE, Thrown
from irt.tracking.template import View, learn_appearance
from irt.tracking.tracker import MANY, MARGIN, NEAR, Learned, Tracker

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Scale = Callable[[float, float], float]

#: Pixels of the board that the colours are learned against, per picture.
OTHERS = 4000
#: A board on which this share of the sample shows two marbles at once has two.
TWO = 0.3
#: Radii, over the expected one, that are tried.
SIZES = (1.0, 0.75, 1.35)
#: A disc of this confidence is a view that the marble's looks are learned from.
VIEW = 0.6
#: A match finds the middle from within so many radii of it: from 0.4 in nine of ten path-traced runs.
BASIN = 0.3
#: How far a marble is followed back from one picture of the sample to the one before, in radii.
BACK = 3.0
#: More contrast than this is worth another look, where nothing like a marble moves; then this share of the
#: pictures must show it clearly, and the chance of a shadow may be no more than what is warned of.
WORTHWHILE, CLEAR, FAINT_SHADOW = 1.5, 0.5, 0.05
#: What is likelier a shadow than a marble is refused; where a user says what the marble is, what surely is.
SHADOW, SURELY = 0.5, 0.999


def learn(
    pictures: Sequence[Picture],
    geometry: Geometry,
    box: Box,
    clue: Clue | None = None,
    empty: Picture | None = None,
) -> Learned:
    """Learn board, light and marble.

    Parameters
    ----------
    pictures : sequence of (h, w, 3) uint8 arrays
        A sample of the run, blue first, the first picture first.
    geometry : Plane or Pose
        Of the board.
    box : Box
        Where the marble can be.
    clue : Clue, optional
        What a user says of it.
    empty : (h, w, 3) uint8 array, optional
        The board without a marble; by default the median of the sample.

    Raises
    ------
    NoMarbleError
        If nothing like a marble moves.
    IrtError
        If two do, or there are too few pictures to decide.
    """
    if empty is None and len(pictures) < FEWEST:
        raise IrtError(f"{FEWEST} pictures at least are needed to see what moves")
    without = np.median(np.stack(pictures), axis=0).astype(np.uint8) if empty is None else empty
    expected = geometry.radius_at(((box.left + box.right) / 2.0, (box.top + box.bottom) / 2.0))
    even: Light | None = None
    given = pictures
    asked, has_empty = clue or Clue(), empty is not None
    if not is_steady(pictures, Light(without, expected), box):
        pictures, without, even = _evened(pictures, without, expected, known=has_empty)
    light: Light | Contrast | None = even
    try:
        learned = _learned(pictures, without, box, geometry, asked, has_empty=has_empty)
    except NoMarbleError:
        contrast = Contrast(without, box, expected, even)
        if asked.colour is not None or contrast.gain < WORTHWHILE:
            raise
        whole = Box(0, 0, without.shape[1], without.shape[0])
        more = [contrast.evened(one, whole) for one in given]
        plain = _Plain(pictures, without, _noise(pictures, without, box))
        bare = contrast.evened(without, whole)
        enlarged: Learned | None = None
        with suppress(IrtError):
            enlarged = _learned(more, bare, box, geometry, asked, has_empty=has_empty, plain=plain)
        if enlarged is None:
            raise
        learned, light = enlarged, contrast
    return replace(learned, finder=replace(learned.finder, light=light))


@dataclass(frozen=True, eq=False)
class _Plain:
    """Pictures without more contrast: there a shadow is the board in less light.

    Attributes
    ----------
    pictures, without : (h, w, 3) uint8 arrays
        A sample of the run, and the board without a marble.
    noise : float
        Standard deviation of a colour [levels].
    least, shadow : float
        Share of the pictures that must show the marble clearly, and the chance of a shadow from which on it
        is refused: what is enlarged may be anything.
    """

    pictures: Sequence[Picture]
    without: Picture
    noise: float
    least: float = CLEAR
    shadow: float = FAINT_SHADOW

    def known(self, known: Finder) -> Finder:
        """Return what is known, in these pictures."""
        return replace(known, without=self.without, noise=self.noise)


def _learned(
    pictures: Sequence[Picture],
    without: Picture,
    box: Box,
    geometry: Geometry,
    clue: Clue,
    *,
    has_empty: bool,
    plain: _Plain | None = None,
) -> Learned:
    """Return what is learned from pictures in the usual light; `plain` if these have more contrast."""
    radius = geometry.radius_at(((box.left + box.right) / 2.0, (box.top + box.bottom) / 2.0))
    blank = Finder(without, _any(), radius, _noise(pictures, without, box), box)
    known = blank
    if clue.places or clue.colour:
        known = replace(blank, colours=_given(pictures, clue, radius, box))
    if known is blank or (clue.places and len(_discs(pictures, known)) < FEWEST):
        # A marble whose colours are the board's is found by what moves beside the place that was given. A
        # disc or two of these colours may be anything.
        known = _moving(pictures, scale_of(geometry, blank.middle), blank, has_empty=has_empty)
    return _refined(
        pictures, known, geometry, clue, plain or _Plain(pictures, without, blank.noise, 0.0, SHADOW)
    )


def _evened(
    pictures: Sequence[Picture], without: Picture, radius: float, *, known: bool
) -> tuple[list[Picture], Picture, Light]:
    """Return pictures in the usual light, the board without a marble, and that light.

    Where nobody saw the board empty, it is the median of pictures whose shadows are still in it: their median
    in even light is nearer to one light.
    """
    height, width = without.shape[:2]
    whole = Box(0, 0, width, height)
    light = Light(without, radius)
    even = [light.evened(picture, whole) for picture in pictures]
    if not known:
        without = np.median(np.stack(even), axis=0).astype(np.uint8)
        light = Light(without, radius)
        even = [light.evened(picture, whole) for picture in pictures]
    return even, without, light


def scale_of(geometry: Geometry, middle: tuple[float, float]) -> Scale:
    """Return the function that says how large a marble is at a pixel, over its size at another."""
    expected = geometry.radius_at(middle)
    width = max(abs(middle[0]), abs(middle[1]), 1.0)
    # Perspective is smooth: a plane through four places is within a thousandth.
    offsets = 0.3 * width * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    sizes = [geometry.radius_at((middle[0] + dx, middle[1] + dy)) / expected for dx, dy in offsets]
    slope_x = (sizes[0] - sizes[1]) / (0.6 * width)
    slope_y = (sizes[2] - sizes[3]) / (0.6 * width)

    def scale(x: float, y: float) -> float:
        return 1.0 + slope_x * (x - middle[0]) + slope_y * (y - middle[1])

    return scale


def _noise(pictures: Sequence[Picture], without: Picture, box: Box) -> float:
    """Return the standard deviation of a colour about the median in a box [levels]."""
    return noise_of([one[box.slices] for one in pictures], without[box.slices])


def _any() -> ColourModel:
    return ColourModel(np.full(32768, 255, np.uint8))


def _moving(pictures: Sequence[Picture], scale: Scale, blank: Finder, *, has_empty: bool) -> Finder:
    """Return what is learned from what moves, or is not on the empty board that was given."""
    for size in SIZES:
        tried = replace(blank, radius=size * blank.radius)
        found = [one for index, picture in enumerate(pictures) for one in candidates(index, picture, tried)]
        marble = largest_group(found, rests=0.1 if has_empty else 0.0)
        places = {one.picture for one in marble}
        if len(places) >= FEWEST:
            break
    else:
        raise NoMarbleError(
            "nothing like a marble moves on the board: is it in view, and lit? Otherwise say where it is in "
            "the first picture (--marble X,Y), or its colour (--colour R,G,B)"
        )
    if len(marble) > len(places):
        marble = without_shadow(pictures, marble, blank)
    if len(marble) - len(places) > TWO * len(places):
        first, second = two_of(marble)
        raise IrtError(
            "two marbles move on the board, at pixels "
            f"{first[0]:.0f},{first[1]:.0f} and {second[0]:.0f},{second[1]:.0f} of one picture: take one away"
        )
    ratio = float(np.median([one.rim.radius / scale(one.rim.x, one.rim.y) for one in marble]))
    colours = _colours(pictures, [(one.picture, one.rim) for one in marble], blank.box)
    return replace(blank, colours=colours, radius=ratio)


def _colours(pictures: Sequence[Picture], discs: Sequence[tuple[int, Rim]], box: Box) -> ColourModel:
    """Return the colours of discs beside those of all else on the board."""
    own = [pictures[index][within(pictures[index], rim, 0.85)] for index, rim in discs]
    random = np.random.default_rng(0)
    others = []
    where = dict(discs)
    for index, picture in enumerate(pictures):
        rows = random.integers(box.top, box.bottom, OTHERS)
        columns = random.integers(box.left, box.right, OTHERS)
        if index in where:
            rim = where[index]
            outside = np.hypot(columns - rim.x, rows - rim.y) > 1.3 * rim.radius
            others.append(picture[rows[outside], columns[outside]])
    return ColourModel.learned(np.concatenate(own), np.concatenate(others))


def _given(pictures: Sequence[Picture], clue: Clue, radius: float, box: Box) -> ColourModel:
    """Return the colours that a user has given."""
    first = pictures[0]
    if clue.colour is not None:
        own = shades_of(clue.colour)
    else:
        discs = [Rim(x, y, radius, 1.0, 1.0) for x, y in clue.places]
        inner = np.concatenate([first[within(first, disc, 0.7)] for disc in discs])
        own = np.concatenate(
            [inner, *(shades_of(tuple(pixel)) for pixel in inner[:: max(len(inner) // 6, 1)])]
        )
    rows, columns = box.slices
    return ColourModel.learned(own, first[rows, columns].reshape(-1, 3)[::7])


def _refined(
    pictures: Sequence[Picture], known: Finder, geometry: Geometry, clue: Clue, plain: _Plain
) -> Learned:
    """Return more exactly what is roughly known: the marble's colours, the board without it, its looks."""
    found = _discs(pictures, known)
    if not found:
        raise NoMarbleError("nothing has the marble's colours and its size: is --marble or --colour right?")
    feet = geometry.feet(np.array([[rim.x, rim.y] for _, rim in found])).mean(axis=0)
    foot = float(feet[0]), float(feet[1])
    # What was found may be the marble and a part of its shadow: it is looked at in the marble's own size.
    scale, size = scale_of(geometry, known.middle), geometry.radius_at(known.middle)
    sized = [(index, replace(rim, radius=size * scale(rim.x, rim.y))) for index, rim in found]
    mask = changed(neighbourhoods(plain.pictures, sized, plain.known(known)), plain.noise)
    if reaches_beyond(mask):
        known = replace(known, without=emptied(pictures, known.without, sized, mask))
        plain = replace(plain, without=emptied(plain.pictures, plain.without, sized, mask))
    aside = marble_beside(plain.pictures, sized, plain.known(known), clue, foot)
    alone = not clue.places and clue.colour is None
    try:
        learned, ball = _looked(pictures, known, geometry, (found, aside, foot), plain)
    except NoMarbleError:
        if aside is None or not alone:
            raise
        # Glass, which gathers the light that it takes, has not the shape of a ball and its shadow.
        aside = None
        learned, ball = _looked(pictures, known, geometry, (found, aside, foot), plain)
    if alone and learned.shadow > SHADOW and np.hypot(*ball) > ELSEWHERE:
        # Now that all views lie over each other, a ball beside them is the better explanation.
        x, y = aside or (0.0, 0.0)
        with suppress(NoMarbleError):
            other, _ = _looked(pictures, known, geometry, (found, (x + ball[0], y + ball[1]), foot), plain)
            learned = min(learned, other, key=lambda one: one.shadow)
    if learned.shadow > (plain.shadow if alone else SURELY):
        raise NoMarbleError(
            "what moves on the board is a shadow, and what throws it does not stand out: say where the "
            "marble is in the first picture (--marble X,Y), or take one of a colour that the board lacks"
        )
    return learned


def _looked(
    pictures: Sequence[Picture],
    known: Finder,
    geometry: Geometry,
    where: tuple[list[tuple[int, Rim]], tuple[float, float] | None, tuple[float, float]],
    plain: _Plain,
) -> tuple[Learned, tuple[float, float]]:
    """Return what a marble looks like, and where by its shape the ball is beside it [radii].

    `where` is what was found, the marble beside that or nothing, and its foot beside its middle [radii].
    """
    found, aside, foot = where
    scale, size = scale_of(geometry, known.middle), geometry.radius_at(known.middle)
    radius = (
        float(np.median([rim.radius / scale(rim.x, rim.y) for _, rim in found])) if aside is None else size
    )
    discs = (
        found
        if aside is None
        else [(index, beside(rim, aside, size * scale(rim.x, rim.y))) for index, rim in found]
    )
    known = replace(
        known,
        colours=_colours(pictures, found, known.box),
        without=emptied(pictures, known.without, [*found, *discs]),
    )
    views = [_view(pictures[index], rim, Underlay(known.without), known.noise, scale) for index, rim in discs]
    taken = views
    if plain.pictures is not pictures:
        under = Underlay(plain.without)
        taken = [_view(plain.pictures[index], rim, under, plain.noise, scale) for index, rim in discs]
    # A shape that the views do not confirm is not that of a ball and its shadow.
    for bare in (True, False) if is_bare(plain.pictures, discs, plain.known(known)) else (False,):
        appearance = learn_appearance(
            views, radius, size, known.noise, foot, plain=(taken, plain.noise), bare=bare
        )
        learned = Learned(replace(known, radius=appearance.radius), appearance)
        tracker = Tracker(learned, scale)
        # A match that begins too far from the middle ends elsewhere.
        shift = appearance.shift[0] / appearance.radius, appearance.shift[1] / appearance.radius
        middles = [
            (index, beside(rim, shift, appearance.radius * scale(rim.x, rim.y))) for index, rim in discs
        ]
        matches = [(index, tracker.match(pictures[index], rim.x, rim.y)) for index, rim in middles]
        usual = float(np.median([one.confidence for _, one in matches]))
        if usual >= NEAR:
            break
    clear = [(index, one) for index, one in matches if one.confidence > VIEW]
    if len(clear) < plain.least * len(pictures) or usual < NEAR:
        raise NoMarbleError(
            "what moves on the board looks the same in too few pictures: say where the marble is in the "
            "first picture (--marble X,Y), or take one of a colour that the board lacks"
        )
    if aside is not None or np.hypot(*shift) > BASIN:
        # What was found lies beside the marble by so much on average, after the marble's own looks are known.
        clearly = {index: (one.x, one.y) for index, one in clear or middles}
        offsets = [
            (clearly[index][0] - rim.x, clearly[index][1] - rim.y) for index, rim in found if index in clearly
        ]
        learned = replace(learned, finder=replace(learned.finder, aside=middle_of(offsets)))
    seen = [(index, Rim(one.x, one.y, appearance.radius, 1.0, 1.0)) for index, one in clear]
    laid = Thrown((0.0, 0.0), 0.5)
    if len(seen) >= FEWEST:
        laid = ball_or_shadow(plain.pictures, seen, plain.known(known), foot)
    if laid.shadow > FAINT_SHADOW:
        # The ball is where the other explanation has it with that probability.
        error = float(np.sqrt(laid.shadow)) * laid.apart * appearance.radius
        appearance = replace(appearance, error=max(appearance.error, error))
        learned = replace(learned, appearance=appearance)
    first = _first(pictures, clear, tracker)
    return replace(learned, first=first, usual=usual, shadow=laid.shadow), laid.ball


def _first(
    pictures: Sequence[Picture], clear: Sequence[tuple[int, Match]], tracker: Tracker
) -> tuple[float, float] | None:
    """Return where the marble is in the first picture, followed back from the first clear sight of it."""
    if len(clear) < 2:
        return None
    (first, here), (second, after) = sorted(clear, key=lambda one: one[0])[:2]
    step = np.array([here.x - after.x, here.y - after.y]) / (second - first)
    for index in range(first - 1, -1, -1):
        # The board has moved beneath: each match finds more of how far.
        for _ in range(ROUNDS):
            found = tracker.match(pictures[index], here.x + step[0], here.y + step[1])
        way = np.array([found.x - here.x, found.y - here.y])
        if found.confidence < VIEW or np.hypot(*way) > BACK * tracker.learned.radius:
            return None
        here, step = found, way
    return here.x, here.y


def _view(picture: Picture, rim: Rim, under: Underlay, noise: float, scale: Scale) -> View:
    """Return a part of a picture with a disc in it."""
    box = Box.about(rim.x, rim.y, MARGIN * rim.radius, Box(0, 0, picture.shape[1], picture.shape[0]))
    part = picture[box.slices].astype(np.float32)
    board = under.beneath(part, box, (rim.x, rim.y, rim.radius), noise, ROUNDS)
    return View(part, board, rim.x - box.left, rim.y - box.top, scale(rim.x, rim.y))


def _discs(pictures: Sequence[Picture], known: Finder) -> list[tuple[int, Rim]]:
    """Return the marble's disc in the pictures that show it, with the picture's number.

    Where nothing differs from the board it may rest where it does in most pictures. It is the marble then,
    and not painted, if in other pictures there is something else.
    """
    alone = replace(known, anew=False)
    discs = []
    for index, picture in enumerate(pictures):
        rims = _rims(picture, known)
        if not rims:
            rims = [rim for rim in _rims(picture, alone) if _leaves(pictures, rim, known)]
        if rims:
            discs.append((index, max(rims, key=lambda rim: rim.confidence)))
    return discs


def _rims(picture: Picture, known: Finder) -> list[Rim]:
    """Return the discs of the marble's colours in a picture."""
    rims = []
    for x, y in known.places(picture, known.box, MANY):
        box = Box.about(x, y, MARGIN * known.radius, Box(0, 0, picture.shape[1], picture.shape[0]))
        part = picture[box.slices]
        layers = np.dstack([part, known.colours.likeness(part) / np.float32(255.0)]).astype(np.float32)
        rim = fit_rim(layers, known.noise, (x - box.left, y - box.top), known.radius)
        if rim.confidence > VIEW:
            rims.append(replace(rim, x=rim.x + box.left, y=rim.y + box.top))
    return rims


def _leaves(pictures: Sequence[Picture], rim: Rim, known: Finder) -> bool:
    """Return whether in a tenth of the pictures there is none of the marble's colours where a disc is."""
    place = within(pictures[0], rim, 0.8)
    alike = [float((known.colours.likeness(picture[place]) > 127).mean()) for picture in pictures]
    return float(np.mean(np.array(alike) < 0.3)) > 0.1
