"""The board's tilt by what is on it: its grain, its lines, its holes.

A tilt moves each point of the board by a known flow. The tilt of a picture is the one that lays it over the
usual picture of the board with the least squares of what differs (Lucas and Kanade, 1981), over points spread
over the whole board. In each block of these the light is free, so that shadows may pass, and what does not
fit, such as the marble, loses its say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irt.tracking.geometry import Geometry, Pose, Size
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Values = NDArray[np.float32]

#: Points on the board's long side and on its short one, and blocks of them that share a light.
POINTS, BLOCKS = (66, 54), (11, 9)
#: Share of the board beside each side that is left out: a rim stands on it, or shades it.
BESIDE = 0.06
#: Deviations at which a point begins to lose its say, and the least of these [levels].
LETS_GO, QUIETEST = 2.5, 1.0
#: Rounds of laying the pictures of a sample over each other: pictures blurred by so much [pixels].
SAMPLE = (2.5, 2.5, 0.8, 0.8)
#: Steps for a picture of the sample, and for one that follows another.
STEPS, FOLLOWS = 6, 3
#: A step of less is none [rad].
STILL = 2e-5
#: Blocks of which less than this share have as usual a half of their points that fit show no board.
ENOUGH = 0.5
#: Points that fit: within so many deviations.
FITS = 2.5
#: Slopes are the board's, and not noise, if halves of the sample agree on this share of their squares.
AGREE = 0.7
#: True errors over those of blocks that err by themselves, in 7 path-traced runs: shadows, a compression that
#: keeps the picture before, and corners in whole pixels err alike over the whole board.
SHARED = 3.0
#: A tilt that is known no better than this is of no use [rad]: it moves places by more than it mends.
USELESS = 0.004


class BoardTexture:
    """What is on a board before a calibrated camera.

    Parameters
    ----------
    pictures : sequence of (h, w, 3) uint8 arrays
        A sample of the run.
    level : Pose
        Of the board in the first picture, or at its mean tilt.
    size : Size
        Of the board.
    mean : bool
        Whether that is of the mean tilt.

    Attributes
    ----------
    missed : int
        Pictures followed whose tilt could not be measured.
    sample : list of Pose or None
        The board in the pictures of the sample, None where too little of it is seen.
    """

    def __init__(self, pictures: Sequence[Picture], level: Pose, size: Size, *, mean: bool = False) -> None:
        self._level = level
        across, along = POINTS
        x = (np.arange(across) + 0.5) / across - 0.5
        y = (np.arange(along) + 0.5) / along - 0.5
        parts = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
        there = (1.0 - 2.0 * BESIDE) * parts * [size.along_x, size.along_y]
        columns, rows = (
            np.minimum(((parts[:, axis] + 0.5) * BLOCKS[axis]).astype(int), BLOCKS[axis] - 1)
            for axis in (0, 1)
        )
        # Points of one block follow each other: their means are sums of stretches.
        block = rows * BLOCKS[0] + columns
        order = np.argsort(block, kind="stable")
        there, block = there[order], block[order]
        self._starts = np.searchsorted(block, np.arange(BLOCKS[0] * BLOCKS[1]))
        self._counts = np.diff(np.append(self._starts, len(block)))
        surface = level.surface
        flat = np.column_stack([there, np.zeros(len(there))])
        self._points = surface.project(flat)
        self._bent = _motion(surface, flat)
        self._tilt = np.zeros(2)
        self.missed = 0
        self._squares: list[Array] = []
        self._learn(pictures, mean=mean)

    def _learn(self, pictures: Sequence[Picture], *, mean: bool) -> None:
        """Learn the usual picture from a sample, and how tilts change it."""
        tilts = np.zeros((len(pictures), 2))
        for blur in SAMPLE:
            soft = [opencv().GaussianBlur(one, (0, 0), blur) for one in pictures]
            self._look(soft, tilts)
            tilts = np.array([self._laid(one, tilt, STEPS)[0] for one, tilt in zip(soft, tilts, strict=True)])
            tilts -= tilts.mean(axis=0) if mean else tilts[0]
        self._look(pictures, tilts)
        fits = [self._laid(one, tilt, STEPS) for one, tilt in zip(pictures, tilts, strict=True)]
        self._usual_error = float(np.median([np.linalg.norm(one[1]) for one in fits]))
        self.sample = [self._turned(tilt) if share >= ENOUGH else None for tilt, _, share in fits]

    def _look(self, pictures: Sequence[Picture], tilts: Array) -> None:
        """Set the usual levels, and how a tilt changes them, from pictures at known tilts."""
        ways = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        seen = np.array(
            [[self._even(one, tilt, way) for way in ways] for one, tilt in zip(pictures, tilts, strict=True)]
        )
        usual = np.median(seen[:, 0], axis=0)
        self._usual = usual.astype(np.float32)
        self._moved = self._changes(seen)
        self._scatter = np.maximum(1.48 * np.median(np.abs(seen[:, 0] - usual), axis=0), QUIETEST)
        one, other = self._changes(seen[::2]), self._changes(seen[1::2])
        self._agree = float(((one * other).sum(axis=0) / (self._moved**2).sum(axis=0)).min())

    def _changes(self, seen: Array) -> Array:
        """Return how much a tilt changes levels (n, 2), from those at points and beside them (v, 5, n)."""
        _, right, left, below, above = np.median(seen, axis=0)
        slopes = np.stack([right - left, below - above], axis=1) / 2.0
        moved = np.einsum("ni,nij->nj", slopes, self._bent[:, :, :2])
        return np.asarray(moved - self._means(moved))

    def _means(self, values: Array) -> Array:
        """Return the means of blocks, for each point (n, ...)."""
        means = np.add.reduceat(values, self._starts, axis=0)
        counts = self._counts.reshape(-1, *[1] * (values.ndim - 1))
        return np.repeat(means / counts, self._counts, axis=0)

    def _even(self, picture: Picture, tilt: Array, way: Array) -> Array:
        """Return the levels (n,) at the board's points, over the mean of their blocks, times 128."""
        places = (self._points + self._bent @ _powers(tilt) + way).astype(np.float32)
        cv2 = opencv()
        seen = cv2.remap(
            picture, places[:, 0], places[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        grey = seen.reshape(-1, 3).astype(np.float32).mean(axis=1)
        return np.asarray(128.0 * grey / (self._means(grey) + 1.0))

    def _laid(self, picture: Picture, tilt: Array, steps: int) -> tuple[Array, Array, float]:
        """Return a picture's tilt (2,) from a rough one, its error (2,), and the share of blocks that fit."""
        tilt = tilt.copy()
        for _ in range(steps):
            left = self._even(picture, tilt, np.zeros(2)) - self._usual
            part = left / self._scatter
            weights = 1.0 / ((1.0 + (part / LETS_GO) ** 2) ** 2 * self._scatter**2)
            weighed = self._moved * weights[:, None]
            normal = weighed.T @ self._moved + 1e-9 * np.eye(2)
            step = np.linalg.solve(normal, weighed.T @ left)
            tilt -= step
            if np.hypot(*step) < STILL:
                break
        fits = np.add.reduceat((np.abs(part) < FITS).astype(float), self._starts) > 0.5 * self._counts
        # Points of one block err alike.
        scores = np.add.reduceat(weighed * left[:, None], self._starts, axis=0)
        back = np.linalg.inv(normal)
        error = np.sqrt(np.diag(back @ (scores.T @ scores) @ back))
        return tilt, error, float(fits.mean())

    @property
    def shows(self) -> bool:
        """Whether the board has enough on it to show its tilt."""
        return self._agree > AGREE and self._usual_error < USELESS

    def tilt_noise(self) -> Array | None:
        """Return the standard error (2,) of the tilt about x and y in one picture [rad]."""
        return SHARED * np.sqrt(np.median(self._squares, axis=0)) if self._squares else None

    def follow(self, picture: Picture) -> Geometry | None:
        """Return where the board is in a picture, None where too little of it is seen."""
        tilt, error, fits = self._laid(picture, self._tilt, FOLLOWS)
        if fits < ENOUGH:
            self.missed += 1
            return None
        self._tilt = tilt
        self._squares.append(error**2)
        return self._turned(tilt)

    def _turned(self, tilt: Array) -> Pose:
        """Return the board at a tilt (2,)."""
        level = self._level
        turn, _ = opencv().Rodrigues(np.array([tilt[0], tilt[1], 0.0]))
        return Pose(level.lens, level.rotation @ turn, level.origin, level.radius)


def _powers(tilt: Array) -> Array:
    """Return the powers (5,) of a tilt (2,) that moves points of the board to the second order."""
    x, y = tilt
    return np.array([x, y, x * x, x * y, y * y])


def _motion(surface: Pose, flat: Array) -> Array:
    """Return how points of the board (n, 3) move in the picture (n, 2, 5) with `_powers` of a tilt."""
    small = 0.02
    tilts = small * np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1]])
    level = surface.project(flat)
    moved = []
    for x, y in tilts:
        turn, _ = opencv().Rodrigues(np.array([x, y, 0.0]))
        moved.append(surface.project(flat @ turn.T) - level)
    there = np.stack(moved, axis=2)
    solved = np.linalg.pinv(np.array([_powers(tilt) for tilt in tilts]))
    return np.asarray(there @ solved.T)
