"""What is used otherwise to find a ball in a picture, each as its documentation shows it.

All know more than the tracker: the marble's colour and size as the first pictures show them, and the
board's box. Of several finds each takes the one nearest to its last.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irt.tracking.blob_detector import Box

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Find = Callable[[Picture], list[tuple[float, float]]]

NOWHERE = (float("nan"), float("nan"))


class Rival:
    """A way to find a ball, and which of its finds is the marble."""

    def __init__(self, find: Find, box: Box) -> None:
        self._find, self._box = find, box
        self._last: tuple[float, float] | None = None

    def see(self, picture: Picture) -> tuple[float, float]:
        """Return the marble's middle [pixels], NaN where there is none."""
        part = np.ascontiguousarray(picture[self._box.slices])
        found = [(x + self._box.left, y + self._box.top) for x, y in self._find(part)]
        if not found:
            return NOWHERE
        if self._last is None:
            self._last = found[0]
        near = self._last
        self._last = min(found, key=lambda one: (one[0] - near[0]) ** 2 + (one[1] - near[1]) ** 2)
        return self._last


def rivals(
    first: Sequence[Picture], places: Array, radius: float, box: Box, absent: dict[str, str]
) -> dict[str, Rival]:
    """Return the ways by name; they know where the marble is in the first pictures."""
    colours = np.concatenate([_inner(one, place, radius) for one, place in zip(first, places, strict=True)])
    found = {
        "HSV inRange + minEnclosingCircle": Rival(_in_range(colours, radius), box),
        "cv2.HoughCircles": Rival(_hough(radius), box),
        "cv2.SimpleBlobDetector": Rival(_blobs(colours, radius), box),
    }
    try:
        import trackpy  # noqa: PLC0415
    except ImportError:
        absent["trackpy"] = "it is not installed"
    else:
        trackpy.quiet()
        found["trackpy.locate"] = Rival(_trackpy(trackpy, colours, radius), box)
    return found


def _inner(picture: Picture, place: Array, radius: float) -> Picture:
    down, right = np.mgrid[: picture.shape[0], : picture.shape[1]]
    return np.asarray(picture[np.hypot(right - place[0], down - place[1]) < 0.8 * radius])


def _in_range(colours: Picture, radius: float) -> Find:
    """Threshold in HSV, contours, the smallest circle around each: what the paper's tracker does."""
    hsv = cv2.cvtColor(colours[None], cv2.COLOR_BGR2HSV)[0].astype(int)
    # Red lies at both ends of the hues.
    turn = 90 - int(np.median((hsv[:, 0] + 90) % 180 if np.ptp(hsv[:, 0]) > 90 else hsv[:, 0]))
    turn = turn - 90 if np.ptp(hsv[:, 0]) > 90 else turn
    hsv[:, 0] = (hsv[:, 0] + turn) % 180
    wider = np.array([8, 40, 40])
    low = np.clip(np.quantile(hsv, 0.03, axis=0) - wider, 0, 255)
    high = np.clip(np.quantile(hsv, 0.97, axis=0) + wider, 0, 255)

    def find(picture: Picture) -> list[tuple[float, float]]:
        shown = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
        shown[:, :, 0] = (shown[:, :, 0].astype(np.int16) + turn) % 180
        mask = cv2.inRange(shown, low, high)
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        circles = [cv2.minEnclosingCircle(one) for one in sorted(contours, key=cv2.contourArea, reverse=True)]
        return [(x, y) for (x, y), size in circles[:8] if 0.5 * radius < size < 1.8 * radius]

    return find


def _hough(radius: float) -> Find:
    def find(picture: Picture) -> list[tuple[float, float]]:
        grey = cv2.medianBlur(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), 3)
        circles = cv2.HoughCircles(
            grey,
            cv2.HOUGH_GRADIENT,
            1.0,
            3.0 * radius,
            param1=100.0,
            param2=10.0,
            minRadius=int(0.7 * radius),
            maxRadius=int(1.3 * radius) + 1,
        )
        return [] if circles is None else [(float(x), float(y)) for x, y, _ in np.reshape(circles, (-1, 3))]

    return find


def _unlike(picture: Picture, colour: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return how far from a colour each pixel is, half as much again for what a shade less light does."""
    apart = picture.astype(np.float32) - colour
    return np.asarray(np.clip(np.sqrt((apart**2).sum(axis=2)), 0, 255), dtype=np.uint8)


def _blobs(colours: Picture, radius: float) -> Find:
    colour = np.median(colours, axis=0).astype(np.float32)
    library: Any = cv2
    settings = library.SimpleBlobDetector_Params()
    settings.filterByArea, settings.filterByCircularity = True, True
    settings.minArea, settings.maxArea = 0.4 * np.pi * radius**2, 2.0 * np.pi * radius**2
    settings.minCircularity = 0.6
    settings.minThreshold, settings.maxThreshold, settings.thresholdStep = 20, 160, 10
    detector = library.SimpleBlobDetector_create(settings)

    def find(picture: Picture) -> list[tuple[float, float]]:
        points = sorted(detector.detect(_unlike(picture, colour)), key=lambda one: -one.size)
        return [(float(one.pt[0]), float(one.pt[1])) for one in points]

    return find


def _trackpy(trackpy: Any, colours: Picture, radius: float) -> Find:
    colour = np.median(colours, axis=0).astype(np.float32)
    across = 2 * round(radius) + 1

    def find(picture: Picture) -> list[tuple[float, float]]:
        found = trackpy.locate(255 - _unlike(picture, colour), across, topn=3, engine="python")
        found = found.sort_values("mass", ascending=False)
        return [(float(x), float(y)) for x, y in zip(found["x"], found["y"], strict=True)]

    return find
