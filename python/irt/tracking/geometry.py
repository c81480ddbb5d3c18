"""From pixels to the board: its four corners, the lens, and how high above the board a marble's middle is.

A camera sees the middle of a ball, a radius above the board; the point of contact lies beneath. Seen from the
side the two are apart: from 0.6 m above, at the end of a board of 276 mm, by 1.6 mm of a marble of 13.7 mm.
Where the lens is calibrated the ray through the marble's middle is met with the plane in which that middle
moves. Where it is not, a homography takes pixels to the board's surface, and the middle appears too far out
by radius/(height of the camera), about 1 %: a larger `observation_scale` and an offset, which a fit has.

The outline of a ball is an ellipse whose middle is not the picture of the ball's: they are apart by
(radius/distance)^2 of the way from the picture's middle, 0.03 pixels here, which is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lens:
    """A calibrated camera.

    Attributes
    ----------
    matrix : (3, 3) array
        Focal lengths and principal point [pixels].
    distortion : (5,) array
        OpenCV's k1, k2, p1, p2, k3.
    size : tuple of int
        Width and height of its pictures.
    error_px : float
        Root mean square of what the calibration leaves over.
    """

    matrix: Array
    distortion: Array
    size: tuple[int, int]
    error_px: float

    def straight(self, pixels: Array) -> Array:
        """Return the tangents (n, 2) of the rays of pixels (n, 2), right of and below the line of sight."""
        if not len(pixels):
            return np.empty((0, 2))
        points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        rays = opencv().undistortPoints(points, self.matrix, self.distortion).reshape(-1, 2)
        # OpenCV stops after five rounds, in the corners of a wide lens too early.
        for _ in range(3):
            rays = rays + (points[:, 0] - self.bent(rays)) / self.matrix[[0, 1], [0, 1]]
        return np.asarray(rays)

    def bent(self, tangents: Array) -> Array:
        """Return the pixels (n, 2) of rays (n, 2); the inverse of `straight`."""
        points = np.column_stack([tangents, np.ones(len(tangents))])
        none = np.zeros(3)
        seen, _ = opencv().projectPoints(points, none, none, self.matrix, self.distortion)
        return np.asarray(seen.reshape(-1, 2))


@dataclass(frozen=True)
class Size:
    """Lengths in board edges, of the long edge: the board's along x and y, and the marble's radius."""

    along_x: float
    along_y: float
    radius: float

    @property
    def corners(self) -> Array:
        """The corners (4, 2), clockwise from the one of least x and greatest y, as seen from above."""
        x, y = self.along_x / 2.0, self.along_y / 2.0
        return np.array([[-x, y], [x, y], [x, -y], [-x, -y]])


class Plane:
    """A board without a calibrated lens: the homography from pixels to its surface.

    Attributes
    ----------
    homography : (3, 3) array
        From pixels to board edges.
    """

    #: Whether the marble's height is taken into account.
    sees_height = False

    def __init__(self, homography: Array, radius: float) -> None:
        self.homography = homography / homography[2, 2]
        self.radius = radius
        self._back = np.linalg.inv(self.homography)

    @classmethod
    def of(cls, corners: Array, size: Size) -> Plane:
        """Return the plane of a board whose corners (4, 2) [pixels] are seen."""
        cv2 = opencv()
        there = cv2.getPerspectiveTransform(corners.astype(np.float32), size.corners.astype(np.float32))
        return cls(np.asarray(there, dtype=np.float64), size.radius)

    @property
    def surface(self) -> Plane:
        """The board's surface itself, which this geometry is of."""
        return self

    def positions(self, pixels: Array) -> Array:
        """Return the places (n, 2) [board edges] of marbles whose middles are seen at pixels (n, 2)."""
        return _mapped(self.homography, pixels)

    def pixels(self, positions: Array) -> Array:
        """Return where the middles of marbles at places (n, 2) [board edges] are seen (n, 2) [pixels]."""
        return _mapped(self._back, positions)

    def radius_at(self, pixel: tuple[float, float]) -> float:
        """Return the radius of a marble seen at a pixel [pixels].

        A ball is not foreshortened: across the camera's slope it is as large as a disc on the board.
        """
        x, y = self.positions(np.array([pixel]))[0]
        around = self.pixels(np.array([[x, y], [x + self.radius, y], [x, y + self.radius]]))
        return float(np.linalg.svd(around[1:] - around[0], compute_uv=False)[0])

    def feet(self, pixels: Array) -> Array:
        """Return where marbles seen at pixels (n, 2) touch the board, beside their middles (n, 2): there.

        The height that parts the two is not taken into account.
        """
        return np.zeros_like(pixels)


class Pose:
    """A board before a calibrated lens.

    Attributes
    ----------
    rotation, origin : (3, 3) and (3,) arrays
        From the board's frame to the camera's (x right, y down, z forward) [board edges].
    """

    sees_height = True

    def __init__(self, lens: Lens, rotation: Array, origin: Array, radius: float) -> None:
        self.lens, self.rotation, self.origin, self.radius = lens, rotation, origin, radius

    @classmethod
    def of(cls, lens: Lens, seen: Array, points: Array, radius: float) -> Pose:
        """Return the pose that shows points (n, 2) of the board's surface [board edges] at pixels (n, 2).

        Raises
        ------
        IrtError
            If there is none.
        """
        cv2 = opencv()
        there = np.column_stack([points, np.zeros(len(points))])
        straight = lens.straight(seen)
        found, turns, origin = cv2.solvePnP(there, straight, np.eye(3), None, flags=cv2.SOLVEPNP_ITERATIVE)
        if not found:
            raise IrtError(
                "the board's corners fit no place of a board before this lens: is it this camera's?"
            )
        rotation, _ = cv2.Rodrigues(turns)
        return cls(lens, np.asarray(rotation), np.asarray(origin).ravel(), radius)

    @property
    def surface(self) -> Pose:
        """The same board for what lies on its surface, and not a radius above it."""
        return Pose(self.lens, self.rotation, self.origin, 0.0)

    def positions(self, pixels: Array) -> Array:
        """Return the places (n, 2) [board edges] of marbles whose middles are seen at pixels (n, 2)."""
        rays = np.column_stack([self.lens.straight(pixels), np.ones(len(pixels))]) @ self.rotation
        eye = -self.rotation.T @ self.origin
        far = (self.radius - eye[2]) / rays[:, 2:]
        return np.asarray(eye[:2] + far * rays[:, :2])

    def pixels(self, positions: Array) -> Array:
        """Return where the middles of marbles at places (n, 2) [board edges] are seen (n, 2) [pixels]."""
        points = np.column_stack([positions, np.full(len(positions), self.radius)])
        return self.project(points)

    def project(self, points: Array) -> Array:
        """Return where points (n, 3) [board edges] are seen (n, 2) [pixels]."""
        turns, _ = opencv().Rodrigues(self.rotation)
        seen, _ = opencv().projectPoints(points, turns, self.origin, self.lens.matrix, self.lens.distortion)
        return np.asarray(seen.reshape(-1, 2))

    def radius_at(self, pixel: tuple[float, float]) -> float:
        """Return the radius of a marble seen at a pixel [pixels]."""
        place = self.positions(np.array([pixel]))[0]
        away = float(np.linalg.norm(self.rotation @ [*place, self.radius] + self.origin))
        return float(np.sqrt(self.lens.matrix[0, 0] * self.lens.matrix[1, 1])) * self.radius / away

    def feet(self, pixels: Array) -> Array:
        """Return where marbles seen at pixels (n, 2) touch the board, beside their middles (n, 2) [radii]."""
        places = self.positions(pixels)
        beneath = self.project(np.column_stack([places, np.zeros(len(places))]))
        radii = np.array([self.radius_at((float(x), float(y))) for x, y in pixels])
        return np.asarray((beneath - pixels) / radii[:, None])

    def tilt_from(self, level: Pose) -> Array:
        """Return the angles (2,) about x and y [rad] by which this board is turned from a level one.

        By the right-hand rule, in the board's frame.
        """
        turns, _ = opencv().Rodrigues(level.rotation.T @ self.rotation)
        return np.asarray(turns.ravel()[:2], dtype=np.float64)

    @property
    def height(self) -> float:
        """How far the camera is from the board's plane [board edges]."""
        return float(abs((self.rotation.T @ self.origin)[2]))


Geometry = Plane | Pose


def moved(place: tuple[float, float], before: Geometry, after: Geometry) -> tuple[float, float]:
    """Return where what a board's surface has at a pixel is after the board has moved [pixels]."""
    x, y = after.surface.pixels(before.surface.positions(np.array([place])))[0]
    return float(x), float(y)


def _mapped(homography: Array, points: Array) -> Array:
    seen = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(seen[:, :2] / seen[:, 2:])
