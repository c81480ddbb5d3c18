"""Pictures with the time of each: a video file, a folder of images, or a camera, read in one way."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError
from irt.files import PathLike
from irt.tracking.opencv import opencv

Picture = NDArray[np.uint8]

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
#: Where neither a file nor a user says it [pictures per second].
USUAL_RATE = 30.0
#: A camera that gives no picture for so long is gone [s].
PATIENCE_S = 3.0
#: Pictures between those that a camera's sample keeps, so that the marble moves in between.
APART = 3


@dataclass(frozen=True)
class Frame:
    """A picture, and when it was taken.

    Attributes
    ----------
    stamp : float
        [s] from the first picture.
    picture : (h, w, 3) uint8 array
        Blue first.
    wall : float
        When it came, on the computer's clock [s since 1970]; for a file, when it was read.
    """

    stamp: float
    picture: Picture
    wall: float


class Source(Protocol):
    """Where pictures come from."""

    name: str
    #: How its stamps were made, in words.
    stamped_by: str
    live: bool

    @property
    def expected(self) -> int:
        """How many pictures to expect, 0 if nobody knows."""

    def sample(self, count: int) -> list[Picture]:
        """Return so many pictures spread over the run (a camera's next seconds), the first one first."""

    def frames(self) -> Iterator[Frame]:
        """Yield all pictures in order, those of a camera's sample too."""

    def close(self) -> None:
        """Let the device or file go."""


def open_source(where: str, rate: float | None = None) -> Source:
    """Open what a user named: a video file, a folder of images, a number or device of a camera, an address.

    Parameters
    ----------
    where : str
        What to open.
    rate : float, optional
        Pictures per second; by default as the file says.

    Raises
    ------
    IrtError
        If it is not there, or holds no picture that can be read.
    """
    path = Path(where)
    if re.fullmatch(r"\d+", where) and not path.exists():
        return _Camera(int(where), f"camera {where}")
    if where.startswith("/dev/video") or "://" in where:
        return _Camera(where, where)
    if path.is_dir():
        return _Folder(path, rate)
    if not path.exists():
        raise IrtError(f"{path}: no such file; give a video, a folder of images, or the number of a camera")
    return _Video(path, rate)


class _Video:
    live = False

    def __init__(self, path: Path, rate: float | None) -> None:
        self.name, self._path, self._rate = path.stem, path, rate
        capture = self._opened()
        cv2 = opencv()
        self.expected = max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        stated = float(capture.get(cv2.CAP_PROP_FPS))
        self._stated_rate = stated if 0.1 < stated < 10000 else 0.0
        there, _ = capture.read()
        code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=False)
        capture.release()
        if not there:
            codec = code.decode("ascii", "replace").strip("\0 ") or "unknown"
            raise IrtError(
                f"{path}: holds no picture that can be decoded (codec {codec}): is the file whole? "
                "Otherwise convert it, for example: ffmpeg -i IN -c:v libx264 -crf 16 OUT.mp4"
            )
        self.stamped_by = f"{rate:g} pictures per second, as given" if rate else "the file's own stamps"

    def _opened(self) -> Any:
        cv2 = opencv()
        # The readers of OpenCV's own print of each broken byte, and are asked only where FFmpeg is missing.
        has_ffmpeg = cv2.videoio_registry.hasBackend(cv2.CAP_FFMPEG)
        capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG if has_ffmpeg else cv2.CAP_ANY)
        if not capture.isOpened():
            raise IrtError(
                f"{self._path}: is no video that can be opened; give a video file, or a folder of images"
            )
        return capture

    def sample(self, count: int) -> list[Picture]:
        cv2 = opencv()
        capture = self._opened()
        try:
            total = max(self.expected, 1)
            step = max(total / count, 1.0)
            taken: list[Picture] = []
            # To read on is quicker than to jump where few pictures lie between.
            jumps = step > 40
            index = 0
            wanted = 0.0
            while len(taken) < count:
                if jumps:
                    capture.set(cv2.CAP_PROP_POS_FRAMES, int(wanted))
                    index = int(wanted)
                if not capture.grab():
                    break
                if index >= int(wanted):
                    there, picture = capture.retrieve()
                    if there:
                        taken.append(_coloured(picture))
                    wanted += step
                index += 1
        finally:
            capture.release()
        return taken

    def frames(self) -> Iterator[Frame]:
        cv2 = opencv()
        capture = self._opened()
        try:
            index, last, first = 0, -1.0, None
            while True:
                there, picture = capture.read()
                if not there:
                    return
                if self._rate:
                    stamp = index / self._rate
                else:
                    stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
                    first = stamp if first is None else first
                    stamp -= first
                    if stamp <= last:
                        # A file without stamps, or with some that stand still.
                        stamp = last + 1.0 / (self._stated_rate or USUAL_RATE) if index else 0.0
                last = stamp
                index += 1
                yield Frame(stamp, _coloured(picture), time.time())
        finally:
            capture.release()

    def close(self) -> None:
        pass


class _Folder:
    live = False

    def __init__(self, path: Path, rate: float | None) -> None:
        files = [
            one for one in path.iterdir() if one.suffix.lower() in IMAGES and not one.name.startswith(".")
        ]
        if not files:
            raise IrtError(f"{path}: this folder holds no images ({', '.join(IMAGES)})")
        self.name = path.resolve().name
        self._files = sorted(files, key=_natural)
        self._rate = rate or USUAL_RATE
        self.expected = len(files)
        given = "as given" if rate else "for want of stamps (--fps says otherwise)"
        self.stamped_by = f"{self._rate:g} pictures per second, {given}"
        _read_image(self._files[0])

    def sample(self, count: int) -> list[Picture]:
        chosen = np.unique(np.linspace(0, len(self._files) - 1, count).astype(int))
        return [_read_image(self._files[one]) for one in chosen]

    def frames(self) -> Iterator[Frame]:
        shape = None
        for index, path in enumerate(self._files):
            picture = _read_image(path)
            if shape is not None and picture.shape != shape:
                raise IrtError(
                    f"{path}: {picture.shape[1]} x {picture.shape[0]} pixels, but the images before it have "
                    f"{shape[1]} x {shape[0]}"
                )
            shape = picture.shape
            yield Frame(index / self._rate, picture, time.time())

    def close(self) -> None:
        pass


class _Camera:
    live = True
    expected = 0
    stamped_by = "the computer's clock, as pictures came"

    def __init__(self, where: int | str, name: str) -> None:
        cv2 = opencv()
        self.name = re.sub(r"\W+", "-", name).strip("-")
        self._named = name
        self._capture = cv2.VideoCapture(where)
        if not self._capture.isOpened():
            raise IrtError(f"{name}: no such camera, or another program has it")
        # Old pictures are no use: take each as it comes.
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._kept: list[Frame] = []
        self._start: float | None = None

    def sample(self, count: int) -> list[Picture]:
        for frame in self._read(count * APART):
            self._kept.append(frame)
        return [frame.picture for frame in self._kept[::APART]]

    def frames(self) -> Iterator[Frame]:
        kept, self._kept = self._kept, []
        yield from kept
        yield from self._read(None)

    def _read(self, count: int | None) -> Iterator[Frame]:
        given = 0
        since = time.monotonic()
        while count is None or given < count:
            there, picture = self._capture.read()
            now = time.monotonic()
            if not there or picture is None:
                if now - since > PATIENCE_S or not self._capture.isOpened():
                    raise IrtError(f"{self._named}: the camera gives no pictures any more; is its cable in?")
                time.sleep(0.005)
                continue
            since = now
            self._start = now if self._start is None else self._start
            given += 1
            yield Frame(now - self._start, _coloured(picture), time.time())

    def close(self) -> None:
        self._capture.release()


def _coloured(picture: Any) -> Picture:
    if picture.ndim == 2:
        return np.asarray(opencv().cvtColor(picture, opencv().COLOR_GRAY2BGR), dtype=np.uint8)
    return np.asarray(picture, dtype=np.uint8)


def _read_image(path: PathLike) -> Picture:
    cv2 = opencv()
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise IrtError(
            f"{path}: is no image that can be read; take it out of the folder, or convert it to PNG"
        )
    return np.asarray(picture, dtype=np.uint8)


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Return a key that sorts numbers in a name by value: 2.png before 10.png."""
    parts = re.split(r"(\d+)", path.name)
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]
