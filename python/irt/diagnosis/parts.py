"""Parts of long recordings, where too few were recorded for a proof by held-out ones."""

from __future__ import annotations

import math
from dataclasses import replace

from irt.recording import Recording
from irt.rig import Rig
from irt.segments import row_seconds

#: Number of recordings below which they are cut: of two that agree one in two pairs does so by chance.
_FEW = 3
#: Number of parts at least: a paired t-test over fewer can hardly reach 5 %.
_PARTS = 4
#: Duration of a part [s], as long as labs' runs, and its least: six times the half second at its beginning
#: that is not fitted, the gap between a part and the one before.
_LENGTH_S, _SHORTEST_S = 10.0, 3.0


def in_parts(rig: Rig) -> Rig:
    """Return a rig of parts of its recordings in motion, if these are fewer than three and long enough.

    A part begins with a row in which the marble was seen, and as if its commands were unknown before. Those
    shorter than 3 s would show too little. Recordings from rest stay whole: their start states are known,
    which is worth more than a proof by parts that begin in motion.
    """
    count = len(rig.recordings)
    if rig.start == "rest" or count >= _FEW:
        return rig
    middle = sum(rig.ranges["time_scale"]) / 2.0
    parts = [part for one in rig.recordings for part in _parts(one, row_seconds(one, middle), count)]
    return rig if len(parts) == count else replace(rig, recordings=tuple(parts))


def _parts(recording: Recording, row_s: float, recordings: int) -> list[Recording]:
    rows = len(recording.knobs)
    length_s = rows * row_s
    wanted = max(math.ceil(_PARTS / recordings), round(length_s / _LENGTH_S))
    number = min(wanted, int(length_s / _SHORTEST_S))
    if number < 2:
        return [recording]
    seen = recording.seen.nonzero()[0]
    found = []
    for part in range(number):
        begin, end = part * rows // number, (part + 1) * rows // number
        inside = seen[(seen >= begin) & (seen < end)]
        if len(inside):
            found.append(_part(recording, slice(int(inside[0]), end), f"{recording.name}, part {part + 1}"))
    return found


def _part(recording: Recording, rows: slice, name: str) -> Recording:
    stamps, tilt = recording.stamps, recording.tilt
    return replace(
        recording,
        name=name,
        knobs=recording.knobs[rows],
        marble=recording.marble[rows],
        stamps=None if stamps is None else stamps[rows],
        tilt=None if tilt is None else tilt[rows],
        before=recording.knobs[rows.start - 1] if rows.start else recording.before,
    )
