"""The marble and its shadow, which move together: which of what was found is which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.background import ROUNDS, Underlay
from irt.tracking.blob_detector import Box
from irt.tracking.edge_fit import Rim
from irt.tracking.finder import Finder
from irt.tracking.shading import ELSEWHERE, Thrown, thrown
from irt.tracking.shadow import ASIDE, CELLS, REACH, Neighbourhood, cut_out, transmission

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Colours so far apart are one marble's [levels].
SAME = 45.0
#: Pictures from which something can be said.
FEWEST = 3
#: Two things whose offset scatters by less than this keep step [radii]: rims are found to a tenth, and a lamp
#: half a metre away turns a shadow by as much over the board.
STEP = 0.25
#: Chances of a shadow between this and one less this leave it open which of the two was found.
UNSURE = 0.01
#: A ball that is farther beside what was found is looked at once more [radii].
FAR = 1.0
#: A user points at a marble to within its radius, less what an unsteady hand misses [radii].
POINTED = 0.75


class NoMarbleError(IrtError):
    """Nothing like a marble is in the pictures."""


@dataclass(frozen=True)
class Clue:
    """What a user says of the marble: places in the first picture [pixels], or its colour (blue first)."""

    places: tuple[tuple[float, float], ...] = ()
    colour: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Candidate:
    """A disc in one picture of the sample, with the median colour (3,) of its inner part."""

    picture: int
    rim: Rim
    colour: Array


def largest_group(found: Sequence[Candidate], rests: float) -> list[Candidate]:
    """Return the candidates of the colour that most of them share, in most places.

    `rests` is what a marble that does not move is worth; on a board that nobody saw empty, nothing.
    """
    if not found:
        return []
    colours = np.array([one.colour for one in found])
    places = np.array([[one.rim.x, one.rim.y] for one in found])
    apart = np.linalg.norm(colours[:, None] - colours[None], axis=2)
    best: list[int] = []
    most = 0.0
    for row in range(len(found)):
        group = [int(one) for one in np.flatnonzero(apart[row] < SAME)]
        pictures = len({found[one].picture for one in group})
        # What stays in one place is a part of the board that moves with its tilt.
        moved = float(np.hypot(*np.std(places[group], axis=0))) / max(found[row].rim.radius, 1.0)
        worth = pictures * (min(moved, 2.0) + rests)
        if worth > most:
            best, most = group, worth
    return [found[one] for one in best]


def two_of(marble: Sequence[Candidate]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return two places of one picture."""
    for one in marble:
        for other in marble:
            if one.picture == other.picture and one is not other:
                return (one.rim.x, one.rim.y), (other.rim.x, other.rim.y)
    raise ValueError("no picture has two")


def without_shadow(
    pictures: Sequence[Picture], marble: Sequence[Candidate], known: Finder
) -> list[Candidate]:
    """Return candidates of one colour without a shadow that is among them; all of them where there is none.

    Two marbles do not keep step: what is at one offset from another thing in all pictures is a shadow of it,
    or throws it.
    """
    pairs = []
    for index in {one.picture for one in marble}:
        both = [one for one in marble if one.picture == index]
        if len(both) == 2:
            pairs.append(both)
    if len(pairs) < FEWEST:
        return list(marble)
    ways = np.array([[one.rim.x - two.rim.x, one.rim.y - two.rim.y] for one, two in pairs])
    # Which of the two comes first is chance.
    turned = np.where(ways @ ways[np.argmax((ways**2).sum(axis=1))] < 0.0, -1.0, 1.0)
    offsets = turned[:, None] * ways
    middle = np.median(offsets, axis=0)
    apart = np.median(np.abs(offsets - middle))
    if apart > STEP * known.radius or np.hypot(*middle) > ASIDE * known.radius:
        return list(marble)
    ends = [
        [pair[0] if way > 0 else pair[1] for pair, way in zip(pairs, turned, strict=True)],
        [pair[1] if way > 0 else pair[0] for pair, way in zip(pairs, turned, strict=True)],
    ]
    chances = [
        ball_or_shadow(pictures, [(one.picture, one.rim) for one in end], known).shadow for end in ends
    ]
    kept = int(np.argmin(chances))
    own, other = (np.median([one.colour for one in ends[end]], axis=0) for end in (kept, 1 - kept))
    return [
        one
        for one in marble
        if not any(one is two for two in ends[1 - kept])
        and np.linalg.norm(one.colour - own) <= np.linalg.norm(one.colour - other)
    ]


def marble_beside(
    pictures: Sequence[Picture],
    found: Sequence[tuple[int, Rim]],
    known: Finder,
    clue: Clue,
    foot: tuple[float, float],
) -> tuple[float, float] | None:
    """Return where the marble is beside what was found (dx, dy) [radii], None where that is the marble.

    `found` has the marble's own radius; `foot` is where a marble touches the board, beside its middle in a
    picture [radii].
    """
    if clue.places:
        index, rim = found[0]
        x, y = min(clue.places, key=lambda place: np.hypot(place[0] - rim.x, place[1] - rim.y))
        dx, dy = (x - rim.x) / rim.radius, (y - rim.y) / rim.radius
        away = float(np.hypot(dx, dy)) if index == 0 else 0.0
        if away > ASIDE:
            raise NoMarbleError(
                f"what looks like the marble at {x:.0f},{y:.0f} is at {rim.x:.0f},{rim.y:.0f} in the first "
                "picture: is --marble right?"
            )
        return (float(dx), float(dy)) if away > POINTED else None
    if clue.colour is not None or len(found) < FEWEST:
        return None
    around = neighbourhoods(pictures, found, known)
    through = transmission(around)
    if through.is_no_shadow or through.chance_of_shadow < UNSURE:
        return None
    if through.chance_of_shadow > 1.0 - UNSURE:
        return through.opaque()
    # The board's texture does not say which of the two this is. The shape of the two does.
    x, y = _laid(around, foot).ball
    if np.hypot(x, y) > FAR:
        # What is in the middle of what is seen is laid best.
        moved = [(index, beside(rim, (x, y), rim.radius)) for index, rim in found]
        dx, dy = _laid(neighbourhoods(pictures, moved, known), foot).ball
        x, y = x + dx, y + dy
    return (x, y) if float(np.hypot(x, y)) > ELSEWHERE else None


def beside(rim: Rim, aside: tuple[float, float], radius: float) -> Rim:
    """Return a disc of a radius beside another."""
    return Rim(rim.x + aside[0] * radius, rim.y + aside[1] * radius, radius, 1.0, 1.0)


def middle_of(offsets: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the median (dx, dy) of offsets."""
    x, y = np.median(np.array(offsets), axis=0)
    return float(x), float(y)


def ball_or_shadow(
    pictures: Sequence[Picture],
    discs: Sequence[tuple[int, Rim]],
    known: Finder,
    foot: tuple[float, float] = (0.0, 0.0),
) -> Thrown:
    """Return the chance that discs are a shadow, and where the ball is beside them.

    By how much of the board's texture is seen through them; where that leaves it open, by the shape of what
    is there as well. `foot` is as in `marble_beside`.
    """
    around = neighbourhoods(pictures, discs, known)
    through = transmission(around)
    chance = through.chance_of_shadow
    if through.is_no_shadow or not UNSURE < chance < 1.0 - UNSURE:
        return Thrown((0.0, 0.0), chance)
    shape = _laid(around, foot)
    return replace(
        shape, shadow=chance * shape.shadow / (chance * shape.shadow + (1.0 - chance) * (1.0 - shape.shadow))
    )


def is_bare(pictures: Sequence[Picture], discs: Sequence[tuple[int, Rim]], known: Finder) -> bool:
    """Return whether the board about discs shows no texture."""
    return not bool(np.isfinite(transmission(neighbourhoods(pictures, discs, known)).error).all())


def _laid(around: Sequence[Neighbourhood], foot: tuple[float, float]) -> Thrown:
    """Return the ball that is in the middle of neighbourhoods, or throws the shadow there."""
    return thrown(*cut_out(around), CELLS, foot)


def neighbourhoods(
    pictures: Sequence[Picture], discs: Sequence[tuple[int, Rim]], known: Finder
) -> list[Neighbourhood]:
    """Return discs with what is around them."""
    return [
        _neighbourhood(pictures[index], rim, Underlay(known.without), known.noise) for index, rim in discs
    ]


def _neighbourhood(picture: Picture, rim: Rim, under: Underlay, noise: float) -> Neighbourhood:
    """Return a disc with what is beside it."""
    box = Box.about(rim.x, rim.y, REACH * rim.radius, Box(0, 0, picture.shape[1], picture.shape[0]))
    part = picture[box.slices].astype(np.float32)
    board = under.beneath(part, box, (rim.x, rim.y, rim.radius), noise, ROUNDS)
    return Neighbourhood(part, board, rim.x - box.left, rim.y - box.top, rim.radius)
