"""What may be wrong with a track: sentences to read before its positions are used."""

from __future__ import annotations

from irt.tracking.budget import DISAGREE
from irt.tracking.learning import FAINT_SHADOW
from irt.tracking.recorded import Summary

#: Largest standard error of the board's corners without a warning [mm]: that which is allowed of positions.
_CORNERS_MM = 0.5


def doubts(summary: Summary) -> list[str]:
    """Return what may be wrong with a track and what to do, one sentence each."""
    found = [
        f"the board is displaced in pictures {first + 1} to {first + count} ({start:.2f} to {end:.2f} s): "
        "it left the view, it or the camera was moved, or its sides are covered; these rows are left empty: "
        "split the video there"
        for first, count, start, end in summary.away
    ]
    found += [
        f"the camera froze in pictures {first + 1} to {first + count} ({start:.2f} to {end:.2f} s): they all "
        "show the same picture; these rows are left empty"
        for first, count, start, end in summary.still
    ]
    if summary.corners_mm > _CORNERS_MM:
        found.append(
            f"the board's corners are uncertain by {summary.corners_mm:.1f} mm: check the overlay, and set "
            "them with --corners if they are wrong"
        )
    if summary.disagree > DISAGREE:
        found.append(
            f"the marble's edge and its filled area disagree by {summary.disagree:.2f} radii: a shadow may "
            "be taken for part of it; check the overlay, and set its position with --marble"
        )
    if summary.shadow > FAINT_SHADOW:
        found.append(
            f"the probability is {100 * summary.shadow:.0f} % that this is the marble's shadow: check the "
            "overlay, and set the marble's position with --marble"
        )
    return found
