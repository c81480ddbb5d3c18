"""A pinhole camera with a lens, looking at a board that tilts about its centre."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A camera in the board's level frame [m].

    Attributes
    ----------
    width, height : int
        Of the picture [pixels].
    focal : float
        Focal length [pixels].
    eye : (3,) array
        Where it is.
    rotation : (3, 3) array
        From the room to the camera: x right, y down, z forward.
    lens : (2,) array
        Brown's radial coefficients k1, k2.
    """

    width: int
    height: int
    focal: float
    eye: Array
    rotation: Array
    lens: Array = field(default_factory=lambda: np.zeros(2))

    @classmethod
    def above(
        cls,
        edge_px: float,
        edge_m: float = 0.276,
        *,
        focal: float = 900.0,
        lean: tuple[float, float] = (0.0, 0.0),
        turn: float = 0.0,
        lens: tuple[float, float] = (0.0, 0.0),
        size: tuple[int, int] = (640, 480),
    ) -> View:
        """Return a camera that sees a board's long edge so long [pixels], leaned and turned [rad]."""
        distance = focal * edge_m / edge_px
        direction = np.array([np.sin(lean[0]), np.sin(lean[1]), 0.0])
        direction[2] = np.sqrt(1.0 - direction @ direction)
        up = np.array([-np.sin(turn), np.cos(turn), 0.0])
        up = up - (up @ direction) * direction
        up /= np.linalg.norm(up)
        rotation = np.stack([np.cross(up, direction), -up, -direction])
        return cls(*size, focal, distance * direction, rotation, np.array(lens))

    @property
    def matrix(self) -> Array:
        """The camera matrix (3, 3)."""
        return np.array(
            [[self.focal, 0, (self.width - 1) / 2], [0, self.focal, (self.height - 1) / 2], [0, 0, 1.0]]
        )

    @property
    def distortion(self) -> Array:
        """The coefficients (5,) in OpenCV's order."""
        return np.array([*self.lens, 0.0, 0.0, 0.0])

    def project(self, points: Array) -> Array:
        """Return where points (n, 3) [m] are seen (n, 2) [pixels from the middle of the first one]."""
        seen = (np.atleast_2d(points) - self.eye) @ self.rotation.T
        seen = seen[:, :2] / seen[:, 2:]
        square = (seen**2).sum(axis=1, keepdims=True)
        bent = seen * (1.0 + self.lens[0] * square + self.lens[1] * square**2)
        return np.asarray(self.focal * bent + [(self.width - 1) / 2, (self.height - 1) / 2])

    def rays(self, finer: int = 1) -> NDArray[np.float32]:
        """Return tangents (h, w, 2) to the right of and below the line of sight, for each pixel."""
        down, right = np.mgrid[: self.height * finer, : self.width * finer]
        pixels = np.stack([right.ravel(), down.ravel()], axis=1).astype(np.float64)
        pixels = (pixels + 0.5) / finer - 0.5
        bent = (pixels - [(self.width - 1) / 2, (self.height - 1) / 2]) / self.focal
        straight = bent
        for _ in range(12):
            square = (straight**2).sum(axis=1, keepdims=True)
            straight = bent / (1.0 + self.lens[0] * square + self.lens[1] * square**2)
        return np.asarray(straight.reshape(*right.shape, 2), dtype=np.float32)


def turned(tilt: Array) -> Array:
    """Return the rotation (3, 3) of a board turned about x, then about its y [rad]."""
    (sin_x, sin_y), (cos_x, cos_y) = np.sin(tilt), np.cos(tilt)
    about_x = np.array([[1, 0, 0], [0, cos_x, -sin_x], [0, sin_x, cos_x]])
    return np.asarray(about_x @ np.array([[cos_y, 0, sin_y], [0, 1, 0], [-sin_y, 0, cos_y]]))
