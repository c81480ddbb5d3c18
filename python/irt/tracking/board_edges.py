"""The board's sides, measured along their whole length over the video: corners, their error, the tilt.

Each point of a side is where the light is halfway between inside and outside. A lens blurs light, not levels:
halfway between two levels lies outside of a bright board. So levels are taken back to light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.corners import LEAST_LEVELS, fit_line, meet
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
#: Samples at each end that say what is inside and outside.
ENDS = 4
#: Points of a side that err alike: they share the grain, and blocks of a compression.
ALIKE = 8.0
#: A side is measured where this share of its points is.
ENOUGH = 0.6
#: An edge that is off by more than so much is covered [pixels]: repeated edges scatter by a tenth.
COVERED = 0.3
#: A point that is off its side's curve by more than so much is not of it [pixels]: a grain moves it by half.
OFF = 1.0
#: Rounds in which a straight line is laid through a side, and then a bent one.
STRAIGHT = 8


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

    def profiles(self, picture: Picture) -> Array:
        """Return levels (n, samples, 3) across the sides, from inside to outside."""
        offsets = np.linspace(-self.far, self.far, STEPS + 1)
        across = self.points[:, None] + offsets[:, None] * self.normals[:, None]
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
    contrast = np.abs(profiles[:, :, :ENDS].mean(axis=2) - profiles[:, :, -ENDS:].mean(axis=2))
    sides = contrast.reshape(len(profiles), 4, -1, 3).swapaxes(0, 1).reshape(4, -1, 3)
    return np.repeat(np.argmax(np.quantile(sides, 0.1, axis=1), axis=1), contrast.shape[1] // 4)


def _one_colour(profiles: Array, colours: NDArray[np.int64]) -> Array:
    """Return levels (n, samples) of profiles (n, samples, 3) in each point's colour (n,)."""
    return np.asarray(profiles[np.arange(len(profiles)), :, colours])


def _crossings(profiles: Array, far: float) -> Array:
    """Return how far outside each point's edge is (n,) [pixels], NaN where there is none so far beside."""
    contrast = np.abs(profiles[:, :ENDS].mean(axis=1) - profiles[:, -ENDS:].mean(axis=1))
    light = (profiles / 255.0) ** POWER
    halfway = 0.5 * (light[:, :ENDS].mean(axis=1) + light[:, -ENDS:].mean(axis=1))
    apart = light - halfway[:, None]
    crosses = apart[:, :-1] * apart[:, 1:] <= 0.0
    step = 2.0 * far / STEPS
    starts = -far + step * np.arange(STEPS)
    nearest = np.argmin(np.where(crosses, np.abs(starts + 0.5 * step), np.inf), axis=1)
    rows = np.arange(len(profiles))
    before, after = apart[rows, nearest], apart[rows, nearest + 1]
    places = starts[nearest] + step * before / np.where(before == after, 1.0, before - after)
    return np.where(crosses.any(axis=1) & (contrast > LEAST_LEVELS), places, np.nan)


def _smoothed(offsets: Array) -> Array:
    """Return offsets of sides' points (v, 4 `POINTS`) with those that are off a side's curve laid on it.

    In each picture a side is a line, bent a little where the lens is not known. What lies over it, or is left
    there by a picture that was not decoded as it should have been, is not the side.
    """
    sides = offsets.reshape(-1, POINTS)
    seen = np.isfinite(sides)
    known = np.where(seen, sides, 0.0)
    along = np.linspace(-1.0, 1.0, POINTS)
    powers = np.stack([np.ones(POINTS), along, along**2])
    middle = [np.median(side[there]) if there.any() else 0.0 for side, there in zip(sides, seen, strict=True)]
    laid = np.array(middle)[:, None] + np.zeros(POINTS)
    for terms in (2,) * STRAIGHT + (3,) * STRAIGHT:
        weights = seen / (1.0 + ((known - laid) / COVERED) ** 2) ** 2
        design = powers[:terms]
        normal = np.einsum("sp,ip,jp->sij", weights, design, design) + 1e-6 * np.eye(terms)
        right = np.einsum("sp,ip,sp->si", weights, design, known)
        laid = np.linalg.solve(normal, right[..., None])[..., 0] @ design
    off = seen & (np.abs(known - laid) > OFF)
    return np.where(off, laid, sides).reshape(offsets.shape)


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
        self._residuals = np.zeros((3, 4 * POINTS))
        self._slopes: Array | None = None
        for _ in range(2):
            self._places = sides = _Sides.of(self.corners, lens)
            colours = [sides.profiles(picture) for picture in pictures]
            self._colours = _clearest(np.array(colours))
            profiles = [_one_colour(one, self._colours) for one in colours]
            offsets = _smoothed(np.array([_crossings(one, sides.far) for one in profiles]))
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
        return bool(np.isfinite(self._offsets(picture)).mean() >= ENOUGH)

    def _offsets(self, picture: Picture) -> Array:
        """Return how far outside of its place each point's edge is in a picture (n,) [pixels]."""
        profiles = _one_colour(self._places.profiles(picture), self._colours)
        return _crossings(profiles, self._places.far)

    def watch(self, level: Geometry, size: Size) -> bool:
        """Begin to measure the tilt; return whether the sides say it, which they do for a calibrated lens."""
        if not isinstance(level, Pose) or not self.clear:
            return False
        sides = self._places
        surface = Pose(level.lens, level.rotation, level.origin, 0.0)
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
        offsets = self._offsets(picture)
        seen = np.isfinite(offsets)
        if seen.mean() < ENOUGH:
            self.missed += 1
            return None
        slopes, offsets = slopes[seen], offsets[seen]
        tilt: Array = np.zeros(2)
        for _ in range(6):
            apart = offsets - slopes @ tilt
            weights = 1.0 / (1.0 + (apart / COVERED) ** 2)
            normal = (slopes.T * weights) @ slopes
            tilt = np.asarray(np.linalg.solve(normal, (slopes.T * weights) @ offsets))
        apart = offsets - slopes @ tilt
        self._residuals[:, seen] += weights * np.array([np.ones_like(apart), apart, apart**2])
        level = self._level
        turn, _ = opencv().Rodrigues(np.array([tilt[0], tilt[1], 0.0]))
        return Pose(level.lens, level.rotation @ turn, level.origin, self._radius)
