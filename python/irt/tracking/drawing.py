"""Text in pictures, and pictures as files."""

from __future__ import annotations

from typing import Any

from irt.files import PathLike, write_atomic
from irt.tracking.opencv import opencv

Colour = tuple[int, int, int]


def write_text(picture: Any, text: str, place: tuple[int, int], colour: Colour, size: float = 0.5) -> None:
    """Write a line of text whose left foot is at a place [pixels]; colours are blue, green and red."""
    cv2 = opencv()
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def save_png(path: PathLike, picture: Any) -> None:
    """Write a picture as PNG.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    # OpenCV's own writer of files reports no full disk.
    _, data = opencv().imencode(".png", picture)
    write_atomic(path, data.tobytes())
