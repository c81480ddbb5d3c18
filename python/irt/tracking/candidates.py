"""What may be a marble in one picture: what is round, as large as the marble, and not on the empty board."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irt.tracking.blob_detector import Box, seek
from irt.tracking.edge_fit import Rim, Values, fit_rim
from irt.tracking.finder import Finder, greatest
from irt.tracking.opencv import opencv
from irt.tracking.separation import Candidate
from irt.tracking.tracker import MARGIN

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: A candidate's rays that must agree.
ROUND = 0.7
#: Candidates of one picture.
MOST = 6
#: How far a given disc's radius may be from its value (standard deviation, as a share).
STIFF = 0.05


def candidates(index: int, picture: Picture, known: Finder) -> list[Candidate]:
    """Return what is round, as large as the marble, and not there on the median board."""
    cv2 = opencv()
    rows, columns = known.box.slices
    without = known.without
    apart = greatest(picture[rows, columns], without[rows, columns])
    apart = cv2.GaussianBlur(apart, (3, 3), 0)
    mask = np.where(apart > max(5.0 * known.noise, 14.0), 255, 0).astype(np.uint8)
    found: list[Candidate] = []
    for _, x, y in seek(mask, known.radius, MOST):
        place = x + known.box.left, y + known.box.top
        height, width = picture.shape[:2]
        box = Box.about(*place, MARGIN * known.radius, Box(0, 0, width, height))
        change = picture[box.slices].astype(np.float32) - without[box.slices]
        layers = np.dstack([change, _cut(mask, known.box, box)]).astype(np.float32)
        rim = fit_rim(layers, known.noise, (place[0] - box.left, place[1] - box.top), known.radius)
        rim = replace(rim, x=rim.x + box.left, y=rim.y + box.top)
        if rim.support < ROUND or not 0.6 < rim.radius / known.radius < 1.6:
            continue
        if any(np.hypot(rim.x - one.rim.x, rim.y - one.rim.y) < known.radius for one in found):
            # Two places lead to one disc: it is no second marble.
            continue
        if _steps(picture, rim, known.noise) > _steps(without, rim, known.noise):
            found.append(Candidate(index, rim, _inner(picture, rim)))
    return found


def _cut(mask: Picture, of: Box, box: Box) -> Values:
    """Return a mask of one box, from 0 to 1, as another box has it."""
    part = np.zeros((box.bottom - box.top, box.right - box.left), np.float32)
    top, left = max(box.top, of.top), max(box.left, of.left)
    bottom, right = min(box.bottom, of.bottom), min(box.right, of.right)
    part[top - box.top : bottom - box.top, left - box.left : right - box.left] = (
        mask[top - of.top : bottom - of.top, left - of.left : right - of.left] / 255.0
    )
    return part


def _steps(picture: Picture, rim: Rim, noise: float) -> float:
    """Return how clear a given disc's rim is in a picture: the share of its rays that have a step there."""
    box = Box.about(rim.x, rim.y, MARGIN * rim.radius, Box(0, 0, picture.shape[1], picture.shape[0]))
    part = picture[box.slices].astype(np.float32)
    layers = np.dstack([part, np.ones(part.shape[:2], np.float32)])
    fit = fit_rim(layers, noise, (rim.x - box.left, rim.y - box.top), rim.radius, STIFF)
    moved = np.hypot(fit.x + box.left - rim.x, fit.y + box.top - rim.y)
    return fit.support if moved < 0.4 * rim.radius else 0.0


def _inner(picture: Picture, rim: Rim) -> Array:
    """Return the median colour (3,) of the inner part of a disc."""
    return np.asarray(np.median(picture[within(picture, rim, 0.6)], axis=0), dtype=np.float64)


def within(picture: Picture, rim: Rim, part: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the pixels within a part of a disc's radius."""
    box = Box.about(rim.x, rim.y, rim.radius, Box(0, 0, picture.shape[1], picture.shape[0]))
    down, right = np.mgrid[box.slices]
    inside = np.hypot(right - rim.x, down - rim.y) < part * rim.radius
    return down[inside], right[inside]
