"""A picture of the outlines that may be the board's, with what --corners would be for each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irt.files import PathLike
from irt.tracking.drawing import save_png, write_text
from irt.tracking.nested import AmbiguousBoardError, given
from irt.tracking.opencv import opencv

Picture = NDArray[np.uint8]

#: Blue, green, red of the outlines, from the outermost inward: Okabe and Ito's, for colour-blind readers.
COLOURS = ((0, 94, 213), (178, 114, 0), (115, 158, 0), (66, 228, 240), (167, 121, 204), (233, 180, 86))
INK, PAPER, BRIGHT = (30, 30, 30), (255, 255, 255), 140
#: Smaller pictures are enlarged to this width [pixels].
LEAST_WIDTH = 960
#: Margin with the pixels' numbers, distance of these numbers [pixels of the video], height of a line of text.
MARGIN, TICK, LINE = 44, 50, 26
#: Fraction of a pixel in which OpenCV draws, in bits.
_FINE = 4


def write_outlines(path: PathLike, found: AmbiguousBoardError) -> None:
    """Write the picture with its outlines, a scale in pixels, and a line for each outline, as PNG.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    cv2 = opencv()
    larger = -(-LEAST_WIDTH // found.picture.shape[1])
    drawn = cv2.resize(found.picture, None, fx=larger, fy=larger, interpolation=cv2.INTER_CUBIC)
    for number, (corners, colour) in enumerate(zip(found.outlines, COLOURS, strict=False), start=1):
        # The middle of the first pixel is at half a pixel of the larger picture.
        places = np.rint((larger * (corners + 0.5) - 0.5) * 2**_FINE).astype(np.int32)
        cv2.polylines(drawn, [places], True, colour, 2, cv2.LINE_AA, _FINE)
        # Numbers stand along the first side, one after the other.
        x, y = larger * (corners[0] + (corners[1] - corners[0]) * number / (len(found.outlines) + 1))
        cv2.circle(drawn, (round(x), round(y)), 13, colour, -1, cv2.LINE_AA)
        # Brightness as Rec. 601 weighs it: dark numbers on bright colours.
        ink = PAPER if np.dot(colour, (0.114, 0.587, 0.299)) < BRIGHT else INK
        write_text(drawn, str(number), (round(x) - 5, round(y) + 5), ink)
    legend = np.full((LINE * (len(found.outlines) + 1), drawn.shape[1] + MARGIN, 3), 255, np.uint8)
    for number, (corners, colour) in enumerate(zip(found.outlines, COLOURS, strict=False), start=1):
        foot = LINE * number - 7
        cv2.rectangle(legend, (MARGIN, foot - 12), (MARGIN + 18, foot + 2), colour, -1)
        write_text(legend, f"{number}   --corners {given(corners)}", (MARGIN + 30, foot), INK)
    last = LINE * (len(found.outlines) + 1) - 7
    write_text(
        legend, "none of them: read the corners of the board's floor off the scales", (MARGIN + 30, last), INK
    )
    save_png(path, np.vstack([_with_scales(drawn, larger), legend]))


def _with_scales(drawn: Picture, larger: int) -> Picture:
    """Return a picture with a margin above and to the left that counts the video's pixels."""
    cv2 = opencv()
    framed = np.asarray(cv2.copyMakeBorder(drawn, MARGIN, 0, MARGIN, 0, cv2.BORDER_CONSTANT, value=PAPER))
    height, width = drawn.shape[:2]
    for pixel in range(0, width // larger, TICK):
        at = MARGIN + larger * pixel
        cv2.line(framed, (at, MARGIN - 8), (at, MARGIN), INK, 1)
        write_text(framed, str(pixel), (at - 12, MARGIN - 14), INK)
    for pixel in range(0, height // larger, TICK):
        at = MARGIN + larger * pixel
        cv2.line(framed, (MARGIN - 8, at), (MARGIN, at), INK, 1)
        write_text(framed, str(pixel), (2, at + 5), INK)
    return framed
