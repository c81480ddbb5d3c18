"""What the tracker saw, drawn on the pictures: a video, and a sheet of those it was least sure of."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.files import PathLike
from irt.tracking.drawing import save_png, write_text
from irt.tracking.opencv import opencv
from irt.tracking.run import Scene
from irt.tracking.source import Frame, Picture
from irt.tracking.tracker import Sighting

Array = NDArray[np.float64]

# Blue, green, red: they stand out from wood, and from each other for colour-blind readers.
SEEN, UNSURE, LOST, BOARD, PAPER = (
    (255, 200, 0),
    (0, 160, 255),
    (60, 60, 255),
    (200, 200, 200),
    (255, 255, 255),
)
#: Below this confidence a sighting is drawn as unsure.
SURE = 0.75
#: Pictures that the drawn way reaches back.
TRAIL = 45
#: Fraction of a pixel in which OpenCV draws, in bits.
_FINE = 4
#: The sheet: tiles in a row and in all, their side [pixels], and how much each is enlarged.
COLUMNS, TILES, SIDE, LARGER = 6, 24, 64, 3


class Overlay:
    """Draws on each picture and writes a video."""

    def __init__(self, path: Path, scene: Scene, rate: float) -> None:
        self.path, self._scene, self._rate = path, scene, rate
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL)
        self._writer: Any = None
        self._count = 0

    def add(self, frame: Frame, sighting: Sighting) -> None:
        """Draw the next picture."""
        cv2 = opencv()
        drawn = frame.picture.copy()
        if self._writer is None:
            height, width = drawn.shape[:2]
            code = cv2.VideoWriter_fourcc(*"mp4v")
            self._writer = cv2.VideoWriter(str(self.path), code, self._rate, (width, height))
            if not self._writer.isOpened():
                raise IrtError(f"{self.path}: the video of what was seen cannot be written")
        corners = np.rint(self._scene.corners * 2**_FINE).astype(np.int32)
        cv2.polylines(drawn, [corners], True, BOARD, 1, cv2.LINE_AA, _FINE)
        self._trail.append((sighting.x, sighting.y))
        for one, other in pairwise(self._trail):
            if not np.isnan([*one, *other]).any():
                cv2.line(drawn, _fine(one), _fine(other), SEEN, 1, cv2.LINE_AA, _FINE)
        draw_sighting(drawn, sighting, self._scene.learned.radius)
        text = f"{frame.stamp:8.2f} s   {'lost' if not sighting.seen else f'{sighting.confidence:.2f}'}"
        # A thicker font would be a wider one: the dark edge is the same text, moved.
        for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            write_text(drawn, text, (8 + dx, 20 + dy), (0, 0, 0))
        write_text(drawn, text, (8, 20), PAPER if sighting.seen else LOST)
        self._writer.write(drawn)
        self._count += 1

    def close(self) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.release()

    def finish(self) -> None:
        """Close the file and check that it is complete, because its writer reports no errors.

        Raises
        ------
        IrtError
            If it is not, as on a full disk.
        """
        cv2 = opencv()
        self.close()
        capture = cv2.VideoCapture(str(self.path))
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
        capture.release()
        if count != self._count:
            raise IrtError(
                f"{self.path.parent}: the video of what was seen cannot be written: {count} of {self._count} "
                "pictures are in it; is the disk full?"
            )


def draw_sighting(picture: Picture, sighting: Sighting, radius: float, larger: int = 1) -> None:
    """Draw the rim of a marble and its middle."""
    if not sighting.seen:
        return
    cv2 = opencv()
    colour = SEEN if sighting.confidence >= SURE else UNSURE
    # The middle of the first pixel is at half a pixel of the larger picture.
    x, y = (larger * (one + 0.5) - 0.5 for one in (sighting.x, sighting.y))
    reach = round((larger * radius + 1.5) * 2**_FINE)
    cv2.circle(picture, _fine((x, y)), reach, colour, 1, cv2.LINE_AA, _FINE)
    for dx, dy in ((1, 0), (0, 1)):
        ends = [(x - 3 * dx, y - 3 * dy), (x + 3 * dx, y + 3 * dy)]
        cv2.line(picture, _fine(ends[0]), _fine(ends[1]), colour, 1, cv2.LINE_AA, _FINE)


def _fine(place: tuple[float, float]) -> tuple[int, int]:
    return round(place[0] * 2**_FINE), round(place[1] * 2**_FINE)


@dataclass(frozen=True)
class _Tile:
    index: int
    stamp: float
    sighting: Sighting
    part: Picture
    left: int
    top: int


class ContactSheet:
    """Keeps a part of the least sure picture of each stretch of a run.

    Parameters
    ----------
    scene : Scene
        The board.
    expected : int
        How many pictures there will be, 0 if nobody knows.
    """

    def __init__(self, scene: Scene, expected: int) -> None:
        self._scene = scene
        self._stretch = max(expected // TILES, 1) if expected else 120
        self._worst: dict[int, _Tile] = {}
        self._count = 0
        self._last = tuple(float(one) for one in scene.corners.mean(axis=0))

    def add(self, frame: Frame, sighting: Sighting) -> None:
        """Look at the next picture."""
        index, self._count = self._count, self._count + 1
        if sighting.seen:
            self._last = sighting.x, sighting.y
        stretch = index // self._stretch
        worst = self._worst.get(stretch)
        if worst is not None and _worth(worst.sighting) <= _worth(sighting):
            return
        height, width = frame.picture.shape[:2]
        left = int(np.clip(self._last[0] - SIDE / 2, 0, max(width - SIDE, 0)))
        top = int(np.clip(self._last[1] - SIDE / 2, 0, max(height - SIDE, 0)))
        part = frame.picture[top : top + SIDE, left : left + SIDE].copy()
        self._worst[stretch] = _Tile(index, frame.stamp, sighting, part, left, top)

    def write(self, path: PathLike) -> None:
        """Write the sheet as PNG, the least sure pictures first.

        Raises
        ------
        IrtError
            If the file cannot be written.
        """
        tiles = sorted(self._worst.values(), key=lambda one: _worth(one.sighting))[:TILES]
        drawn = [self._drawn(tile) for tile in tiles]
        blank = np.full_like(drawn[0], 255)
        drawn += [blank] * (-len(drawn) % COLUMNS)
        rows = [np.hstack(drawn[row : row + COLUMNS]) for row in range(0, len(drawn), COLUMNS)]
        save_png(path, np.vstack(rows))

    def _drawn(self, tile: _Tile) -> Picture:
        cv2 = opencv()
        part = np.zeros((SIDE, SIDE, 3), np.uint8)
        part[: tile.part.shape[0], : tile.part.shape[1]] = tile.part
        large = cv2.resize(part, None, fx=LARGER, fy=LARGER, interpolation=cv2.INTER_NEAREST)
        one = tile.sighting
        moved = Sighting(one.x - tile.left, one.y - tile.top, one.confidence, one.in_window)
        draw_sighting(large, moved, self._scene.learned.radius, LARGER)
        label = np.full((22, large.shape[1], 3), 255, np.uint8)
        text = f"{tile.stamp:.2f} s  {'lost' if not one.seen else f'{one.confidence:.2f}'}"
        write_text(label, text, (5, 16), (30, 30, 30), 0.45)
        framed = np.vstack([label, large])
        return np.asarray(cv2.copyMakeBorder(framed, 0, 4, 2, 2, cv2.BORDER_CONSTANT, value=PAPER))


def _worth(sighting: Sighting) -> float:
    """Return what pictures are ranked by: lost ones before all others."""
    return sighting.confidence - (0.0 if sighting.seen else 2.0)
