"""The board's sides, measured along their whole length over the video: corners, their error, the tilt.

Each point of a side is where the light is halfway between inside and outside. A lens blurs light, not levels:
halfway between two levels lies outside of a bright board. So levels are taken back to light. Inside and
outside are the even parts of a profile on both sides of the edge's own step: a line printed along the board's
side, a thick edge seen aslant, or the end of a shadow is another step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.corners import fit_line, least_step, meet
from irt.tracking.geometry import Geometry, Lens, Pose, Size
from irt.tracking.opencv import opencv
from irt.tracking.rims import POWER

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Points of a side, and the part of it that they lie on: near corners a side is not alone.
POINTS, FIRST, LAST = 48, 0.06, 0.94
#: How far beside a side its edge is looked for, where sides are so long on average [pixels], and in how many
#: steps: a tilt of 0.04 rad moves the end of such a board by 2. On a larger one it is farther.
FAR, LENGTH, STEPS = 5.0, 330.0, 20
#: Samples on each side of an edge that say what is inside and outside.
ENDS = 4
#: Samples on each side of a step over which its height is measured: a lens blurs it over 2 pixels.
BLURRED = 3
#: How far a side is from where it was found, or in the picture before (standard deviation) [pixels of a side
#: of `LENGTH`]: of two steps it is the one nearer to that, unless that is much lower.
ROUGH = 1.5
#: Slope of a profile, over that of its edge, from which on another step begins, and below which the edge
#: ends.
ANOTHER, LEVEL = 0.25, 0.15
#: Points of a side that err alike: they share the grain, and blocks of a compression.
ALIKE = 8.0
#: A side is measured where this share of its points is.
ENOUGH = 0.6
#: An edge that is off by more than so much is covered [pixels]: repeated edges scatter by a tenth.
COVERED = 0.3
#: The same for steps, which are known to half a pixel, about a line that the tilt has turned.
ROUGHLY = 1.0
#: A point that is off its side's curve by more than so much is not of it [pixels]: a grain moves it by half.
OFF = 1.0
#: Rounds in which a straight line is laid through a side, and then a bent one.
STRAIGHT = 8
#: Rounds in which the tilt lets go of points that are off.
ROUNDS = 6


@dataclass(frozen=True, eq=False)
class _Sides:
    """Points along four sides, outward normals (n, 2), and how far out edges are looked for [pixels]."""

    points: Array
    normals: Array
    far: float

    @classmethod
    def of(cls, corners: Array, lens: Lens | None) -> _Sides:
        parts = np.linspace(FIRST, LAST, POINTS)[:, None]
        flat = corners if lens is None else lens.straight(corners)
        ends = np.roll(flat, -1, axis=0)
        points = np.concatenate(
            [start + parts * (end - start) for start, end in zip(flat, ends, strict=True)]
        )
        if lens is not None:
            points = lens.bent(points)
        ways = np.repeat(np.roll(corners, -1, axis=0) - corners, POINTS, axis=0)
        lengths = np.linalg.norm(ways, axis=1)
        normals = np.column_stack([ways[:, 1], -ways[:, 0]]) / lengths[:, None]
        return cls(points, normals, FAR * max(float(lengths.mean()) / LENGTH, 1.0))

    def profiles(self, picture: Picture, shifts: Array | float = 0.0) -> Array:
        """Return levels (n, samples, 3) across the sides, from inside to outside.

        Their middles are so far outside of the points: `shifts` (n,) [pixels].
        """
        offsets = np.linspace(-self.far, self.far, STEPS + 1)
        apart = np.broadcast_to(np.asarray(shifts, dtype=np.float64), (len(self.points),))
        across = self.points[:, None] + (apart[:, None] + offsets)[..., None] * self.normals[:, None]
        cv2 = opencv()
        maps = across.astype(np.float32)
        seen = cv2.remap(
            picture, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(seen, dtype=np.float64)


def _clearest(profiles: Array) -> NDArray[np.int64]:
    """Return the colour of each point (n,) in which the inside and outside of its side differ most.

    On a table as bright as the board a side shows in its hue, beside the board's shadow in its brightness.

    Parameters
    ----------
    profiles : (v, n, samples, 3) array
        Levels across the points of four sides in v pictures.
    """
    steps = np.abs(profiles[:, :, 2 * BLURRED :] - profiles[:, :, : -2 * BLURRED])
    contrast = (steps * _near(steps.shape[2])[:, None]).max(axis=2)
    sides = contrast.reshape(len(profiles), 4, -1, 3).swapaxes(0, 1).reshape(4, -1, 3)
    return np.repeat(np.argmax(np.quantile(sides, 0.1, axis=1), axis=1), contrast.shape[1] // 4)


def _near(count: int) -> Array:
    """Return weights (count,) of places across a side by how likely its edge is there, 1 in the middle."""
    apart = (np.arange(count) - (count - 1) / 2) * 2.0 * FAR / STEPS
    return np.asarray(np.exp(-0.5 * (apart / ROUGH) ** 2))


def _one_colour(profiles: Array, colours: NDArray[np.int64]) -> Array:
    """Return levels (n, samples) of profiles (n, samples, 3) in each point's colour (n,)."""
    return np.asarray(profiles[np.arange(len(profiles)), :, colours])


def _steps(profiles: Array) -> Array:
    """Return by how much profiles (n, samples) fall about each place (n, samples - 2 `BLURRED`)."""
    return np.asarray(profiles[:, : -2 * BLURRED] - profiles[:, 2 * BLURRED :])


def _directions(profiles: Array) -> Array:
    """Return whether each point's side falls from inside to outside, 1, or rises, -1 (n,)."""
    steps = _steps(profiles)
    best = np.argmax(np.abs(steps) * _near(steps.shape[1]), axis=1)
    sides = steps[np.arange(len(steps)), best].reshape(4, -1)
    return np.repeat(np.where(np.median(sides, axis=1) < 0.0, -1.0, 1.0), sides.shape[1])


def _roughly(profiles: Array, directions: Array, far: float, least: float) -> Array:
    """Return how far outside the likeliest step of each profile (n, samples) is (n,) [pixels]."""
    steps = directions[:, None] * _steps(profiles)
    best = np.argmax(steps * _near(steps.shape[1]), axis=1)
    there = steps[np.arange(len(steps)), best] > least
    return np.where(there, (best + BLURRED) * 2.0 * far / STEPS - far, np.nan)


def _even_parts(profiles: Array) -> NDArray[np.bool_]:
    """Return which samples say what is inside and outside of each side's edge (4, 2, samples).

    Parameters
    ----------
    profiles : (v, n, samples) array
        Light across the points of four sides in v pictures, the edge in the middle.
    """
    usual = np.nanmedian(profiles.reshape(len(profiles), 4, -1, profiles.shape[2]), axis=(0, 2))
    middle = STEPS // 2
    chosen = np.zeros((4, 2, STEPS + 1), dtype=np.bool_)
    for side, profile in enumerate(usual):
        slope = np.abs(np.gradient(profile))
        height = slope[middle - 1 : middle + 2].max()
        for end, way in enumerate((-1, 1)):
            along = slope[middle::way] / max(height, 1e-9)
            falls = np.flatnonzero(along < LEVEL)
            first = int(falls[0]) if len(falls) else len(along)
            # Where two steps are near each other, none of the light between them is even.
            rises = np.flatnonzero(np.diff(along) > 0.0)
            rises = rises[rises > 1]
            first = min(first, int(rises[0])) if len(rises) else min(first, len(along) - 1)
            rises = np.flatnonzero(along[first:] > ANOTHER)
            last = first + max(int(rises[0]), 1) if len(rises) else len(along)
            part = middle + way * np.arange(max(first, last - ENDS), last)
            chosen[side, end, part] = True
    return chosen


def _crossings(profiles: Array, far: float, even: NDArray[np.bool_], least: float) -> Array:
    """Return how far outside each point's edge is (n,) [pixels], NaN where there is none so far beside.

    `even` (4, 2, samples) says what of a profile is inside and outside; these differ by `least` [levels].
    """
    parts = np.repeat(even / even.sum(axis=2, keepdims=True), len(profiles) // 4, axis=0)
    inside, outside = np.einsum("ns,nes->en", profiles, parts)
    contrast = np.abs(inside - outside)
    light = (profiles / 255.0) ** POWER
    halfway = 0.5 * np.einsum("ns,nes->n", light, parts)
    apart = light - halfway[:, None]
    # A step of the other direction is another one.
    crosses = (apart[:, :-1] * apart[:, 1:] <= 0.0) & (
        (apart[:, :-1] - apart[:, 1:]) * (inside - outside)[:, None] > 0.0
    )
    step = 2.0 * far / STEPS
    starts = -far + step * np.arange(STEPS)
    nearest = np.argmin(np.where(crosses, np.abs(starts + 0.5 * step), np.inf), axis=1)
    rows = np.arange(len(profiles))
    before, after = apart[rows, nearest], apart[rows, nearest + 1]
    places = starts[nearest] + step * before / np.where(before == after, 1.0, before - after)
    return np.where(crosses.any(axis=1) & (contrast > least), places, np.nan)


def _smoothed(offsets: Array) -> Array:
    """Return offsets of sides' points (v, 4 `POINTS`) with those that are off a side's curve laid on it.

    In each picture a side is a line, bent a little where the lens is not known. What lies over it, or is left
    there by a picture that was not decoded as it should have been, is not the side.
    """
    laid = _curves(offsets, (2,) * STRAIGHT + (3,) * STRAIGHT)
    return np.where(np.abs(offsets - laid) > OFF, laid, offsets)


def _lines(offsets: Array) -> Array:
    """Return the lines (v, 4 `POINTS`) through sides' points, where there are any."""
    return _curves(offsets, (2,) * STRAIGHT, ROUGHLY)


def _curves(offsets: Array, rounds: tuple[int, ...], covered: float = COVERED) -> Array:
    """Return polynomials of so many terms, round by round, through offsets of sides' points (v, 4 `POINTS`).

    A point that is off by more than `covered` is let go of [pixels].
    """
    sides = offsets.reshape(-1, POINTS)
    seen = np.isfinite(sides)
    known = np.where(seen, sides, 0.0)
    along = np.linspace(-1.0, 1.0, POINTS)
    powers = np.stack([np.ones(POINTS), along, along**2])
    middle = [np.median(side[there]) if there.any() else 0.0 for side, there in zip(sides, seen, strict=True)]
    laid = np.array(middle)[:, None] + np.zeros(POINTS)
    for terms in rounds:
        weights = seen / (1.0 + ((known - laid) / covered) ** 2) ** 2
        design = powers[:terms]
        normal = np.einsum("sp,ip,jp->sij", weights, design, design) + 1e-6 * np.eye(terms)
        right = np.einsum("sp,ip,sp->si", weights, design, known)
        laid = np.linalg.solve(normal, right[..., None])[..., 0] @ design
    return laid.reshape(offsets.shape)


class BoardEdges:
    """The sides of a board before a camera.

    Parameters
    ----------
    pictures : sequence of (h, w, 3) uint8 arrays
        A sample of the run.
    corners : (4, 2) array
        Roughly those of the board [pixels].
    lens : Lens or None
        Of the camera.

    Attributes
    ----------
    corners : (4, 2) array
        Those about which the board tilts, over the sample [pixels].
    error_px : float
        Their standard error; how far sides are looked for, where one is not clear in most pictures.
    """

    def __init__(self, pictures: Sequence[Picture], corners: Array, lens: Lens | None) -> None:
        self._lens = lens
        self.corners, self.error_px = corners, FAR
        self.missed = 0
        self._least = least_step(pictures)
        self._residuals = np.zeros((3, 4 * POINTS))
        self._slopes: Array | None = None
        begin: Array | None = None
        for _ in range(2):
            self._places = sides = _Sides.of(self.corners, lens)
            start = np.zeros(4 * POINTS)
            if begin is not None:
                start = ((begin - sides.points) * sides.normals).sum(axis=1)
            self._colours = _clearest(np.array([sides.profiles(picture) for picture in pictures]))
            self._directions = _directions(_one_colour(sides.profiles(pictures[0], start), self._colours))
            shifts = self._roughly_in_turn(sides, pictures, start)
            begin = sides.points + shifts[0][:, None] * sides.normals
            profiles = np.array(
                [
                    _one_colour(sides.profiles(picture, shift), self._colours)
                    for picture, shift in zip(pictures, shifts, strict=True)
                ]
            )
            self._even = _even_parts((profiles / 255.0) ** POWER)
            crossings = [_crossings(one, sides.far, self._even, self._least) for one in profiles]
            offsets = shifts + _smoothed(np.array(crossings))
            seen = np.isfinite(offsets).mean(axis=0) > 0.5
            middle = np.array(
                [np.nanmean(one) if there else np.nan for one, there in zip(offsets.T, seen, strict=True)]
            )
            if (seen.reshape(4, POINTS).mean(axis=1) < ENOUGH).any():
                return
            self._refine(sides, middle)
            if np.abs(self.corners - corners).max() > 2.0 * sides.far:
                # Lines that left what was found were laid through something else.
                self.corners, self.error_px = corners, FAR
                return

    def _roughly_in_turn(self, sides: _Sides, pictures: Sequence[Picture], start: Array) -> Array:
        """Return where sides' points roughly are in pictures in the order of time (v, n) [pixels].

        From one picture to the next a side moves less than from one of its steps to another. `start` (n,) is
        where they are in the first picture.
        """
        shifts, last = [], start
        for picture in pictures:
            last = self._lines_about(picture, sides, last)
            shifts.append(last)
        return np.array(shifts)

    def _lines_about(self, picture: Picture, sides: _Sides, shifts: Array) -> Array:
        """Return lines (n,) through the likeliest steps about shifts (n,) [pixels].

        A side that is covered, or nowhere near, stays where it was.
        """
        for _ in range(2):
            profiles = _one_colour(sides.profiles(picture, shifts), self._colours)
            steps = _roughly(profiles, self._directions, sides.far, self._least)
            lines = _lines(steps[None])[0]
            seen = np.isfinite(steps).reshape(4, POINTS).mean(axis=1) >= ENOUGH
            near = np.abs(shifts + lines).reshape(4, POINTS).max(axis=1) < 2.0 * sides.far
            shifts = shifts + np.where(np.repeat(seen & near, POINTS), lines, 0.0)
        return shifts

    def _refine(self, sides: _Sides, offsets: Array) -> None:
        """Lay lines through the sides' points."""
        points = sides.points + offsets[:, None] * sides.normals
        lines, squares, count = [], 0.0, 0
        for side in range(4):
            own = points[side * POINTS : (side + 1) * POINTS]
            own = own[np.isfinite(own[:, 0])]
            start, way = fit_line(own, self._lens)
            lines.append((start, way))
            flat = own if self._lens is None else self._lens.straight(own)
            scale = 1.0 if self._lens is None else float(self._lens.matrix[0, 0])
            apart = scale * ((flat - start) @ np.array([way[1], -way[0]]))
            # What is covered has no say, as in the line.
            squares += float(np.minimum(apart**2, (3.0 * COVERED) ** 2).sum())
            count += len(own)
        corners = np.array([meet(lines[side - 1], lines[side]) for side in range(4)])
        self.corners = corners if self._lens is None else self._lens.bent(corners)
        self._places = _Sides.of(self.corners, self._lens)
        # The ends of a line through n points are known to 2/sqrt(n), along each of two sides.
        self.error_px = float(np.sqrt(2.0 * 4.0 * squares / count / (POINTS / ALIKE)))

    @property
    def clear(self) -> bool:
        """Whether all sides were measured in most pictures of the sample."""
        return self.error_px < FAR

    def stand(self, picture: Picture) -> bool:
        """Return whether the sides are in a picture where they were in the sample."""
        offsets = self._offsets(picture, np.zeros(len(self._places.points)), rough=True)
        return bool((np.abs(offsets) <= self._places.far).mean() >= ENOUGH)

    def _offsets(self, picture: Picture, about: Array, *, rough: bool) -> Array:
        """Return how far outside of its place each point's edge is in a picture (n,) [pixels].

        `about` (n,) is where it is looked for; `rough` where that is not known to a pixel.
        """
        sides = self._places
        if rough:
            about = self._lines_about(picture, sides, about)
        profiles = _one_colour(sides.profiles(picture, about), self._colours)
        return np.asarray(about + _crossings(profiles, sides.far, self._even, self._least))

    def watch(self, level: Geometry, size: Size) -> bool:
        """Begin to measure the tilt; return whether the sides say it, which they do for a calibrated lens."""
        if not isinstance(level, Pose) or not self.clear:
            return False
        sides = self._places
        surface = level.surface
        there = surface.positions(sides.points)
        flat = np.column_stack([there, np.zeros(len(there))])
        small = 1e-3
        slopes = []
        for rise in (there[:, 1], -there[:, 0]):
            lifted = flat + small * np.column_stack([np.zeros((len(there), 2)), rise])
            moved = (surface.project(lifted) - surface.project(flat)) / small
            slopes.append((moved * sides.normals).sum(axis=1))
        self._level, self._radius = level, size.radius
        self._slopes = np.array(slopes).T
        self._tilt = np.zeros(2)
        return True

    def tilt_noise(self) -> Array | None:
        """Return the standard error (2,) of the tilt about x and y in one picture [rad].

        None where no picture was followed. What the grain adds to each point in all pictures alike moves the
        zero of the tilt only.
        """
        weights, sums, squares = self._residuals
        known = weights > 0
        if self._slopes is None or not known.any():
            return None
        means = sums[known] / weights[known]
        scatter = (squares[known] - weights[known] * means**2).sum() / weights[known].sum()
        part = weights / weights.max()
        normal = (self._slopes.T * part) @ self._slopes
        return np.asarray(np.sqrt(ALIKE * scatter * np.diag(np.linalg.inv(normal))))

    def follow(self, picture: Picture) -> Geometry | None:
        """Return where the board is in a picture, None where its sides are covered."""
        slopes = self._slopes
        if slopes is None:
            return None
        # A board moves little from picture to picture.
        last = slopes @ self._tilt
        for about, rough in ((last, False), (last, True), (np.zeros_like(last), True)):
            offsets = self._offsets(picture, about, rough=rough)
            laid = _tilted(slopes, offsets)
            if laid is not None:
                break
        else:
            self.missed += 1
            return None
        self._tilt, weights = laid
        apart = np.where(weights > 0.0, offsets - slopes @ self._tilt, 0.0)
        self._residuals += weights * np.array([np.ones_like(apart), apart, apart**2])
        level = self._level
        turn, _ = opencv().Rodrigues(np.array([*self._tilt, 0.0]))
        return Pose(level.lens, level.rotation @ turn, level.origin, self._radius)


def _tilted(slopes: Array, offsets: Array) -> tuple[Array, Array] | None:
    """Return the tilt (2,) [rad] that explains most sides' points, and their weights (n,).

    None where it explains too few: then they are of something else.
    """
    seen = np.isfinite(offsets)
    if seen.mean() < ENOUGH:
        return None
    known = np.where(seen, offsets, 0.0)
    tilt: Array = np.zeros(2)
    for _ in range(ROUNDS):
        apart = known - slopes @ tilt
        weights = seen / (1.0 + (apart / COVERED) ** 2)
        normal = (slopes.T * weights) @ slopes
        tilt = np.asarray(np.linalg.solve(normal, (slopes.T * weights) @ known))
    explained = seen & (np.abs(known - slopes @ tilt) < OFF)
    return (tilt, weights) if explained.mean() >= ENOUGH else None
