"""ArUco markers on the board: where the board is in every picture, so that its tilt moves no marble.

Which markers there are, and where, nobody has to say: they are found in the first picture, on the board whose
corners are known there, and from then on show where the board is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.tracking.geometry import Geometry, Lens, Plane, Pose, Size
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

DICTIONARY = "DICT_4X4_50"
#: A corner that is refined moves no farther than this from the one before [pixels].
REACH = 4
#: What a board's corners may be off its pose (root mean square) before all markers are looked for anew
#: [pixels].
FITS = 0.7
#: Two markers pin down a board's tilt; one does so badly.
FEWEST = 2


def detect_markers(picture: Picture) -> dict[int, Array]:
    """Return the corners (4, 2) [pixels] of each marker in a picture, by its number."""
    cv2 = opencv()
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    settings.cornerRefinementWinSize = 3
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY)), settings
    )
    corners, numbers, _ = detector.detectMarkers(picture)
    if numbers is None:
        return {}
    return {
        int(number): np.asarray(four, dtype=np.float64).reshape(4, 2)
        for number, four in zip(np.ravel(numbers), corners, strict=True)
    }


def corners_by_markers(picture: Picture) -> Array | None:
    """Return the outer corners (4, 2) [pixels] of markers 0 to 3 in their order, if all are seen."""
    seen = detect_markers(picture)
    if not {0, 1, 2, 3} <= seen.keys():
        return None
    middle = np.mean([seen[number].mean(axis=0) for number in range(4)], axis=0)
    return np.array(
        [seen[number][np.argmax(np.linalg.norm(seen[number] - middle, axis=1))] for number in range(4)]
    )


class Markers:
    """The markers of one board.

    Parameters
    ----------
    picture : (h, w, 3) uint8 array
        Of the level board.
    level : Plane or Pose
        Where the board is in it.
    size : Size
        Of board and marble.
    lens : Lens or None
        Of the camera.
    """

    def __init__(self, picture: Picture, level: Geometry, size: Size, lens: Lens | None) -> None:
        self._level, self._size, self._lens = level, size, lens
        surface = level.surface
        half_x, half_y = size.along_x / 2, size.along_y / 2
        self.places: dict[int, Array] = {}
        for number, four in detect_markers(picture).items():
            there = surface.positions(four)
            # Markers beside the board do not tilt with it.
            if (np.abs(there) <= [half_x * 1.02, half_y * 1.02]).all():
                self.places[number] = there
        self._last: dict[int, Array] = {}
        self.missed = 0
        self._squares: list[float] = []

    @property
    def enough(self) -> bool:
        """Whether they show how the board is tilted."""
        return len(self.places) >= FEWEST

    def follow(self, picture: Picture) -> Geometry | None:
        """Return where the board is in a picture, None where too few markers are seen."""
        if self._last:
            seen = self._refined(picture)
            geometry, error = self._solved(seen)
            if geometry is not None and error < FITS:
                self._last = seen
                self._squares.append(error**2)
                return geometry
        seen = {number: four for number, four in detect_markers(picture).items() if number in self.places}
        geometry, error = self._solved(seen)
        if geometry is None or error > 2 * FITS:
            self._last = {}
            self.missed += 1
            return None
        self._last = seen
        self._squares.append(error**2)
        return geometry

    def tilt_noise(self) -> Array | None:
        """Return the standard error (2,) of the tilt about x and y in one picture [rad].

        None without a lens, or where no picture was followed. Corners of markers err independently.
        """
        if not isinstance(self._level, Pose) or not self._squares:
            return None
        level, flat = self._level, np.concatenate(list(self.places.values()))
        points = np.column_stack([flat, np.zeros(len(flat))])
        origin = level.project(points)
        small = 1e-4
        turns = [np.cross(way, points) for way in np.eye(3)]
        shifts = [np.tile(way, (len(points), 1)) for way in np.eye(3)]
        slopes = np.array(
            [(level.project(points + small * one) - origin).ravel() / small for one in (*turns, *shifts)]
        )
        # A pose takes 6 of the 2 n coordinates; a coordinate's square is half of a corner's.
        free = 2 * len(points) / (2 * len(points) - len(slopes))
        variance = 0.5 * free * float(np.mean(self._squares))
        return np.asarray(np.sqrt(variance * np.diag(np.linalg.inv(slopes @ slopes.T))[:2]))

    def _refined(self, picture: Picture) -> dict[int, Array]:
        """Return the last corners, moved to where they are now."""
        cv2 = opencv()
        numbers = list(self._last)
        points = np.concatenate([self._last[number] for number in numbers]).astype(np.float32)
        low = np.floor(points.min(axis=0)).astype(int) - 12
        high = np.ceil(points.max(axis=0)).astype(int) + 13
        left, top = np.maximum(low, 0)
        grey = cv2.cvtColor(picture[top : high[1], left : high[0]], cv2.COLOR_BGR2GRAY)
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 12, 0.02)
        shift = np.array([left, top], np.float32)
        found = cv2.cornerSubPix(grey, (points - shift).reshape(-1, 1, 2), (REACH, REACH), (-1, -1), stop)
        found = found.reshape(-1, 4, 2).astype(np.float64) + shift
        return dict(zip(numbers, found, strict=True))

    def _solved(self, seen: dict[int, Array]) -> tuple[Geometry | None, float]:
        """Return where the board is, and what its markers' corners are off that [pixels]."""
        if len(seen) < FEWEST:
            return None, np.inf
        pixels = np.concatenate(list(seen.values()))
        places = np.concatenate([self.places[number] for number in seen])
        if self._lens is not None:
            pose = Pose.of(self._lens, pixels, places, self._size.radius)
            back = pose.project(np.column_stack([places, np.zeros(len(places))]))
            return pose, float(np.sqrt(((back - pixels) ** 2).sum(axis=1).mean()))
        matrix, _ = opencv().findHomography(pixels, places)
        if matrix is None:
            return None, np.inf
        plane = Plane(np.asarray(matrix, dtype=np.float64), self._size.radius)
        return plane, float(np.sqrt(((plane.pixels(places) - pixels) ** 2).sum(axis=1).mean()))
