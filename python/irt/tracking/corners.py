"""The board's four corners: found in a picture, or given, and put in order.

Pixels are counted from the middle of the first one, to the right and down.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.geometry import Lens, Pose, Size
from irt.tracking.noise import noise_of
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Least difference that is a side of the board [levels], over so many quarters of a pixel to either side,
#: where nothing is known of the noise: three deviations of a noise of 4 levels, with which a point of an edge
#: that is blurred over 2 pixels is known to 0.7 pixels, and a line through a side to 0.3.
LEAST_LEVELS, BLURRED = 12.0, 6
#: The same in standard deviations of the noise, and the least of these [levels]: what a compression makes of
#: an even board has steps of a few levels (`irt.tracking.nested.STEP`).
LEAST_NOISES, FAINTEST = 3.0, 6.0
#: Every so many pixels show the noise of a sample.
SPARSE = 2
#: How far a side is from the rough one (standard deviation) [pixels]: of two steps it is the nearer one,
#: unless that is much lower.
ROUGH = 1.5
#: Rounds in which a step's middle is found between the levels on both sides of it: each halves its error.
ROUNDS = 6
#: A board fills at least this share of the picture.
LEAST_SHARE = 0.04
#: Its outline fills its four corners' quadrangle at least so far: nothing large stands out or lies over it.
FILLED = 0.93
#: A camera that looks at a board aslant by 40 degrees shortens one of its sides by so much.
SHORTENED = 1.0 / np.cos(np.deg2rad(40.0))
#: A second outline of this share of the first one's area may be the board as well: a camera that looks aslant
#: by 40 degrees shows the farther of two boards smaller by about as much.
ALIKE = 0.5
#: Sides that show a board turned by a quarter: the ratio of its sides, this near to the inverse.
TURNED = 1.04
#: By what share of its sides an outline may miss the board's shape: the board's own misses it by 0.0001 to
#: 0.0009 in path-traced runs with their true lens, that of a rim of 5 mm about a board of the paper's size by
#: 0.002. One that misses it by less than half of another is the board's.
MISSHAPEN, NEARER = 0.0015, 0.5
#: Beyond this, no lens accounts for it: one whose middle is off by 20 pixels makes 0.001 to 0.004.
HOPELESS = 0.0045
#: Focal lengths of lenses from wide angles to telephoto [widths of a picture].
FOCAL = np.geomspace(0.5, 8.0, 9)
#: Levels that may outline a board, as quantiles of a picture's; how many must agree, their corners within so
#: many pixels: a shadow's end and the marble's path move with the level, a board does not.
LEVELS = np.linspace(0.05, 0.95, 31)
AGREEING, SAME_PX = 3, 4.0
#: Widths of rims that may explain an outline [board edges].
RIMS = np.arange(1, 21) * 0.004


class TwoBoardsError(IrtError):
    """More than one thing in the picture may be the board."""


def least_step(pictures: Sequence[Picture]) -> float:
    """Return the least difference that is a side of the board in the noise of some pictures [levels]."""
    some = [one[::SPARSE, ::SPARSE] for one in pictures]
    noise = noise_of(some, np.median(np.stack(some), axis=0).astype(np.uint8))
    return float(np.clip(LEAST_NOISES * noise, FAINTEST, LEAST_LEVELS))


def find_corners(
    picture: Picture,
    lens: Lens | None = None,
    size: Size | None = None,
    *,
    by_colour: bool = False,
    least: float = LEAST_LEVELS,
) -> Array:
    """Return the board's corners (4, 2) [pixels], clockwise from the top left, of a quadrangle.

    Its sides are lines fitted to its outline, so that a corner is where two of them meet.

    Parameters
    ----------
    picture : (h, w, 3) uint8 array
        Blue first.
    lens : Lens, optional
        Of the camera: its sides are straight only where the lens is taken into account.
    size : Size, optional
        Of the board: what has another shape, such as the board's shadow on a table, is not it.
    by_colour : bool
        Whether how colourful it is sets the board off, and not its brightness: wood on grey is as bright.
    least : float
        Least difference that is a side of the board [levels].

    Raises
    ------
    IrtError
        If there is no such quadrangle.
    TwoBoardsError
        If there are two of nearly one size.
    """
    cv2 = opencv()
    if by_colour:
        plane = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)[:, :, 1]
    else:
        plane = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    smooth = cv2.GaussianBlur(plane, (3, 3), 0)
    _, bright = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    reasons = []
    for mask in (bright, 255 - bright):
        try:
            rough = _quadrangle(mask, size)
        except TwoBoardsError:
            raise
        except IrtError as error:
            reasons.append(error)
            continue
        return _exact(smooth, rough, lens, least)
    raise reasons[0]


def find_corners_at_levels(
    picture: Picture, lens: Lens | None, size: Size | None, least: float = LEAST_LEVELS
) -> Array:
    """Return the board's corners as `find_corners`, of the quadrangle that most levels show.

    On a table that a lamp lights unevenly, or under glare, no one level separates a board. A board is what
    many levels of several colours outline alike.

    Parameters
    ----------
    picture : (h, w, 3) uint8 array
        Blue first, with little noise, such as the median of a sample.
    lens, size, least
        As of `find_corners`.

    Raises
    ------
    IrtError
        If fewer than `AGREEING` levels do.
    """
    cv2 = opencv()
    smooth = cv2.GaussianBlur(picture, (5, 5), 0)
    planes = [*cv2.split(smooth), cv2.cvtColor(smooth, cv2.COLOR_BGR2HSV)[:, :, 1]]
    found: list[tuple[Array, Any]] = []
    for plane in planes:
        for level in np.unique(np.quantile(plane[::4, ::4], LEVELS).astype(int)):
            bright = np.where(plane > level, 255, 0).astype(np.uint8)
            for mask in (bright, 255 - bright):
                outlines, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
                for outline in outlines:
                    if cv2.contourArea(outline) > LEAST_SHARE * mask.size:
                        with suppress(IrtError):
                            found.append((_board_outline(outline, mask, size), plane))
    alike = [[other for other in found if np.abs(other[0] - one[0]).max() < SAME_PX] for one in found]
    best = max(alike, key=len, default=[])
    if len(best) < AGREEING:
        raise IrtError("no quadrangle that several levels outline")
    rough = np.median([corners for corners, _ in best], axis=0)
    for plane in sorted({id(plane): plane for _, plane in best}.values(), key=lambda one: -float(one.std())):
        with suppress(IrtError):
            return _exact(plane, rough, lens, least)
    raise IrtError("a side of the board is not clear in the picture: give it light, or a darker ground")


def _exact(plane: Any, rough: Array, lens: Lens | None, least: float) -> Array:
    """Return the corners (4, 2) in which lines through the sides of a rough quadrangle meet [pixels]."""
    sides = [_edge(plane, (rough[side], rough[(side + 1) % 4]), lens, least) for side in range(4)]
    corners = np.array([meet(sides[side - 1], sides[side]) for side in range(4)])
    return corners if lens is None else lens.bent(corners)


def _quadrangle(mask: Any, size: Size | None) -> Array:
    """Return the rough corners (4, 2) of the largest thing in a mask that is one."""
    cv2 = opencv()
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest, *others = sorted(outlines, key=cv2.contourArea, reverse=True) or [None]
    corners = _board_outline(largest, mask, size)
    if others and cv2.contourArea(others[0]) > ALIKE * cv2.contourArea(largest):
        try:
            other = _board_outline(others[0], mask, size)
        except IrtError:
            return corners
        places = " and ".join(f"{x:.0f},{y:.0f}" for x, y in (corners.mean(axis=0), other.mean(axis=0)))
        raise TwoBoardsError(
            f"two things in the picture may be the board, about pixels {places}: cover one, or say with "
            "--corners where the board is"
        )
    return corners


def _board_outline(largest: Any, mask: Any, size: Size | None) -> Array:
    """Return the rough corners (4, 2) of an outline in a mask that may be a board."""
    cv2 = opencv()
    if largest is None or cv2.contourArea(largest) < LEAST_SHARE * mask.size:
        raise IrtError("no board in the picture: expected a bright one on a dark ground, or the reverse")
    hull = cv2.convexHull(largest)
    rough = cv2.approxPolyDP(hull, 0.03 * cv2.arcLength(hull, True), True).reshape(-1, 2)
    if len(rough) != 4:
        raise IrtError(f"the board in the picture has {len(rough)} corners: all four have to be in view")
    height, width = mask.shape
    inside = (rough > 1).all() and (rough[:, 0] < width - 2).all() and (rough[:, 1] < height - 2).all()
    if not inside or cv2.contourArea(largest) < FILLED * cv2.contourArea(rough):
        raise IrtError("no board in the picture whose four sides are all in view, with nothing over them")
    corners = _clockwise(rough.astype(np.float64))
    if size is not None:
        apart = abs(np.log(_ratio(*_sides(corners)) / _ratio(size.along_x, size.along_y)))
        if apart > np.log(SHORTENED):
            raise IrtError("no board in the picture whose sides are as long beside each other as the rig's")
    return corners


def ordered(corners: Array, size: Size) -> Array:
    """Return found corners (4, 2), turned where the long side of the picture's board is the other one."""
    across, down = _sides(corners)
    if (across - down) * (size.along_x - size.along_y) < 0 and _ratio(across, down) > TURNED:
        return np.roll(corners, -1, axis=0)
    return corners


def misshapen_before_any(corners: Array, size: Size, picture: tuple[int, int]) -> float:
    """Return by what share of its sides an outline (4, 2) [pixels] is not the board's before any simple lens.

    Its focal length is unknown, its axis is the picture's middle, and it does not distort. What real lenses
    do is up to 0.01 of a side, so that only a comparison of outlines means anything.

    Parameters
    ----------
    picture : (width, height)
        [pixels].
    """
    middle = (np.array(picture) - 1.0) / 2.0

    def before(focal: float) -> float:
        matrix = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
        return misshapen(corners, Lens(matrix, np.zeros(5), picture, 0.0), size)

    return min(before(focal * picture[0]) for focal in FOCAL)


def misshapen(corners: Array, lens: Lens | None, size: Size) -> float:
    """Return by what share of its sides an outline (4, 2) [pixels] is not of the board's shape.

    Without a lens any outline is, so that this is 0.
    """
    if lens is None:
        return 0.0
    pose = Pose.of(lens, corners, size.corners, size.radius)
    apart = pose.project(np.column_stack([size.corners, np.zeros(4)])) - corners
    return float(np.sqrt((apart**2).sum(axis=1).mean())) / mean_side(corners)


def like_a_rim(corners: Array, lens: Lens | None, size: Size) -> bool:
    """Return whether an outline (4, 2) [pixels] is not the board's by its shape, but rather that of a rim.

    A lens that is not well known changes a board's shape as well, and seldom as a rim does.
    """
    missed = misshapen(corners, lens, size)
    if not MISSHAPEN < missed <= HOPELESS:
        return missed > HOPELESS
    return min(misshapen(corners, lens, widened(size, rim)) for rim in RIMS) < NEARER * missed


def widened(size: Size, rim: float) -> Size:
    """Return the size of a rim's outline about a board, the rim so wide [board edges]."""
    return Size(size.along_x + 2.0 * rim, size.along_y + 2.0 * rim, size.radius)


def mean_side(corners: Array) -> float:
    """Return the mean length of an outline's sides [pixels]."""
    return float(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).mean())


def checked(corners: Sequence[tuple[float, float]], size: Size) -> Array:
    """Return corners given by a user as an array (4, 2).

    Raises
    ------
    IrtError
        If they are not four, cross, or go around the other way, or if the first side is the board's short
        one.
    """
    if len(corners) != 4:
        raise IrtError(f"expected four corners, found {len(corners)}")
    array = np.array(corners, dtype=np.float64)
    ways = np.roll(array, -1, axis=0) - array
    after = np.roll(ways, -1, axis=0)
    turns = ways[:, 0] * after[:, 1] - ways[:, 1] * after[:, 0]
    order = "give them clockwise as the picture shows them, the first where x is least and y is greatest"
    if (turns < 0).all():
        raise IrtError(f"the corners go around anticlockwise: {order}")
    if not (turns > 0).all():
        raise IrtError(f"the corners' sides cross, or three of them lie in a line: {order}")
    across, down = _sides(array)
    wanted = size.along_x / size.along_y
    if (
        abs(np.log(wanted)) > np.log(TURNED)
        and (across / down) * wanted < TURNED
        and (across / down) > 1 / (TURNED * wanted)
    ):
        raise IrtError(
            f"the first side, from corner 1 to 2, is {across / down:.2f} times the second, but the board's "
            "long edge comes first: begin one corner later"
        )
    return array


def _sides(corners: Array) -> tuple[float, float]:
    """Return the mean length of the first and third side, and of the others [pixels]."""
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return float(lengths[[0, 2]].mean()), float(lengths[[1, 3]].mean())


def _ratio(one: float, other: float) -> float:
    return max(one, other) / min(one, other)


def _edge(grey: Any, ends: tuple[Array, Array], lens: Lens | None, least: float) -> tuple[Array, Array]:
    """Return a point and a direction of the side between two rough corners: where brightness is halfway.

    With a lens, both are of tangents.
    """
    start, end = ends
    way = end - start
    normal = np.array([way[1], -way[0]]) / np.hypot(*way)
    offsets = np.arange(-4.0, 4.01, 0.25)
    far = 0.25 * BLURRED
    near = np.exp(-0.5 * (offsets[BLURRED:-BLURRED] / ROUGH) ** 2)
    found = []
    for part in np.linspace(0.08, 0.92, 80):
        points = start + part * way + offsets[:, None] * normal
        levels = _read(grey, points)
        # A printed line beside a side, or the end of a shadow, is another step.
        steps = np.abs(levels[2 * BLURRED :] - levels[: -2 * BLURRED])
        best = int(np.argmax(steps * near))
        if steps[best] < least:
            continue
        at = offsets[best + BLURRED]
        for _ in range(ROUNDS):
            halfway = np.interp([at - far, at + far], offsets, levels).mean()
            falls = np.nonzero((levels[:-1] - halfway) * (levels[1:] - halfway) <= 0.0)[0]
            first = falls[np.argmin(np.abs(offsets[falls] - at))]
            step = levels[first + 1] - levels[first]
            at = offsets[first] + 0.25 * (halfway - levels[first]) / (step or 1.0)
        found.append(start + part * way + at * normal)
    if len(found) < 10:
        raise IrtError("a side of the board is not clear in the picture: give it light, or a darker ground")
    return fit_line(np.array(found), lens)


def fit_line(points: Array, lens: Lens | None) -> tuple[Array, Array]:
    """Return a point and a direction of the line through pixels (n, 2); with a lens, of tangents."""
    # OpenCV's robust distances are made for pixels.
    scale = 1.0 if lens is None else float(lens.matrix[0, 0])
    points = points if lens is None else lens.straight(points) * scale
    vx, vy, x, y = opencv().fitLine(points.astype(np.float32), opencv().DIST_L12, 0, 0.01, 0.01).ravel()
    x, y = x / scale, y / scale
    return np.array([x, y], dtype=np.float64), np.array([vx, vy], dtype=np.float64)


def _read(grey: Any, points: Array) -> Array:
    """Return brightness at points (n, 2) between pixels."""
    u = np.clip(points[:, 0], 0, grey.shape[1] - 1.001)
    v = np.clip(points[:, 1], 0, grey.shape[0] - 1.001)
    column, row = u.astype(int), v.astype(int)
    u, v = u - column, v - row
    level = grey.astype(np.float64)
    above = level[row, column] * (1 - u) + level[row, column + 1] * u
    below = level[row + 1, column] * (1 - u) + level[row + 1, column + 1] * u
    return np.asarray(above * (1 - v) + below * v)


def meet(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return where two lines cross."""
    (start, way), (begin, across) = one, other
    parts = np.linalg.solve(np.stack([way, -across], axis=1), begin - start)
    return np.asarray(start + parts[0] * way)


def _clockwise(corners: Array) -> Array:
    """Return corners (4, 2) in order, from that nearest to the picture's top left."""
    about = corners - corners.mean(axis=0)
    corners = corners[np.argsort(np.arctan2(about[:, 1], about[:, 0]))]
    return np.roll(corners, -int(np.argmin(corners.sum(axis=1))), axis=0)
