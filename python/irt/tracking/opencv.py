"""OpenCV, imported where it is first needed: it loads slowly, and warns on its own."""

from __future__ import annotations

import os
from functools import cache
from typing import Any

from irt.extras import require


@cache
def opencv() -> Any:
    """Return the module, its own messages silenced: this package says what is wrong with a file, once.

    Raises
    ------
    IrtError
        If it is not installed.
    """
    require("cv2", "irt track")
    level = os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    import cv2  # noqa: PLC0415

    # The variable has no effect where the module was imported before.
    if level == "SILENT":
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2
