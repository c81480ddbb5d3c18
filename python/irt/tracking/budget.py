"""What each part of the way from pixels to the board adds to the error of a place, in millimetres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.appearance import Appearance
from irt.tracking.geometry import Pose, Size
from irt.tracking.run import Scene

Array = NDArray[np.float64]

#: How well a marble's radius is known (standard deviation, as a share), and with it the height of its middle.
RADIUS = 0.03
#: How well rims show a marble's middle, as a share of its radius and in pixels: their error in 42 path-traced
#: runs (`docs/experiments.md`).
RIM, RIM_PX = 0.02, 0.3
#: Rims that are farther from the middle of what is covered may be wrong by that much [radii].
DISAGREE = 0.14
#: By what share places are too far out without a lens: a radius over the height of a camera 0.7 m above.
TOO_FAR_OUT = 0.01


@dataclass(frozen=True)
class Budget:
    """Standard errors of a place on the board [mm], root mean square over the board; None where unknown.

    Attributes
    ----------
    corners : float
        Of the board's corners.
    lens : float or None
        Of the calibration; unknown without one.
    height : float
        Of the height of the marble's middle above the board.
    tilt : float or None
        Of the measured tilt; unknown where it was not measured.
    marble : float
        Of the marble's middle in its picture, which is alike in all pictures.
    noise : float
        From picture to picture.
    """

    corners: float
    lens: float | None
    height: float
    tilt: float | None
    marble: float
    noise: float

    @property
    def parts(self) -> dict[str, float]:
        """The known parts by name, the largest first."""
        named = {
            "corners": self.corners,
            "lens": self.lens,
            "height": self.height,
            "tilt": self.tilt,
            "marble": self.marble,
            "noise": self.noise,
        }
        known = {name: value for name, value in named.items() if value is not None}
        return dict(sorted(known.items(), key=lambda one: -one[1]))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the parts that are not known."""
        return tuple(name for name in ("lens", "tilt") if getattr(self, name) is None)

    @property
    def total(self) -> float:
        """Root of the sum of the known parts' squares."""
        return float(np.sqrt(sum(value**2 for value in self.parts.values())))


def error_budget(scene: Scene, corners_mm: float, noise: float, edge_mm: float, pixels: float) -> Budget:
    """Return what adds to the error of a place.

    Parameters
    ----------
    scene : Scene
        As learned, its run followed.
    corners_mm : float
        Standard error of the corners [mm].
    noise : float
        Standard deviation of positions [board edges].
    edge_mm : float
        The board's long edge [mm].
    pixels : float
        To a board edge, at the middle of the board.
    """
    appearance = scene.learned.appearance
    marble = edge_mm * _middle_px(appearance) / pixels
    if not isinstance(scene.geometry, Pose):
        out = TOO_FAR_OUT * _spread(scene.size) * edge_mm
        return Budget(corners_mm, None, out, None, marble, edge_mm * noise)
    slopes = _slopes(scene.geometry, scene.size)
    tilt_noise = scene.tilt_noise
    tilt = None
    if tilt_noise is not None:
        # A tilt lifts a place by its distance from the axis; a slanted ray then meets the board elsewhere.
        lifts = np.linalg.norm(_places(scene.size)[:, ::-1] * tilt_noise, axis=1)
        tilt = edge_mm * float(np.sqrt(np.mean((lifts * slopes) ** 2)))
    height = edge_mm * RADIUS * scene.size.radius * float(np.sqrt(np.mean(slopes**2)))
    lens = edge_mm * scene.geometry.lens.error_px / pixels
    return Budget(corners_mm, lens, height, tilt, marble, edge_mm * noise)


def _middle_px(appearance: Appearance) -> float:
    """Return the standard error of the marble's middle in its picture [pixels]."""
    error = max(float(np.hypot(RIM * appearance.radius, RIM_PX)), appearance.error)
    return max(error, appearance.apart) if appearance.apart > DISAGREE * appearance.radius else error


def _places(size: Size) -> Array:
    """Return places (n, 2) spread over the board [board edges]."""
    parts = (np.arange(9) - 4.0) / 9.0
    x, y = np.meshgrid(parts * size.along_x, parts * size.along_y)
    return np.column_stack([x.ravel(), y.ravel()])


def _spread(size: Size) -> float:
    """Return the root mean square distance of places from the board's middle [board edges]."""
    return float(np.hypot(size.along_x, size.along_y) / np.sqrt(12.0))


def _slopes(level: Pose, size: Size) -> Array:
    """Return the tangents (n,) of the angles between the rays to places and the board's normal."""
    eye = -level.rotation.T @ level.origin
    away = np.linalg.norm(_places(size) - eye[:2], axis=1)
    return np.asarray(away / abs(eye[2]))
