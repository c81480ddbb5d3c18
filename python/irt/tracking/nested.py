"""An outline within an outline: a board within its rim, or a printed border within a board.

What stands out in a picture may be a rim about the board. Within it the board's own sides are steps of colour
that run along all of a side, and so are printed lines. A picture without such steps shows no rim.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.corners import like_a_rim, mean_side, meet, misshapen, widened
from irt.tracking.geometry import Lens, Plane, Pose, Size
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Stretches of a side, the part of it that they lie on, and points of each: the median of a stretch has no
#: grain, and what lies over a part of a side spoils some of them only.
STRETCHES, FIRST, LAST, POINTS = 12, 0.14, 0.86, 16
#: Steps are looked for from here on, where a lens has blurred the outline itself, at such distances [pixels],
#: and to here, as a share of a side: a rim of a tenth of a board on each side.
BLURRED, FINE, DEEP = 3.0, 0.5, 0.1
#: Levels by which colours differ over 2 pixels at a step, and how many steps of a side are looked at.
STEP, MOST = 6.0, 4
#: A step is in this share of a side's stretches, within so many pixels of a line through them.
ENOUGH, ALONG = 0.6, 1.5
#: By what share of its sides a board's own outline misses its shape in pictures: two that both miss it by
#: less may both be the board's.
ALIKE = 0.0009
#: Most outlines within each other that are looked for: those of a case, a frame and a rim have two each.
DEEPEST = 6
#: A rim seen aslant is narrower on one side by at most so much: one as high as wide, under 30 degrees.
UNEVEN = 4.0


class AmbiguousBoardError(IrtError):
    """Which of the outlines in a picture is the board's is not known.

    Attributes
    ----------
    picture : (h, w, 3) uint8 array
        In which they were found.
    outlines : sequence of (4, 2) arrays
        Their corners, as `Size.corners` are ordered, from the outermost inward [pixels].
    """

    def __init__(self, said: str, picture: Picture, outlines: Sequence[Array]) -> None:
        super().__init__(said)
        self.picture, self.outlines = picture, outlines


@dataclass(frozen=True, eq=False)
class Nested:
    """An outline within another.

    Attributes
    ----------
    corners : (4, 2) array
        In the order of the outer ones [pixels].
    width : float
        Of the rim between the two, if this one is the board's [board edges].
    """

    corners: Array
    width: float


@dataclass(frozen=True, eq=False)
class _Step:
    """A line along a side, in the plane of the outline: a point and a direction, and how far in it is."""

    line: tuple[Array, Array]
    inset: float


def require_board(picture: Picture, outline: Array, lens: Lens | None, size: Size) -> None:
    """Refuse an outline that may as well be that of a rim about the board.

    Parameters
    ----------
    picture : (h, w, 3) uint8 array
        Without noise to speak of, such as the median of a sample.
    outline : (4, 2) array
        Corners, as `Size.corners` are ordered, to less than `MISSHAPEN` [pixels].
    lens : Lens or None
        Of the camera; without one nothing is known of a shape.
    size : Size
        Of the board.

    Raises
    ------
    AmbiguousBoardError
        If its shape is a rim's, or if another outline lies within it and its shape may be either's.
    """
    within = nested(picture, outline, lens, size)
    if lens is not None and like_a_rim(outline, lens, size):
        said = (
            "what was found in the picture is not of the board's shape; it may be its rim, or its edge: "
            "--corners X,Y X,Y X,Y X,Y says where the board is. If it is the board, its lengths in rig.toml "
            "or the calibration of the lens are wrong"
        )
    elif within is None:
        return
    elif lens is None:
        said = (
            "outlines lie within each other, and without a calibrated lens (--lens) their shape does not say "
            "which is the board's, and which that of a rim, a frame or a printed border: --corners X,Y X,Y "
            "X,Y X,Y says where the board is"
        )
    else:
        as_a_rim = misshapen(outline, lens, widened(size, within.width))
        if as_a_rim > max(misshapen(outline, lens, size), ALIKE):
            return
        said = (
            "two outlines lie within each other, and their shape does not say which is the board's and which "
            "that of a rim or of a printed border: "
            f"--corners {given(outline)} is the outer one, {given(within.corners)} about the inner one"
        )
    outlines = [outline]
    while within is not None and len(outlines) < DEEPEST:
        outlines.append(within.corners)
        within = nested(picture, within.corners, lens, size)
    raise AmbiguousBoardError(said, picture, outlines)


def given(corners: Array) -> str:
    """Return corners (4, 2) [pixels] as --corners takes them."""
    return " ".join(f"{round(x)},{round(y)}" for x, y in corners)


def nested(picture: Picture, outline: Array, lens: Lens | None, size: Size) -> Nested | None:
    """Return the outline within another that is as far in on all sides, None where there is none.

    Parameters
    ----------
    picture : (h, w, 3) uint8 array
        Without noise to speak of, such as the median of a sample.
    outline : (4, 2) array
        Corners, as `Size.corners` are ordered [pixels].
    lens : Lens or None
        Of the camera.
    size : Size
        Of the board.
    """
    shown = _shown_by(outline, lens, size)
    pixel = 1.0 / mean_side(outline)
    sides = [_steps(picture, shown, size, side, pixel) for side in range(4)]

    def uneven(chosen: tuple[_Step, ...]) -> float:
        insets = [one.inset for one in chosen]
        return max(insets) / min(insets)

    best = min(product(*sides), key=uneven, default=None)
    if best is None or uneven(best) > UNEVEN:
        return None
    flat = np.array([meet(best[side - 1].line, best[side].line) for side in range(4)])
    inset = float(np.mean([one.inset for one in best]))
    return Nested(shown(flat), inset / (1.0 - 2.0 * inset))


def _shown_by(outline: Array, lens: Lens | None, size: Size) -> Callable[[Array], Array]:
    """Return the map from the plane of an outline (n, 2) [board edges] to the picture (n, 2) [pixels]."""
    if lens is None:
        return Plane.of(outline, size).pixels
    pose = Pose.of(lens, outline, size.corners, 0.0)
    return lambda flat: pose.project(np.column_stack([flat, np.zeros(len(flat))]))


def _steps(
    picture: Picture, shown: Callable[[Array], Array], size: Size, side: int, pixel: float
) -> list[_Step]:
    """Return the steps that run along a side; `pixel` is the length of one [board edges]."""
    start, end = size.corners[side], size.corners[(side + 1) % 4]
    way = (end - start) / np.linalg.norm(end - start)
    inward = np.array([way[1], -way[0]])
    parts = np.linspace(FIRST, LAST, STRETCHES * POINTS)
    insets = np.arange(BLURRED * pixel, DEEP, FINE * pixel)
    places = (start + parts[:, None] * (end - start))[:, None] + insets[:, None] * inward
    maps = shown(places.reshape(-1, 2)).reshape(len(parts), len(insets), 2).astype(np.float32)
    seen = opencv().remap(picture, maps[..., 0], maps[..., 1], opencv().INTER_LINEAR)
    levels = np.median(seen.reshape(STRETCHES, POINTS, len(insets), 3), axis=1)
    # Colours beside a place, a pixel to either side.
    reach = round(1.0 / FINE)
    change = levels[:, 2 * reach :] - levels[:, : -2 * reach]
    usual = np.linalg.norm(np.median(change, axis=0), axis=1)
    middles = insets[reach:-reach]
    peaks = [
        one
        for one in range(1, len(usual) - 1)
        if usual[one] >= max(usual[one - 1], usual[one + 1]) and usual[one] > STEP
    ]
    along = start + parts.reshape(STRETCHES, POINTS).mean(axis=1)[:, None] * (end - start)
    steps = []
    for peak in sorted(peaks, key=lambda one: -usual[one])[:MOST]:
        step = _laid(change, middles, peak, (along, way, inward), pixel)
        if step is not None:
            steps.append(step)
    return steps


def _laid(
    change: Array, insets: Array, peak: int, side: tuple[Array, Array, Array], pixel: float
) -> _Step | None:
    """Return the line through a step in the stretches of a side, None where it is in too few of them."""
    along, way, inward = side
    direction = np.median(change[:, peak], axis=0)
    strength = np.maximum(change @ (direction / np.linalg.norm(direction)), 0.0)
    apart = (insets - insets[peak]) / (ALONG * pixel)
    near = strength * np.exp(-0.5 * apart**2)
    clear = near.max(axis=1) > 0.5 * np.linalg.norm(direction)
    if clear.mean() < ENOUGH:
        return None
    at = (near @ insets) / (near.sum(axis=1) + 1e-9)
    places = (along + at[:, None] * inward)[clear]
    middle = places.mean(axis=0)
    for _ in range(5):
        off = (places - middle) @ inward
        slope = (places - middle) @ way
        line = np.polyfit(slope, off, 1, w=1.0 / (1.0 + (off / pixel) ** 2))
        middle, inward = middle + line[1] * inward, inward - line[0] * way
        inward = inward / np.linalg.norm(inward)
        way = np.array([-inward[1], inward[0]])
    return _Step((middle, way), float(insets[peak]))
