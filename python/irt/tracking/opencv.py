"""OpenCV, imported where it is first needed: it loads slowly, and warns on its own."""

from __future__ import annotations

import os
from functools import cache
from typing import Any


@cache
def opencv() -> Any:
    """Return the module, its own messages silenced: this package tells what is wrong with a file, once."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    import cv2  # noqa: PLC0415

    return cv2
