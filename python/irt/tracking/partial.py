"""What was seen so far, on the disk while a run goes on: a crash costs a second."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from irt.errors import IrtError

#: How often rows are handed to the disk [s].
FLUSHED_S = 1.0


class Partial:
    """A CSV that grows; no recording yet, and not named as one."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._flushed = 0.0

    def __enter__(self) -> Self:
        with self._reported():
            self._file = self._path.open("w", encoding="utf-8")
            self._file.write("t_s,marble_x,marble_y,confidence\n")
        return self

    def add(self, stamp: float, place: NDArray[np.float64], confidence: float) -> None:
        """Add a picture.

        Raises
        ------
        IrtError
            If it cannot be written.
        """
        x, y = ("" if np.isnan(one) else f"{one:.7f}" for one in place)
        now = time.monotonic()
        with self._reported():
            self._file.write(f"{stamp:.6f},{x},{y},{confidence:.3f}\n")
            if now - self._flushed > FLUSHED_S:
                self._file.flush()
                self._flushed = now

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # What could not be written before cannot be written now.
        with self._reported() if kind is None else suppress(OSError):
            self._file.close()

    @contextmanager
    def _reported(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise IrtError(f"{self._path}: cannot be written: {error.strerror or error}") from error
