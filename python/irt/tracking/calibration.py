"""A camera's lens from pictures of a chessboard or a ChArUco board, kept in a file.

``camera.toml``::

    [camera]
    width = 640
    height = 480
    matrix = [fx, fy, cx, cy]          # pixels
    distortion = [k1, k2, p1, p2, k3]  # OpenCV's
    error_px = 0.21                    # root mean square of what is left over
    pictures = 18
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.files import PathLike, TomlTable, read_toml, write_atomic
from irt.tracking.geometry import Lens
from irt.tracking.opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Fewer views leave the lens open.
FEWEST = 5
#: More add time, not knowledge.
MOST = 40
#: Inner corners that a ChArUco view must show.
LEAST_CORNERS = 8
#: What a good calibration leaves over [pixels].
GOOD_PX = 1.0


@dataclass(frozen=True)
class Pattern:
    """What was held before the camera.

    Attributes
    ----------
    columns, rows : int
        Inner corners of a chessboard, or squares of a ChArUco board.
    charuco : bool
        Which of the two; markers of 4 x 4 bits, 0.75 of a square wide.
    """

    columns: int = 9
    rows: int = 6
    charuco: bool = False

    def find(self, picture: Picture) -> tuple[Array, Array] | None:
        """Return points (n, 3) [squares] and where they are seen (n, 2) [pixels], None where they are not."""
        grey = opencv().cvtColor(picture, opencv().COLOR_BGR2GRAY)
        return self._charuco(grey) if self.charuco else self._chessboard(grey)

    def _chessboard(self, grey: Any) -> tuple[Array, Array] | None:
        cv2 = opencv()
        found, corners = cv2.findChessboardCorners(
            grey, (self.columns, self.rows), flags=cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_FAST_CHECK
        )
        if not found:
            return None
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.005)
        corners = cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), stop).reshape(-1, 2)
        across, down = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        points = np.column_stack([across.ravel(), down.ravel(), np.zeros(across.size)])
        return points.astype(np.float64), np.asarray(corners, dtype=np.float64)

    def _charuco(self, grey: Any) -> tuple[Array, Array] | None:
        cv2 = opencv()
        board = charuco_board(self)
        corners, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        if numbers is None or len(numbers) < LEAST_CORNERS:
            return None
        points = np.asarray(board.getChessboardCorners(), dtype=np.float64)[np.ravel(numbers)]
        return points, np.asarray(corners, dtype=np.float64).reshape(-1, 2)


def charuco_board(pattern: Pattern) -> Any:
    """Return OpenCV's board of a pattern, squares of length 1."""
    cv2 = opencv()
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return cv2.aruco.CharucoBoard((pattern.columns, pattern.rows), 1.0, 0.75, words)


def calibrate(
    pictures: Sequence[Picture], pattern: Pattern, progress: Callable[[int, int, str], None]
) -> tuple[Lens, int]:
    """Return the lens that explains views of a pattern, and how many of the pictures showed it.

    Raises
    ------
    IrtError
        If too few pictures show the pattern, or they do not agree.
    """
    views = []
    for index, picture in enumerate(pictures):
        progress(index, len(pictures), "looking for the pattern")
        view = pattern.find(picture)
        if view is not None:
            views.append(view)
    kind = "ChArUco board of {} x {} squares" if pattern.charuco else "chessboard of {} x {} inner corners"
    name = kind.format(pattern.columns, pattern.rows)
    if len(views) < FEWEST:
        raise IrtError(
            f"{len(views)} of {len(pictures)} pictures show a {name}; at least {FEWEST} are needed, held at "
            "different slants (--pattern COLUMNSxROWS names another)"
        )
    kept = [views[one] for one in np.unique(np.linspace(0, len(views) - 1, MOST).astype(int))]
    height, width = pictures[0].shape[:2]
    lens = _solved(kept, (width, height))
    if not lens.error_px < GOOD_PX:
        raise IrtError(
            f"the views of the {name} do not fit one lens: {lens.error_px:.2g} pixels are left over; is the "
            "pattern flat, the camera's focus fixed, and are the pictures sharp?"
        )
    return lens, len(views)


def _solved(views: Sequence[tuple[Array, Array]], size: tuple[int, int]) -> Lens:
    """Return the lens of views; what tangential and sixth-order terms there may be is left at zero."""
    cv2 = opencv()
    points = [one.astype(np.float32) for one, _ in views]
    seen = [one.astype(np.float32) for _, one in views]
    flags = cv2.CALIB_FIX_K3 + cv2.CALIB_ZERO_TANGENT_DIST
    error, matrix, distortion, _, _ = cv2.calibrateCamera(points, seen, size, None, None, flags=flags)
    return Lens(np.asarray(matrix), np.asarray(distortion).ravel()[:5], size, float(error))


def save_lens(path: PathLike, lens: Lens, pictures: int) -> None:
    """Write a lens to a file.

    Raises
    ------
    IrtError
        If it cannot be written.
    """
    matrix = lens.matrix
    table = {
        "camera": {
            "width": lens.size[0],
            "height": lens.size[1],
            "matrix": [float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])],
            "distortion": [float(one) for one in lens.distortion],
            "error_px": lens.error_px,
            "pictures": pictures,
        }
    }
    write_atomic(path, tomli_w.dumps(table))


def load_lens(path: PathLike) -> Lens:
    """Read a lens from a file.

    Raises
    ------
    IrtError
        If the file is no calibration.
    """
    table = read_toml(path)
    table.only("section", ("camera",))
    camera = table.section("camera")
    camera.only("key", ("width", "height", "matrix", "distortion", "error_px", "pictures"))
    width, height = (int(camera.number(key)) for key in ("width", "height"))
    fx, fy, cx, cy = _list(camera, "matrix", 4)
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Lens(matrix, np.array(_list(camera, "distortion", 5)), (width, height), camera.number("error_px"))


def _list(table: TomlTable, key: str, count: int) -> tuple[float, ...]:
    numbers = table.series(key)
    if len(numbers) != count:
        raise table.error(key, f"expected {count} numbers in brackets, found {len(numbers)}")
    return numbers
